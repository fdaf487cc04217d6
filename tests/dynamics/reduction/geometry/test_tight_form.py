"""The tight form of a formula has its values and its D on the sphere, and narrower bounds."""

import numpy as np
import pytest
from flint import arb, ctx

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.intervals import IntervalAlgebra
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.tight_form import tight_form
from service.dynamics.reduction.windows import find_windows
from tests.support.planar import body, formula

BODY = body(2, 1)
CAP = "(abs((g2-99/100)*1000)+(g2-99/100)*1000)"
RING = "sqrt((((g1^2+g3^2)-4/5)/(1/10^6))^2)"
FORMULAS = [
    f"-g1 + (2*g1^2+g3^2)*{CAP}^2",
    f"-g1 + (2*g1^2+g3^2)*{RING}/1000",
    "g1*(g2-1/2-abs(g2-1/2)) + exp(g1^2+g3^2)/(3+2*g1^2+2*g3^2)",
    "(abs(g1-g3)+g1-g3)^3 + abs(g2)-g2 + (1-g1^2-g3^2)^(3/2)*g2^2/(1-g2^2)",
    "tan(g2)*(g1^2+g2^2+g3^2)^(1/3)",
]


@pytest.mark.parametrize("text", FORMULAS)
def test_the_values_and_the_derivative_around_the_second_axis_are_those_of_the_formula(text):
    tape = formula(text, BODY).tape
    draws = np.random.default_rng(5)
    jets = FirstOrderJets(BallAlgebra(), 1)
    with ctx.workprec(200):
        for _ in range(20):
            g = [arb(x) for x in draws.normal(size=3).tolist()]
            size = sum((x * x for x in g), arb(0)).sqrt()
            g1, g2, g3 = (x / size for x in g)
            seeds = [jets.seed(g1, (-g3,)), jets.seed(g2, (None,)), jets.seed(g3, (g1,))]
            old, new = (each.evaluate(jets, seeds) for each in (tape, tight_form(tape)))
            assert old.value.overlaps(new.value)
            D, E = (each.first[0] or arb(0) for each in (old, new))
            # 200 bits, of which a slope of 1e9 takes some 30.
            assert abs(D - E) < arb(2) ** -120


def bounds(tape, low, high):
    algebra = IntervalAlgebra([])
    ends = [(-0.6, 0.6), (low, high), (0.1, 0.6)]
    found = tape.evaluate(algebra, [algebra.interval(np.array([a]), np.array([b])) for a, b in ends])
    return tuple(float(end.item()) for end in algebra.bounds(found))


def test_what_vanishes_below_a_height_is_bounded_by_0_there():
    tape = formula(CAP, BODY).tape
    assert bounds(tape, -0.9, 0.9)[1] > 1000.0
    low, high = bounds(tight_form(tape), -0.9, 0.9)
    # TINY of the rounding outwards.
    assert -1e-300 < low <= 0.0 <= high < 1e-300


@pytest.mark.parametrize(("feature", "number"), [(f"{CAP}^2", 2), (f"{RING}/10^9", 1)])
def test_windows_beside_steep_caps_and_rings_are_settled(feature, number):
    # p² = 1/2 - g3² f for V = -g1 + Q f: the cap has f up to 400, but at the pole g3 is 0, so that
    # a pocket is left there; the ring has f < 1e-3, and no wall.
    assert len(find_windows(BODY, formula(f"-g1 + (2*g1^2+g3^2)*{feature}", BODY), PlanarMotion(1))) == number
