"""Stability along the windows of an atlas: against a closed form, and what is told where there is none."""

import json
from fractions import Fraction

from flint import ctx

from service.verdicts.questions import examine_atlas
from workers.computation.atlases import with_stability
from workers.solvers.stability.monodromy import transverse_stability

LINEAR = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "expression", "expression": "-g1"},
    "lambda": ["1/2", 2],
    "samples": 9,
    "outputs": ["stability"],
}


def windows_with_stability(document):
    text = json.dumps(document)
    atlas = json.loads(with_stability(text, examine_atlas(text)))["verdict"]
    return [(part["samples"]["lambda"], w) for part in atlas["parts"] for w in part["samples"]["windows"]]


def test_traces_are_those_of_lame():
    """V = a g1 and A = 2C: the transverse equation is that of Lamé, whose multipliers are theta functions."""
    ((lambdas, window),) = windows_with_stability(LINEAR)
    found = window["stability"]
    assert found["reason"] == [None] * len(lambdas)
    for k, lambda_ in enumerate(lambdas):
        with ctx.workprec(128):
            closed = transverse_stability(Fraction(lambda_) ** 2, Fraction(3, 2))
            trace = float(closed.trace)
        # Some roundings beside the error that is told: the closed form is rounded to a double.
        assert abs(found["trace"][k] - trace) <= found["trace_error"][k] + 1e-14
        assert found["verdict"][k] == closed.stability
        (one, other) = (complex(*each) for each in found["multipliers"][k])
        # μ is a root of μ² - trace μ + 1 = 0.
        assert abs(one * other - 1.0) <= 2.0 * abs(one) * found["multipliers_error"][k] + 1e-14
        assert abs(one + other - found["trace"][k]) <= 2.0 * found["multipliers_error"][k] + 1e-14


def test_a_window_that_is_not_periodic_has_no_multipliers():
    document = {
        **LINEAR,
        "body": {"A": 3, "B": "5/2", "C": 2},
        "potential": {"type": "expression", "expression": "-(3*g1^2+2*g3^2)*(g2+3)"},
        "lambda": ["9/10", 1],
    }
    ((_, window),) = windows_with_stability(document)
    assert (window["kind"], window["stability"]) == ("pole", None)
