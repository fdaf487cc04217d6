"""The windows of many curves found together are those of each curve alone."""

from fractions import Fraction

import pytest

from service.dynamics.errors import DynamicsError
from service.dynamics.potentials.families.written import general_potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.windows import find_windows, find_windows_together
from tests.support.admissible import sampled_cases
from tests.support.planar import body, formula

DOUBLE, GENERAL, MIRRORED = (2, 1), ("17/10", 1), (1, "17/10")
Q = "(A*g1^2+C*g3^2)"
CURVES = [
    *(PlanarMotion(Fraction(k, 7)) for k in (2, 5, 7, 8, 20)),
    PlanarMotion(Fraction(4, 5), g1_sign=-1),
    PlanarMotion(Fraction(4, 5), g3_sign=-1),
]
TEXTS = [
    *((moments, "-g1") for moments in (DOUBLE, GENERAL)),
    *((moments, f"{Q}*(g2^2-1/2+g2^3/5)") for moments in (DOUBLE, GENERAL, MIRRORED)),
    (DOUBLE, "-g1+1/(20*g3^2)"),
    (DOUBLE, "g1-1/16/g3^2-(g1^2-g2^2)"),
    (DOUBLE, f"-{Q}*sqrt(g2-1/10)"),
    # Separatrices, and places where p² is next to 0: with a gap, without one, and next to another zero.
    (DOUBLE, "-g1+(1+sqrt(5))/4*(g1^2-g2^2)"),
    (DOUBLE, "-g1+(1+sqrt(5))/4*(1-exp(-50))*(g1^2-g2^2)"),
    (GENERAL, f"{Q}*((g2-1/3)^2+exp(-300))*(g2-2)"),
    (GENERAL, f"{Q}*((g2-1/3)^2-1/10^8)*(g2-2)"),
    (MIRRORED, f"{Q}*((g2-1/3)^2-1/10^8)*(g2-2)"),
    (GENERAL, f"{Q}*((g2-1/3)^2+1/10^9)*(g2-1/3-1/50)"),
    (GENERAL, f"{Q}*sin(60*g2)"),
]


def described(windows):
    return [
        (
            (window.index, window.kind, window.ends, window.g1, window.g2),
            [(arc.lower_end, arc.upper_end, len(arc.slow)) for arc in window.arcs],
        )
        for window in windows
    ]


def enclosures(windows):
    arcs = [arc for window in windows for arc in window.arcs]
    near = [ball for arc in arcs for rest in arc.slow for ball in (rest.v, rest.square, rest.K)]
    return [ball for arc in arcs for ball in (arc.lower, arc.upper, arc.loop.Z, arc.loop.G)] + near


def alone(rigid_body, potential, motion):
    try:
        return find_windows(rigid_body, potential, motion)
    except DynamicsError as refusal:
        return refusal


def assert_the_same(rigid_body, potential, motions):
    for motion, found in zip(motions, find_windows_together(rigid_body, potential, motions), strict=True):
        expected = alone(rigid_body, potential, motion)
        if isinstance(expected, DynamicsError):
            assert (type(found), str(found)) == (type(expected), str(expected))
            continue
        assert described(found) == described(expected)
        for one, other in zip(enclosures(found), enclosures(expected), strict=True):
            assert one.overlaps(other)
            # Neither is wider than the other's rounding: a ball's radius is proved up to a factor of 4.
            assert one.rad() <= 4 * other.rad()
            assert other.rad() <= 4 * one.rad()


@pytest.mark.one_in(4)
@pytest.mark.parametrize(("moments", "text"), TEXTS)
def test_the_windows_are_those_of_each_curve_alone(moments, text):
    rigid_body = body(*moments)
    assert_the_same(rigid_body, formula(text, rigid_body), CURVES)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("case", sampled_cases(10, 17), ids=str)
def test_random_potentials_have_the_same_windows_either_way(case):
    rigid_body = body(case.A, case.C)
    motions = [PlanarMotion(Fraction(k, 10)) for k in (3, 11, 40)]
    assert_the_same(rigid_body, formula(case.text, rigid_body), [case.motion, *motions])


def test_a_refusal_is_that_of_its_own_curve():
    """With nu, which has a meaning for A = 2C only, no curve of the list has a loop."""
    rigid_body = body(*GENERAL)
    motions = [PlanarMotion(Fraction(1)), PlanarMotion(None, nu=Fraction(1)), PlanarMotion(Fraction(2))]
    assert_the_same(rigid_body, formula(f"{Q}*(g2^2-1/2)", rigid_body), motions)


def test_near_rests_are_found_where_they_are():
    """p² is D up to a factor, here K ((g2 − 1/3)² ± ε): the place is told, and the sign of the gap."""
    rigid_body = body(*GENERAL)
    for sign in (1, -1):
        potential = formula(f"{Q}*((g2-1/3)^2+{sign}/10^10)*(g2-2)", rigid_body)
        for windows in find_windows_together(rigid_body, potential, CURVES):
            found = [near for window in windows for near in window.arcs[0].slow]
            assert found
            for near in found:
                # The other factors of p² move its lowest place by about ε.
                assert abs(float(near.at.g2) - 1 / 3) < 1e-9
                assert bool(near.square > 0) == (sign > 0)


def test_a_potential_that_is_an_integral_goes_alone():
    rigid_body = body(*GENERAL)
    potential = general_potential(rigid_body, "w^2", "g2^2", {})
    assert not potential.has_formula
    assert_the_same(rigid_body, potential, CURVES[1:3])
