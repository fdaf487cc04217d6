"""POST /v1/validations: a verdict, and nothing is stored."""

from fastapi import APIRouter, Response

from service.api.documentation import request_body
from service.api.examining import examine
from service.api.queries import without_query
from service.api.requests import Body, read_json
from service.api.resources import Inside
from service.api.responses import json_response, refusals
from service.examination import examine_question
from service.schemas.problem import read_question
from service.schemas.verdict import VerdictOut

router = APIRouter(prefix="/v1/validations", tags=["validations"])

EXAMPLES: dict[str, object] = {
    "admissible": {
        "value": {
            "body": {"A": 2, "C": 1},
            "potential": {
                "type": "expression",
                "expression": "a*g1 + b/g3^2",
                "parameters": {"a": -1, "b": "1/20"},
            },
            "motion": {"type": "planar", "lambda": 1},
        }
    },
    "inadmissible": {"value": {"body": {"A": 2, "C": 1}, "potential": {"type": "gravity", "a": 1, "b": 1}}},
}


@router.post(
    "",
    response_model=VerdictOut,
    responses=refusals(400, 413, 415),
    openapi_extra=request_body("ValidationIn", EXAMPLES),
    dependencies=[without_query],
)
def validate(content: Body, inside: Inside) -> Response:
    """Say whether a potential admits planar motions, how that is known, and which motions there are."""
    document = read_json(content)
    read_question(document)
    verdict = examine(inside, examine_question, document)
    return json_response(VerdictOut.model_validate(verdict))
