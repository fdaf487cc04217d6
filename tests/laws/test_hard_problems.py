"""Hard problems, in the words of their list, beside quadratures that share no code with the service."""

import json

import mpmath as mp
import pytest
from flint import arb

from service.jobs.records import Solved
from service.storage.codecs.packing import decode_arrays
from tests.support.effort import one_in, seldom
from tests.support.hard_problems import DIGITS, Hard, Q, expression, poles, problem, time_between
from workers.computation.compute import solve_document


@pytest.mark.parametrize("hard", one_in(5, poles()), ids=lambda hard: hard.name)
def test_a_motion_ends_where_p_squared_is_infinite(hard: Hard):
    document = {**hard.document, "accuracy": {"tier": "standard"}}
    told = solve_document(json.dumps(document)).summary["asymptotes"]["future"]
    assert told["kind"] == "collision"
    # The quadratures have 24 digits.
    true = arb(hard.truth["end"]())
    assert abs(arb(told["time"]["value"]) - true) <= told["time"]["error"] + arb("1e-23")
    assert told["time"]["error"] < 1e-10


@pytest.mark.parametrize(
    ("text", "of_g2", "own", "window"),
    [
        (f"-g1-{Q}/20/(1/2-g2)", lambda y: -1 / (10 - 20 * y), 1, 1),
        *seldom((f"-{Q}*(1+2*g2^2)", lambda y: -1 - 2 * y * y, 0, 0)),
    ],
)
def test_a_motion_from_the_equator_that_is_not_periodic_is_enclosed(text, of_g2, own, window):
    """At the start g2 is 0 to some digits only, and V has a value there all the same."""
    asked = problem(2, expression(text), start={"at": "equator", "s_sign": -1}, window=window)
    found = solve_document(json.dumps({**asked, "accuracy": {"tier": "certified"}}))
    assert isinstance(found, Solved)
    with mp.workdps(DIGITS):
        height = mp.mpf(float(decode_arrays(found.samples)["g2"][1]))
        off = time_between(of_g2, mp.mpf(0), height, own=own) - mp.mpf("0.25")
    # g2 moves by more than half a unit in a unit of time.
    assert abs(off) <= 2 * found.summary["error"] < 1e-15
