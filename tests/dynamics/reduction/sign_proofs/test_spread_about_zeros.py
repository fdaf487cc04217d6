"""The variation of formulas about places where they divide 0 by 0, against values in many digits."""

import math

import mpmath as mp
import pytest
from flint import arb, ctx

from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.reduction.sign_proofs.neighbourhoods import spread_about_zeros
from service.dynamics.reduction.windows import REDUCTION_BITS

DIGITS = 40


def spread(text: str, centre: float, radius: float) -> float:
    with ctx.workprec(REDUCTION_BITS):
        box = [arb(0.5, radius), arb(centre, radius), arb(0.25, radius)]
        return spread_about_zeros(compile_tape(parse(text), ("g1", "g2", "g3")), box)


@pytest.mark.parametrize(
    ("text", "function", "place"),
    [
        ("sin(g2)/g2", lambda y: mp.sin(y) / y, 0.0),
        ("(exp(g2)-1-g2)/g2^2", lambda y: (mp.exp(y) - 1 - y) / y**2, 0.0),
        ("sin(g2-1/4)/(g2-1/4)", lambda y: mp.sin(y - 0.25) / (y - 0.25), 0.25),
        ("(exp(4*g2-1)-1)/sin(g2-1/4)", lambda y: (mp.exp(4 * y - 1) - 1) / mp.sin(y - 0.25), 0.25),
    ],
)
@pytest.mark.parametrize("radius", [1e-2, 1e-5])
def test_a_quotient_of_zeros_varies_by_its_slope_times_a_few_boxes(text, function, place, radius):
    centre = place + 0.3 * radius
    with mp.workdps(DIGITS):
        values = [function(mp.mpf(centre) + mp.mpf(radius) * k / 9) for k in range(-9, 10)]
        seen = float(max(values) - min(values))
    # Intervals of numerator and denominator are as wide as the box, with derivatives of at most 4^k/k! here.
    assert seen <= spread(text, centre, radius) <= 100 * radius


@pytest.mark.parametrize("text", ["cos(g2)/g2", "g1*sin(g2)/g2^2", "log(abs(g2))", "(g2+1e-12)/g2"])
def test_where_there_is_no_limit_nothing_is_told(text):
    assert math.isnan(spread(text, 1e-4, 1e-2))


def test_nothing_is_told_of_a_box_without_a_zero():
    assert math.isnan(spread("sin(g2)/g2", 0.5, 1e-2))
