"""What every potential gives: value, gradient, D and H, in doubles and in balls."""

from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import given
from hypothesis import strategies as st

from service.dynamics.body import RigidBody
from service.dynamics.errors import EqualMomentsError
from service.dynamics.potentials.families.coefficients import gravity_potential, rational_potential
from service.dynamics.potentials.families.written import expression_potential, general_potential
from service.dynamics.potentials.potential import Notice, Potential
from tests.support.formulas import POTENTIALS

BODY = RigidBody(Fraction(2), None, Fraction(1))
EXPRESSIONS = [expression_potential(text, {}, BODY) for text in POTENTIALS]
GRAVITY = gravity_potential(Fraction(-1), Fraction(1, 3), Fraction(0))
RATIONAL = rational_potential([Fraction(1, n) for n in range(1, 5)], [Fraction(1, 50)], [Fraction(-1, 3)] * 3)
GENERAL = general_potential(BODY, "exp(-w)", "g2^3 - sin(g2)", {})
FORMULAS = [*EXPRESSIONS, GRAVITY, RATIONAL]
ALL = [*FORMULAS, GENERAL]

GAMMA = np.random.default_rng(7).uniform(0.1, 1.0, (4, 5, 3))

potentials = pytest.mark.parametrize("potential", ALL, ids=lambda potential: potential.formula()[:30])
formulas = pytest.mark.parametrize("potential", FORMULAS, ids=lambda potential: potential.formula()[:30])


@potentials
def test_shapes_follow_the_points(potential: Potential) -> None:
    for gamma in (GAMMA, GAMMA[0], GAMMA[0, 0], GAMMA[:0]):
        shape = gamma.shape[:-1]
        assert potential.value(gamma).shape == shape
        assert potential.gradient(gamma).shape == gamma.shape
        assert potential.hessian(gamma).shape == (*gamma.shape, 3)
        assert potential.D(gamma).shape == shape
        assert potential.H(BODY, gamma).shape == shape
    assert potential.D_real(GAMMA[..., 0], GAMMA[..., 1], GAMMA[..., 2]).shape == (4, 5)


@potentials
def test_one_point_and_many_agree(potential: Potential) -> None:
    single = np.array([[potential.value(g) for g in row] for row in GAMMA])
    gradients = np.array([[potential.gradient(g) for g in row] for row in GAMMA])
    # The C library's and numpy's functions may differ by an ulp in each term; the terms of the
    # rational potentials reach 10^4 times their sum at these points.
    assert np.allclose(potential.value(GAMMA), single, rtol=1e-13, atol=1e-11)
    assert np.allclose(potential.gradient(GAMMA), gradients, rtol=1e-13, atol=1e-10)


@potentials
def test_D_turns_about_the_second_axis(potential: Potential) -> None:
    gradient = potential.gradient(GAMMA)
    D = GAMMA[..., 0] * gradient[..., 2] - GAMMA[..., 2] * gradient[..., 0]
    # As above: the same terms in another order.
    assert np.allclose(potential.D(GAMMA), D, rtol=1e-12, atol=1e-9)


@pytest.mark.one_in(4)
@potentials
def test_balls_hold_the_exact_values(potential: Potential) -> None:
    for gamma in GAMMA.reshape(-1, 3):
        point = [arb(float(x)) for x in gamma]
        with ctx.workprec(200):
            value, D, H = (
                potential.value_ball(*point),
                potential.D_ball(*point),
                potential.H_ball(BODY, *point),
            )
        with ctx.workprec(64):
            # A coarse ball at the same point must meet the fine one.
            assert potential.value_ball(*point).overlaps(value)
            assert potential.D_ball(*point).overlaps(D)
            assert potential.H_ball(BODY, *point).overlaps(H)
        for fine, double in [
            (value, potential.value(gamma)),
            (D, potential.D(gamma)),
            (H, potential.H(BODY, gamma)),
        ]:
            assert fine.rad() < arb("1e-40") * (1 + abs(fine))
            assert float(double) == pytest.approx(float(fine), rel=1e-11, abs=1e-9)


@potentials
def test_the_jet_holds_value_gradient_and_hessian(potential: Potential) -> None:
    for gamma in GAMMA[0]:
        with ctx.workprec(200):
            value, first, second = potential.jet_ball(*(arb(float(x)) for x in gamma))
            assert value.overlaps(potential.value_ball(*(arb(float(x)) for x in gamma)))
        # As above; a second derivative of the rational ones has larger terms still.
        assert potential.gradient(gamma) == pytest.approx([float(x) for x in first], rel=1e-11, abs=1e-8)
        expected = np.array([[float(x) for x in row] for row in second])
        assert potential.hessian(gamma) == pytest.approx(expected, rel=1e-10, abs=1e-6)


