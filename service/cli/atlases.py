"""``polhode atlas``: all planar motions over a range of λ, without a service."""

import json
from pathlib import Path
from typing import Annotated

import typer

from service.cli.children import examining
from service.cli.common import REFUSED, WRONG_USAGE, AsJson, Document, fail, settings_of
from service.terminal import STANDARD_STREAM, OutputFile, answer, check_writable, read_document


def atlas(
    file: Document,
    as_json: AsJson = False,
    picture: Annotated[
        Path | None, typer.Option(metavar="OUT", help="write a picture of it (SVG); - is stdout")
    ] = None,
) -> None:
    """Tell for which λ of a range there are planar motions, of which kind, and where that changes."""
    from service.schemas.atlas.picture import picture_of  # noqa: PLC0415
    from service.schemas.atlas.reading import read_atlas  # noqa: PLC0415
    from service.schemas.atlas.replies import AtlasOut  # noqa: PLC0415
    from service.schemas.atlas.text import describe_atlas  # noqa: PLC0415
    from service.schemas.replies.verdict_text import Refusal  # noqa: PLC0415
    from service.verdicts.refusals import refusal_of_reading  # noqa: PLC0415

    if picture == STANDARD_STREAM and as_json:
        fail("--json and --picture=- both write to stdout; accepted is one of them", WRONG_USAGE)
    if picture is not None:
        check_writable(picture)
    document = read_document(file)
    error = refusal_of_reading(document, read_atlas)
    found = {"error": error} if error is not None else json.loads(_drawn(document))
    if "error" in found:
        if as_json:
            answer(json.dumps(found["error"]) + "\n")
        fail(Refusal.model_validate(found["error"]).reason(), REFUSED)
    drawn = AtlasOut.model_validate(found["verdict"])
    if picture is not None:
        with OutputFile(picture) as out:
            out.write(picture_of(drawn).encode())
    if picture == STANDARD_STREAM:
        return
    if as_json:
        answer(json.dumps(found["verdict"]) + "\n")
    else:
        answer(describe_atlas(drawn) + "\n")


def _drawn(document: object) -> str:
    from service.verdicts.atlases import examine_atlas  # noqa: PLC0415

    settings = settings_of()
    with examining(settings, examine_atlas.__module__) as sandbox:
        return sandbox.run(examine_atlas, json.dumps(document), seconds=settings.verdict_seconds)
