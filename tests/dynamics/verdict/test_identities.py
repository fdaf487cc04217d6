"""The exact route proves what is true in many disguises, and never what is only nearly true."""

from itertools import islice

import pytest
from flint import ctx

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.verdict.proofs.proof import prove
from service.dynamics.verdict.sphere.boxes import fine_sphere_points
from tests.dynamics.verdict.formulas import body, potential
from tests.dynamics.verdict.identities import FALSE, NUMBERS, POWERS_AND_EXPONENTIALS, ROOTS, TRIGONOMETRIC
from tests.support.effort import one_in

TRUE = [*TRIGONOMETRIC, *NUMBERS, *ROOTS, *POWERS_AND_EXPONENTIALS]
BALLS = BallAlgebra()


def is_proved(left, right, alpha=2):
    # The factor is not admissible, and has no symmetry that could hide a wrong sign in an octant.
    on = body(alpha)
    return prove(on, potential(f"(g3 + 2*g2)*(({left}) - ({right}))", on).tape) is not None


def differences(left, right):
    """Return left - right in balls at points all over the sphere where both have values."""
    tape = compile_tape(parse(f"({left}) - ({right})"))
    with ctx.workprec(600):
        points = islice(fine_sphere_points(4), 0, None)
        values = [tape.evaluate(BALLS, [BALLS.constant(g) for g in point]) for point in points]
        return [value for value in values if value.is_finite()]


@pytest.mark.one_in(4)
@pytest.mark.parametrize(("left", "right"), TRUE)
def test_identities_are_proved(left, right):
    found = differences(left, right)
    assert found
    assert all(value.contains(0) for value in found)
    assert is_proved(left, right)


@pytest.mark.one_in(4)
@pytest.mark.parametrize(("left", "right"), FALSE)
def test_what_holds_nearly_or_on_a_part_of_the_sphere_is_not_proved(left, right):
    assert any(not value.contains(0) for value in differences(left, right))
    assert not is_proved(left, right)


@pytest.mark.parametrize(("left", "right"), one_in(4, TRUE))
@pytest.mark.parametrize("change", ["*(1 + 1e-40)", "+ 1e-40*g2", "+ 1e-40*sqrt(2)*sin(g1)"])
def test_identities_that_are_missed_by_little_are_not_proved(left, right, change):
    assert not is_proved(left, f"({right}){change}")


@pytest.mark.parametrize(
    ("left", "right", "region", "sign"),
    [
        ("abs(g1 - g3)", "g1 - g3", "g1 - g3", 1),
        ("abs(g1 - g3)", "g3 - g1", "g1 - g3", -1),
        ("sqrt((g1 + g2)^2)", "g1 + g2", "3*g1 + 3*g2", 1),
        ("abs(g1)", "g1", "g1", 1),
        ("abs(g1)", "-g1", "g1", -1),
        ("log((g1 - g3)^2)", "2*log(g1 - g3)", "(g1 - g3)*(2 + g2)", 1),
        ("abs(sin(5*g1) - g3)", "sin(5*g1) - g3", "sin(5*g1) - g3", 1),
    ],
)
def test_a_sign_that_is_assumed_is_used_and_no_other(left, right, region, sign):
    on = body(2)
    tape = potential(f"(g3 + 2*g2)*(({left}) - ({right}))", on).tape
    assumed = compile_tape(parse(region))
    assert prove(on, tape, [(assumed, sign)]) is not None
    other = prove(on, tape, [(assumed, -sign)])
    assert other is None or "log" in right
