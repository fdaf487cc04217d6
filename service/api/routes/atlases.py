"""POST /v1/atlases: all planar motions over a range of λ; stores nothing."""

import json

from fastapi import APIRouter, Request, Response
from starlette.concurrency import run_in_threadpool

from service.api.bodies import Body, read_json
from service.api.dependencies import Inside
from service.api.descriptions import request_body
from service.api.formats.atlases import choose_format, media_types
from service.api.formats.negotiation import Accept
from service.api.middleware.disconnects import while_connected
from service.api.middleware.security import Holder
from service.api.replies.responses import refusals
from service.api.verdicts.children import examine
from service.api.verdicts.verdict_queue import Claimant
from service.schemas.atlas.reading import read_atlas
from service.schemas.atlas.replies import AtlasOut
from service.verdicts.atlases import examine_atlas

router = APIRouter(prefix="/v1/atlases", tags=["validations"])

EXAMPLES: dict[str, object] = {
    "three terms": {
        "value": {
            "body": {"A": 2, "C": 1},
            "potential": {
                "type": "expression",
                "expression": "a*g1 + b/g3^2 + c*(g1^2 - g2^2)",
                "parameters": {"a": -1, "b": "1/20", "c": "3/2"},
            },
            "lambda": ["1/10", 3],
        }
    },
    "of a formula in g2": {
        "value": {
            "body": {"A": 3, "C": 2},
            "potential": {"type": "general", "F": "w", "G": "g2^2"},
            "lambda": ["1/2", 2],
            "samples": 41,
        }
    },
}


@router.post(
    "",
    response_model=AtlasOut,
    responses={
        200: {
            "model": AtlasOut,
            "description": "The atlas. Arrow and CSV have a row for each window and λ; SVG is a picture.",
            "content": media_types(),
        },
        **refusals(400, 406, 408, 413, 415, 503),
    },
    openapi_extra=request_body("AtlasIn", EXAMPLES),
)
async def draw_atlas(
    content: Body, inside: Inside, holder: Holder, request: Request, accept: Accept = None
) -> Response:
    """Tell for which λ of a range there are planar motions, and of which kind.

    Parts of the range are proved to keep the number, kinds and ends of their windows; each
    change between them is enclosed. On each part the windows are followed: their ends,
    energies and periods, with errors. Nothing is stored.
    """
    write = choose_format(accept)
    text = await inside.reading.run(len(content), _checked, content)
    claimant = Claimant(None if holder is None else holder.id)
    atlas = await while_connected(request, examine(inside.verdicts, examine_atlas, text, claimant))
    return await run_in_threadpool(write, AtlasOut.model_validate(atlas))


def _checked(content: bytes) -> str:
    document = read_json(content)
    read_atlas(document)
    return json.dumps(document)
