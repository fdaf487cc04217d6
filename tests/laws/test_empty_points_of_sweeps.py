"""On both sides of the border of existence a point of a sweep ends as its own job does."""

import json
from fractions import Fraction

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from service.schemas.sweep.reading import read_sweep
from service.storage.codecs.packing import SOLVED, decode_points
from service.verdicts.examination import examine_problem
from tests.support.admissible import Case, cases
from tests.support.effort import examples
from workers.sweeping import chunk
from workers.sweeping.chunk import compute_chunk

STEPS = 10
"""Halvings of λ's range that find the border."""
APART = [sign * Fraction(10) ** -power for power in (1, 2, 3, 4, 6) for sign in (1, -1)]


@pytest.fixture(autouse=True)
def no_hurry(monkeypatch):
    """Nothing ends a chunk but its last point."""
    monkeypatch.setattr(chunk, "MOST_CHUNK_SECONDS", 600.0)
    chunk._solver_of.cache_clear()


def problem(case: Case, lambda_: Fraction) -> dict[str, object]:
    signs = {"g1_sign": case.motion.g1_sign, "g3_sign": case.motion.g3_sign}
    return {
        "body": {"A": str(case.A), "C": str(case.C), "allow_unphysical": True},
        "potential": {"type": "expression", "expression": case.text},
        "motion": {"type": "planar", "lambda": str(lambda_), "window": 0, **signs},
        "time": {"stop": 1, "samples": 2},
        "accuracy": {"tier": "draft"},
        "outputs": ["period"],
    }


def ends_with(case: Case, lambda_: Fraction) -> str:
    """Return what the job of one λ ends with before it is computed."""
    answer = json.loads(examine_problem(json.dumps(problem(case, lambda_)), explains=False))
    return answer["error"]["code"] if "error" in answer else SOLVED


def border_of(case: Case) -> Fraction | None:
    low, high = Fraction(1, 8), Fraction(8)
    has_none = ends_with(case, low) == "no_motion"
    if has_none == (ends_with(case, high) == "no_motion"):
        return None
    for _ in range(STEPS):
        middle = (low + high) / 2
        low, high = (middle, high) if (ends_with(case, middle) == "no_motion") == has_none else (low, middle)
    return (low + high) / 2


@given(cases(), st.integers(1, 9))
@settings(max_examples=examples(3, 8), deadline=None)
def test_a_block_refuses_the_very_points_that_jobs_refuse(case, digit):
    border = border_of(case)
    assume(border is not None)
    lambdas = [border * (1 + digit * apart / 10) for apart in APART]
    document = {
        "base": problem(case, border),
        "axes": [{"pointer": "/motion/lambda", "values": [str(each) for each in lambdas]}],
        "keep": ["period"],
        "series": False,
    }
    swept = read_sweep(document)
    outcome = compute_chunk(json.dumps({"sweep": document, "first": 0, "count": swept.points}))
    found = decode_points(outcome.data).outcomes
    assert len(found) == swept.points
    for index, each in enumerate(found):
        expected = ends_with(case, swept.values(index)[0])
        assert (each == "no_motion") == (expected == "no_motion"), (case, lambdas[index])
    assert outcome.refused == sum(each != SOLVED for each in found)
