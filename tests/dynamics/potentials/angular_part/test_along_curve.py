"""V1 along a curve by series against the integral that the series stand for."""

from fractions import Fraction

import pytest
from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.potentials.angular_part.along_curve import LoopCurve
from service.dynamics.potentials.families.general_solution import AlongCurve, GeneralPotential, along_curve
from service.dynamics.potentials.families.written import general_potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import Loop, make_loop

CASES = [
    (2, 1, "-exp(-w)"),
    (2, 1, "-w/(1 + w)"),
    ("17/10", 1, "log(2 + w)"),
    (3, 5, "-exp(-w)"),
    ("21/20", 1, "-sqrt(w)*(1 + w)/(1 + w)"),
]
PLACES = [1.5, 0.3, 0.05, 1e-7, 1e-20]


def loop_of(A: int | str, C: int | str, F: str, G: str = "0") -> Loop:
    body = RigidBody(Fraction(A), None, Fraction(C), allow_unphysical=True)
    potential = general_potential(body, F, G, {})
    return make_loop(body, potential, PlanarMotion(Fraction(6, 5))).refined()


def both(loop: Loop) -> tuple[AlongCurve, GeneralPotential]:
    assert isinstance(loop.potential, GeneralPotential)
    return along_curve(loop.potential, LoopCurve(loop.alpha, loop.Z, loop.G, loop.mirrored)), loop.potential


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("A", "C", "F"), CASES)
def test_series_contain_the_integral(A, C, F):
    with ctx.workprec(160):
        loop = loop_of(A, C, F)
        by_series, exact = (V.pieces[0].angular for V in both(loop))
        for v in PLACES:
            at = loop.point(arb(v))
            g1, g3 = (at.g3, at.g1) if loop.mirrored else (at.g1, at.g3)
            found, known = by_series.ball(g1, g3, 0), exact.ball(g1, g3, 0)
            assert found.value.overlaps(known.value)
            assert found.D.overlaps(known.D)
            # Half of 160 bits are wanted of the coefficients; some are lost in their sum.
            assert found.value.rad() < 2.0**-70 * (abs(known.value) + abs(known.functions[0]))
            # It is the series.
            assert known.value.rad() < found.value.rad()


def test_next_to_a_kink_the_integral_stays():
    """F has one on the way from the reference angle to every place with w > 1/10 there."""
    with ctx.workprec(96):
        loop = loop_of(2, 1, "abs(w - 1/10)")
        by_series, exact = (V.pieces[0].angular for V in both(loop))
        at = loop.point(arb(1))
        # w at the reference angle π/4, and at the same ρ, is ρ/2.
        rho = at.g1**2 + at.g3**2
        sine = (arb(1) / 5 / rho).sqrt() * arb(1).sin()
        for _ in range(20):
            at = loop.point(sine.mid().asin())
            sine = sine * (arb(1) / 5 / (at.g1**2 + at.g3**2)).sqrt()
        for v in (sine.mid().asin(), arb(1)):
            at = loop.point(v)
            assert by_series.ball(at.g1, at.g3, 0).value.overlaps(exact.ball(at.g1, at.g3, 0).value)


def test_next_to_a_zero_of_p_the_integral_is_asked():
    with ctx.workprec(160):
        loop = loop_of(2, 1, "-exp(-w)", "g2^2 - 1/2")
        along, exact = both(loop)
        v = arb(1)
        for _ in range(8):
            # Steps of the secant of P, whose zero is one of D.
            off = arb(2) ** -20
            P, Q = (loop.point(at.mid()).P.mid() for at in (v, v + off))
            v = (v - P * off / (Q - P)).mid()
        at = loop.point(v + arb(2) ** -40)
        found, known = (V.value_and_D_ball(at.g1, at.g2, at.g3)[1] for V in (along, exact))
        # The series knows V to 2^-80 about, which would be 40 bits of D.
        assert found.rel_accuracy_bits() >= 64
        assert found.overlaps(known)
