"""Discs contain what complex balls of many bits say at every point of the discs that go in."""

import math
from fractions import Fraction

import numpy as np
import pytest
from flint import acb, arb, ctx
from hypothesis import given, reject, settings
from hypothesis import strategies as st

from service.dynamics.errors import FormulaError
from service.dynamics.formula.algebras.ball import ComplexBallAlgebra
from service.dynamics.formula.algebras.discs import Disc, DiscAlgebra
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from tests.support.effort import examples
from tests.support.trees import VARIABLES, trees_of_variables

TREES = trees_of_variables("+-*/^")
RADII = st.sampled_from([0.0, 1e-18, 1e-9, 1e-3, 0.1, 0.7])
DISCS = st.tuples(st.floats(-3.0, 3.0) | st.floats(-800.0, 800.0), RADII)
PLACES = st.tuples(st.sampled_from([0.0, 0.5, 1.0]), st.floats(0.0, 2.0 * math.pi))
"""A share of the radius and an angle: mostly the circle, where an analytic function is largest."""


def point_of(disc, place):
    """A complex ball within the disc, certainly: its own radius is taken off."""
    (centre, radius), (share, angle) = disc, place
    away = arb(radius) * arb(share) * (1 - arb(2) ** -100)
    return acb(arb(centre) + away * arb(angle).cos(), away * arb(angle).sin())


def in_balls(tape, points):
    jets = FirstOrderJets(ComplexBallAlgebra(analytic=True), 2)
    found = tape.evaluate(jets, jets.variables(points))
    return (found.value, *jets.gradient(found))


@np.errstate(all="ignore")
def in_discs(tape, discs):
    algebra = DiscAlgebra()
    jets = FirstOrderJets(algebra, 2)
    found = tape.evaluate(jets, jets.variables([Disc(np.array([c, c]), np.array([r, r])) for c, r in discs]))
    return (found.value, *jets.gradient(found))


@given(TREES, st.tuples(DISCS, DISCS), st.lists(st.tuples(PLACES, PLACES), min_size=1, max_size=4))
@settings(max_examples=examples(40, 250), deadline=None)
def test_value_and_slopes_at_every_point_are_in_the_discs(tree, discs, places):
    try:
        tape = compile_tape(tree, VARIABLES)
    except FormulaError:
        reject()
    found = in_discs(tape, discs)
    for place in places:
        with ctx.workprec(400):
            exact = in_balls(tape, [point_of(disc, at) for disc, at in zip(discs, place, strict=True)])
            for ball, disc in zip(exact, found, strict=True):
                centre, radius = float(disc.centre.flat[-1]), float(disc.radius.flat[-1])
                if ball.is_finite() and math.isfinite(centre) and math.isfinite(radius):
                    assert not abs(ball - centre) > radius, (tape, disc)


@pytest.mark.parametrize(
    ("text", "at"),
    [
        ("x^2", 1.25),
        ("x^3", 1.25),
        ("x^40", 1.25),
        ("x^(-1)", 0.75),
        ("x^(-3)", 0.75),
        ("sqrt(x)", 0.75),
        ("x^(-1/3)", 0.75),
        ("x^(7/3)", 1.25),
        ("exp(x)", 1.25),
        ("exp(100*x)", 1.25),
        ("log(x)", 0.75),
        ("2/x", 0.75),
    ],
)
def test_a_single_operation_has_its_very_radius(text, at):
    """The disc of radius 1/4 about 1 is mapped to a curve that touches the disc found where z is ``at``."""
    tape = compile_tape(parse(text), VARIABLES)
    found, *_ = in_discs(tape, [(1.0, 0.25), (1.0, 0.0)])
    with ctx.workprec(200):
        value = in_balls(tape, [acb(arb(at)), acb(1)])[0]
        reached = float(abs(value - in_balls(tape, [acb(1), acb(1)])[0]))
    # Rounding adds most to x^(7/3), whose exponent is no double: 3e-12 of the value. exp drops e^-25.
    assert reached <= found.radius.flat[0] <= reached * (1.0 + 1e-10)


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_a_sine_grows_along_the_imaginary_axis_as_its_disc_does(name):
    """The disc of sin(iy) = i sinh y about 0 has the very radius; so has that of cos about π/2, rounded."""
    shift = 0.0 if name == "sin" else 0.5 * math.pi
    found, *_ = in_discs(compile_tape(parse(f"{name}(x)"), VARIABLES), [(shift, 2.0), (1.0, 0.0)])
    assert found.radius.flat[0] == pytest.approx(math.sinh(2.0), rel=1e-12)


@pytest.mark.parametrize(
    "text",
    ["1/x", "log(x)", "sqrt(x)", "tan(8*x)", "x^(-2)", "x^y", "abs(x)", "abs(x)/x", "log(y - 2)", "y/(x*y)"],
)
def test_where_a_function_may_not_be_analytic_nothing_is_claimed(text):
    tape = compile_tape(parse(text), VARIABLES)
    value, *_ = in_discs(tape, [(0.125, 0.25), (1.0, 0.25)])
    assert not np.isfinite(value.radius).any()


def test_an_absolute_value_is_analytic_beside_its_kink():
    value, slope, _ = in_discs(compile_tape(parse("abs(x)"), VARIABLES), [(-1.0, 0.25), (1.0, 0.0)])
    assert value.centre.flat[0] == 1.0
    assert value.radius.flat[0] == 0.25
    assert slope.centre.flat[0] == -1.0
    assert slope.radius.flat[0] <= 1e-15


@pytest.mark.parametrize("text", ["exp(1000*x)", "x^(1/3) - 10^400*x", "exp(exp(9*x))", "x*10^308*100"])
def test_what_is_beyond_the_doubles_has_no_bound(text):
    value, *_ = in_discs(compile_tape(parse(text), VARIABLES), [(1.0, 0.5), (1.0, 0.0)])
    assert not np.isfinite(DiscAlgebra().bound(value)).any()


def test_a_narrow_wall_is_seen_from_beside_it():
    """exp(−10⁶ (x − 3/10)²) on the disc of radius 1/10 about 2/5: its maximum over the real part is 1."""
    value, *_ = in_discs(compile_tape(parse("exp(-10^6*(x - 3/10)^2)"), VARIABLES), [(0.4, 0.1), (1.0, 0.0)])
    assert DiscAlgebra().bound(value).flat[0] >= 1.0


def test_constants_are_enclosed():
    algebra = DiscAlgebra()
    for value in (Fraction(1, 3), Fraction(10) ** 30 + 1, Fraction(1, 10**400), Fraction(5, 2)):
        found = algebra.constant(value)
        assert abs(Fraction(float(found.centre)) - value) <= Fraction(float(found.radius))
    assert algebra.constant(Fraction(5, 2)).radius == 0.0
