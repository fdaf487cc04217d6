"""GET /v1/families: the potentials that have a name."""

from fastapi import APIRouter, Response

from service.api.requests import without_query
from service.api.responses import json_response, refusals
from service.schemas.solution import FamiliesOut, FamilyOut

router = APIRouter(prefix="/v1/families", tags=["families"])

_SOURCE = (
    "H. M. Yehia, New solvable problems in the dynamics of a rigid body "
    "about a fixed point in a potential field"
)
_OUTPUTS = ["gamma", "omega", "invariants"]


@router.get("", response_model=FamiliesOut, responses=refusals(), dependencies=[without_query])
def list_families() -> Response:
    """List the families with their conditions, parameters, source and an example problem."""
    return json_response(FamiliesOut(items=[_expression(), _gravity(), _rational()]))


def _expression() -> FamilyOut:
    return FamilyOut(
        type="expression",
        title="Any potential, by its formula",
        potential="expression",
        conditions=["Planar motions need the compatibility equation: POST /v1/validations decides it."],
        parameters={
            "expression": "a formula in g1, g2, g3, the parameters and A, B, C",
            "parameters": "the named constants of the formula, exact",
        },
        source=_SOURCE,
        example={
            "body": {"A": 2, "B": "3/2", "C": 1},
            "potential": {
                "type": "expression",
                "expression": "a1*g1 + b1/g3^2 + c1*(g1^2 - g2^2)",
                "parameters": {"a1": -1, "b1": "1/50", "c1": "6/5"},
            },
            "motion": {"type": "planar", "lambda": 1},
            "time": {"stop": 10, "samples": 101},
            "outputs": _OUTPUTS,
        },
    )


def _gravity() -> FamilyOut:
    return FamilyOut(
        type="gravity",
        title="A heavy body",
        potential="a*g1 + b*g2 + c*g3",
        conditions=["Planar motions: A = 2*C and b = c = 0 (Bobylev and Steklov)."],
        parameters={
            "a": "weight times the first coordinate of the centre of mass",
            "b": "weight times the second coordinate",
            "c": "weight times the third coordinate",
        },
        source="D. K. Bobylev and V. A. Steklov, 1896",
        example={
            "body": {"A": 2, "B": "3/2", "C": 1},
            "potential": {"type": "gravity", "a": -1},
            "motion": {"type": "planar", "nu": 1},
            "time": {"periods": 1, "samples": 201},
            "outputs": _OUTPUTS,
        },
    )


def _rational() -> FamilyOut:
    return FamilyOut(
        type="rational",
        title="Rational potentials",
        potential="a1*g1 + b1/g3^2 + c1*(g1^2 - g2^2) + c2*g2^2*(2*g1^2 + g3^2) + ...",
        conditions=["A = 2*C"],
        parameters={
            "a": "coefficients a1, a2, ... of the terms odd in g1",
            "b": "coefficients b1, b2, ... of the terms singular at g3 = 0",
            "c": "c1 of g1^2 - g2^2; ck of g2^(2*k-2)*(2*g1^2 + g3^2) for k >= 2",
        },
        source=_SOURCE,
        example={
            "body": {"A": 2, "B": "17/10", "C": 1},
            "potential": {
                "type": "rational",
                "a": [-2, "1/20", "1/200"],
                "b": ["1/50", "1/500", "1/4000"],
                "c": ["1/5", "1/10"],
            },
            "motion": {"type": "planar", "nu": 1},
            "time": {"periods": 2, "samples": 401},
            "outputs": _OUTPUTS,
        },
    )
