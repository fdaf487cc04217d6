"""A potential that does not allow the motion is refused by its verdict, and handed over by no solver."""

import json

import pytest

from service.jobs.records import Refused
from workers.computation.compute import solve_checked, solve_document

DOCUMENT = {
    "body": {"A": "17/10", "C": 1},
    "potential": {"type": "gravity", "a": -1},
    "motion": {"type": "planar", "lambda": "7/10"},
    "time": {"stop": 1, "samples": 11},
}


@pytest.mark.one_in(2)
@pytest.mark.parametrize("tier", ["draft", "standard", "high"])
def test_a_uniform_field_needs_a_body_of_double_moment(tier):
    """V = -g1 is admissible for A = 2C only: with another A the curve is a motion of no body.

    A worker gets judged problems only. Where it does not, what it finds breaks the equations by the size
    of the variables themselves, and no tolerance is as large as that.
    """
    text = json.dumps({**DOCUMENT, "accuracy": {"tier": tier}})
    judged, unjudged = solve_checked(text), solve_document(text)
    assert isinstance(judged, Refused)
    assert judged.error["code"] == "inadmissible_potential"
    assert isinstance(unjudged, Refused)
    assert unjudged.error["code"] == "accuracy_not_met"