@potentials
def test_the_jet_is_the_derivative_of_the_values(potential: Potential) -> None:
    with ctx.workprec(400):
        centre = [arb(float(x)) for x in GAMMA[1, 1]]
        _, first, second = potential.jet_ball(*centre)
        step = arb(2) ** -60
        for axis in range(3):
            around = []
            for sign in (1, -1):
                moved = list(centre)
                moved[axis] += sign * step
                around.append(potential.jet_ball(*moved))
            ahead, behind = around
            # Central differences: step²/6 times a third derivative, far below 10^10.
            bound = arb("1e-25")
            assert abs((ahead[0] - behind[0]) / (2 * step) - first[axis]) < bound
            for other in range(3):
                slope = (ahead[1][other] - behind[1][other]) / (2 * step)
                assert abs(slope - second[axis][other]) < bound


def test_notices_are_kept_and_do_not_make_a_difference() -> None:
    notice = Notice("surprise", "a remark", "/potential")
    with_notice = Potential.from_tree(GRAVITY.tree, GRAVITY.family, (notice,))
    assert with_notice.notices == (notice,)
    assert with_notice == GRAVITY
    assert GRAVITY.notices == ()


def test_H_is_the_definition() -> None:
    body = RigidBody(Fraction(3), None, Fraction(2))
    g1, g3 = GAMMA[..., 0], GAMMA[..., 2]
    for potential in ALL:
        Q = 3 * g1**2 + 2 * g3**2
        expected = potential.value(GAMMA) + Q * potential.D(GAMMA) / (2 * g1 * g3)
        # Two further multiplications and a sum.
        assert np.allclose(potential.H(body, GAMMA), expected, rtol=1e-13, atol=1e-10)


def test_H_of_V2_terms_vanishes_for_every_body() -> None:
    # V = Q G(g2) has H = 0: no energy is fixed by it.
    for A, C in ((3, 1), (1, 3), (17, 10)):
        body = RigidBody(Fraction(A), None, Fraction(C))
        potential = expression_potential("(A*g1^2 + C*g3^2)*(g2^3 - 1/2 + sin(g2))", {}, body)
        # V is below 60 and H is its difference from an equal number.
        assert np.abs(potential.H(body, GAMMA)).max() < 60 * 8 * np.finfo(float).eps


def test_H_has_no_value_on_the_planes() -> None:
    gamma = np.array([[0.0, 0.6, 0.8], [0.8, 0.6, 0.0], [0.0, 1.0, 0.0]])
    assert np.isnan(GRAVITY.H(BODY, gamma)).all()
    assert np.isfinite(GRAVITY.D(gamma)).all()


def test_H_needs_two_different_moments() -> None:
    body = RigidBody(Fraction(1), None, Fraction(1))
    with pytest.raises(EqualMomentsError):
        GRAVITY.H(body, GAMMA)
    with pytest.raises(EqualMomentsError):
        GRAVITY.H_ball(body, arb(1), arb(1), arb(1))


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1))
def test_gravity_is_linear(g1: float, g2: float, g3: float) -> None:
    potential = gravity_potential(Fraction(2), Fraction(-3), Fraction(1, 2))
    gamma = np.array([g1, g2, g3])
    # Three products and two sums of numbers below 3.
    assert float(potential.value(gamma)) == pytest.approx(2 * g1 - 3 * g2 + g3 / 2, abs=4e-15)
    assert potential.gradient(gamma).tolist() == [2.0, -3.0, 0.5]
    assert potential.gradient(gamma[None]).tolist() == [[2.0, -3.0, 0.5]]


def test_gravity_prints_as_a_formula() -> None:
    assert (
        gravity_potential(Fraction(-1), Fraction(1, 3), Fraction(-3, 2)).formula() == "-g1 + 1/3*g2 - 1.5*g3"
    )
    assert gravity_potential(Fraction(0), Fraction(0), Fraction(0)).formula() == "0"
    assert gravity_potential(Fraction(-2), Fraction(0), Fraction(0)).formula() == "-2*g1"


@formulas
def test_the_formula_is_the_potential(potential: Potential) -> None:
    assert expression_potential(potential.formula(), {}, BODY).tape == potential.tape
