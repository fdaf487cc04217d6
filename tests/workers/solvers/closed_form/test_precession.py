from fractions import Fraction

import pytest
from flint import arb, ctx

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import make_loop
from tests.support.planar import body, formula
from tests.support.witnesses.precession import precession, precession_by_integral


def loop(A, C, motion):
    rigid_body = body(A, C)
    return make_loop(rigid_body, formula("0", rigid_body), motion)


GOLDEN = {
    "0.1": "5.5120364721307221375370458444",
    "0.3": "4.90615247386710676772094889683",
    "1": "3.61050523508724966610354854487",
    "2": "2.50524535133020938452501058026",
    "10": "0.620644992774347028932194165871",
}


@pytest.mark.parametrize("nu", GOLDEN)
def test_golden_angles(nu):
    printed = GOLDEN[nu]
    with ctx.workprec(128):
        found = precession(loop(2, 1, PlanarMotion(None, nu=Fraction(nu)))).psi1
        # All printed digits, the last of which is rounded.
        assert abs(found - arb(printed)) < arb(10) ** -len(printed.split(".")[1])
        assert found.rel_accuracy_bits() > 110


@pytest.mark.parametrize("nu", ["1e-3", "1", "-2", "50"])
def test_elliptic_integrals_are_the_integrals(nu):
    with ctx.workprec(80):
        at = loop(2, 1, PlanarMotion(None, nu=Fraction(nu)))
        closed, integral = precession(at), precession_by_integral(at)
        assert closed.psi1.overlaps(integral.psi1)
        assert closed.psi3.overlaps(integral.psi3)
        assert integral.psi1.rad() < 1e-17


@pytest.mark.parametrize(
    ("A", "C", "lambda_"),
    [("3", 1, "0.8"), ("1.7", 1, "1.2"), ("4", 1, "0.9"), (3, 5, "1.2"), (1, 2, "1.1"), (10, 1, "2")],
)
def test_the_axes_differ_by_a_turn(A, C, lambda_):
    """Two independent integrals: the third axis turns once more about the fixed vector than the first."""
    with ctx.workprec(80):
        found = precession_by_integral(loop(A, C, PlanarMotion(Fraction(lambda_))))
        assert (found.psi1 - found.psi3 - 2 * arb.pi()).contains(0)
        assert found.psi1.rad() < 1e-17
        assert found.psi3.rad() < 1e-17


def test_mirror_images_and_directions_turn_the_other_way():
    with ctx.workprec(64):
        one = precession(loop(3, 1, PlanarMotion(Fraction(1))))
        mirrored = precession(loop(3, 1, PlanarMotion(Fraction(1), g1_sign=-1)))
        back = precession(loop(3, 1, PlanarMotion(Fraction(1))), direction=-1)
        for other in (mirrored, back):
            assert (one.psi1 + other.psi1).contains(0)
            assert (one.psi3 + other.psi3).contains(0)


def test_exchanged_axes():
    """(A, C; g1, g3) → (C, A; g3, g1) is a mirror image of the body: λ^(C/A) is 1/λ there."""
    with ctx.workprec(64):
        one = precession(loop(2, 1, PlanarMotion(Fraction(2))))
        other = precession(loop(1, 2, PlanarMotion(Fraction(1, 4))))
        assert one.psi1.overlaps(-other.psi3)
        assert one.psi3.overlaps(-other.psi1)


@pytest.mark.parametrize(("A", "lambda_"), [(3, "1e-6"), (3, "1e6"), (5, "1e-12"), (1000, "1")])
def test_extreme_curves_keep_their_digits(A, lambda_):
    """g1 ≈ 1 makes no difference to the first axis but the turn: ψ3 = O(λ), and ψ1 = O(G) at g3 ≈ 1."""
    with ctx.workprec(64):
        at = loop(A, 1, PlanarMotion(Fraction(lambda_)))
        found = precession(at)
        smaller = found.psi3 if at.G > at.Z else found.psi1
        assert smaller.rel_accuracy_bits() > 48
        assert abs(smaller) < 8 * (at.Z if at.G > at.Z else A * at.G)
        assert (found.psi1 - found.psi3 - 2 * arb.pi()).contains(0)
