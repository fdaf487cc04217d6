"""Hard problems, in the words of their list, beside quadratures that share no code with the service."""

import json
from math import factorial

import mpmath as mp
import pytest
from flint import arb, ctx

from service.jobs.records import Solved
from service.storage.codecs.packing import decode_arrays
from tests.benchmarks.hard import BITS, claim
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


def test_the_walk_names_claims_that_are_exceeded():
    told = {"value": 1.0, "error": 1e-3}
    assert claim("period", told, arb("1.0009")) == []
    assert claim("period", told, arb("0.9989")) != []
    # A radius is one too, and what is not there is a fault.
    with ctx.workprec(BITS):
        assert claim("period", {"value": "1", "radius": "1e-30"}, arb("1.00000000000000000001")) != []
    assert claim("end", {}, arb(1)) == ["end: none"]


@pytest.mark.parametrize(
    ("text", "coefficients"),
    [
        ("(exp(g2)-1)/g2", [f"1/{factorial(k + 1)}" for k in range(18)]),
        *seldom(
            (
                "sin(g2)/g2",
                [f"{(-1) ** (k // 2)}/{factorial(k + 1)}" if k % 2 == 0 else "0" for k in range(18)],
            )
        ),
    ],
)
def test_a_quotient_of_zeros_has_the_motion_of_its_series(text, coefficients):
    """Eighteen terms leave out less than 1/18!, 2e-16; what changes V by so much moves samples by less."""
    series = "+".join(f"({each})*g2^{k}" for k, each in enumerate(coefficients))
    samples, errors = [], []
    for of_g2 in (text, series):
        asked = problem(2, expression(f"-g1-{Q}/20*({of_g2})"))
        found = solve_document(json.dumps({**asked, "accuracy": {"tier": "standard"}}))
        assert isinstance(found, Solved)
        samples.append(decode_arrays(found.samples))
        errors.append(found.summary["error"])
    for name in ("p", "r", "g1", "g2", "g3"):
        assert abs(samples[0][name] - samples[1][name]).max() <= sum(errors) + 1e-15
    assert max(errors) < 1e-10
