from fractions import Fraction

import pytest

from service.dynamics.errors import DynamicsError
from service.dynamics.problem import PlanarMotion, StartAtEquator, StartAtPoint, StateMotion
from tests.support.planar import body, formula
from workers.solvers.choose import enclose


def refused(text, motion, *, A=2, C=1) -> DynamicsError:
    rigid_body = body(A, C)
    with pytest.raises(DynamicsError) as refusal:
        enclose(rigid_body, formula(text, rigid_body), motion, [Fraction(1)], 64)
    return refusal.value


ON_NU_1 = PlanarMotion(None, nu=Fraction(1))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("-g1 - 1/(20*g3^2) - 1/2*(g1^2-g2^2)", "collision"),
        ("-g1 + 1/(20*g3^2) + 5/4*(g1^2-g2^2)", "equilibrium"),
        ("-g1 + (1+sqrt(5))/4*(g1^2-g2^2)", "separatrix"),
    ],
)
def test_motions_that_never_close(text, reason):
    refusal = refused(text, ON_NU_1)
    assert refusal.code == "certified_unavailable"
    assert reason in refusal.message


@pytest.mark.long
def test_a_pole_passed_without_powers():
    # −Q log(1 − g2²) is bounded there, and no power of any coordinate.
    refusal = refused("-g1 - (A*g1^2 + C*g3^2)*log(1 - g2^2)/50", PlanarMotion(Fraction(1)), A="2")
    assert refusal.code == "certified_unavailable"
    assert "analytic" in refusal.message


def test_a_motion_from_a_state():
    zero = (Fraction(0), Fraction(0), Fraction(0))
    refusal = refused("-g1", StateMotion(zero, (Fraction(1), Fraction(0), Fraction(0))))
    assert refusal.code == "certified_unavailable"
    assert refusal.pointer == "/motion/type"


def test_a_potential_that_is_not_admissible():
    refusal = refused("g1*g2 - g1 + 1/(10*g3^2)", ON_NU_1)
    assert refusal.code == "certified_unavailable"
    assert refusal.pointer == "/potential"


@pytest.mark.parametrize(
    ("text", "motion", "code"),
    [
        ("g1", ON_NU_1, "no_motion"),
        ("-g1", PlanarMotion(None, nu=Fraction(1), window=3), "no_such_window"),
        (
            "-g1",
            PlanarMotion(None, nu=Fraction(1), start=StartAtPoint(Fraction(9, 10))),
            "start_outside_window",
        ),
        ("g1 - 1/(20*g3^2) - (g1^2-g2^2)", ON_NU_1, "several_windows"),
        (
            "-g1 + 6/5*(g1^2-g2^2)",
            PlanarMotion(None, nu=Fraction(1), start=StartAtEquator()),
            "start_outside_window",
        ),
    ],
)
def test_motions_that_are_not_there_are_refused_as_by_the_reduction(text, motion, code):
    assert refused(text, motion).code == code
