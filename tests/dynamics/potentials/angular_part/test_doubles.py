"""Laws of the angular part V1[F]: its own definition, closed forms, balls around the doubles."""

import math
from collections.abc import Callable
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from flint import acb, arb, ctx, fmpq
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.body import RigidBody
from service.dynamics.errors import EqualMomentsError
from service.dynamics.formula.algebras.ball import ComplexBallAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.potentials.angular_part.balls import CurveFunction, angular_balls, curve_ball
from service.dynamics.potentials.angular_part.field import curve_parameter
from tests.support.effort import examples
from tests.support.witnesses.angular_part import angular_part

Function = Callable[[np.ndarray], np.ndarray]

BODIES = [
    RigidBody(Fraction(A), None, Fraction(C))
    for A, C in (("17/10", "1"), ("3", "1"), ("3/5", "1"), ("13/10", "2"))
]
FUNCTIONS: dict[str, tuple[Function, Callable[[mpmath.mpf], mpmath.mpf]]] = {
    "exp(-w)": (lambda w: np.exp(-w), lambda w: mpmath.exp(-w)),
    "w": (lambda w: w, lambda w: w),
    "w/(1+w)": (lambda w: w / (1 + w), lambda w: w / (1 + w)),
    "sqrt(w)*sin(w)": (lambda w: np.sqrt(w) * np.sin(w), lambda w: mpmath.sqrt(w) * mpmath.sin(w)),
}
DIRECTIONS = [(0.41, 0.52), (0.7, 0.1), (-0.05, 0.6), (0.3, -0.3000001)]

bodies = pytest.mark.parametrize("body", BODIES, ids=lambda body: f"A={body.A},C={body.C}")
functions = pytest.mark.parametrize("name", FUNCTIONS)


def curve_function(text: str) -> CurveFunction:
    return CurveFunction(compile_tape(parse(text), ("w",)))


def gamma(g1: float, g3: float) -> np.ndarray:
    return np.array([g1, 0.0, g3])


def direct(
    body: RigidBody, F: Callable[[mpmath.mpf], mpmath.mpf], g1: float, g3: float, angle: mpmath.mpf
) -> mpmath.mpf:
    """Q ∫ F(|A ρ - u|^α / |C ρ - u|) du/u² from C ρ T(φ0) to Q: the definition in u."""
    A, C, alpha = (mpmath.mpf(x.numerator) / x.denominator for x in (body.A, body.C, body.alpha))
    g1, g3 = mpmath.mpf(g1), mpmath.mpf(g3)
    rho, Q = g1**2 + g3**2, A * g1**2 + C * g3**2
    start = rho * (A * mpmath.cos(angle) ** 2 + C * mpmath.sin(angle) ** 2)

    def integrand(u: mpmath.mpf) -> mpmath.mpf:
        return F(abs(A * rho - u) ** alpha / abs(C * rho - u)) / u**2

    return Q * mpmath.quad(integrand, mpmath.linspace(start, Q, 5))


@pytest.mark.one_in(4)
@functions
@bodies
def test_it_is_the_integral_over_u(body: RigidBody, name: str) -> None:
    doubles, precise = FUNCTIONS[name]
    for g1, g3 in DIRECTIONS:
        with mpmath.workdps(25):
            expected = float(direct(body, precise, g1, g3, mpmath.pi / 4))
        # Some ulp of the largest F on the path, which for these functions and points is below 10.
        assert float(angular_part(body, doubles, gamma(g1, g3))) == pytest.approx(
            expected, rel=1e-14, abs=1e-14
        )


def test_golden_value_in_doubles() -> None:
    body, at = BODIES[0], gamma(0.41, 0.52)
    # Some ulp of F = 0.6 and of w: libraries of functions differ in the last one.
    assert abs(angular_part(body, lambda w: np.exp(-w), at) + 0.041620346663238774) < 1e-15
    assert abs(curve_parameter(body, at[0], at[2]) - 0.50166324485769543854) < 1e-15


@bodies
def test_a_constant_F_gives_a_constant_and_a_multiple_of_Q(body: RigidBody) -> None:
    points = np.random.default_rng(3).uniform(-1.0, 1.0, (50, 3))
    rho = points[:, 0] ** 2 + points[:, 2] ** 2
    Q = float(body.A) * points[:, 0] ** 2 + float(body.C) * points[:, 2] ** 2
    at_reference = rho * 0.5 * float(body.A + body.C)
    values = angular_part(body, lambda w: np.full_like(w, 3.0), points)
    # Quotients of sums of squares: a few ulp of 3·A/C.
    assert np.allclose(values, 3.0 * (Q / at_reference - 1.0), rtol=0, atol=2e-14)
    assert np.allclose(angular_part(body, lambda _: np.array(3.0), points), values, rtol=0, atol=0)


@bodies
def test_another_reference_angle_is_absorbed_by_Q_times_a_function_of_rho(body: RigidBody) -> None:
    def shift(angle: float) -> float:
        at = np.array([math.cos(angle), 0.3, math.sin(angle)])
        Q = float(body.A) * at[0] ** 2 + float(body.C) * at[2] ** 2
        values = [angular_part(body, lambda w: np.exp(-w), at, reference) for reference in (0.3, 1.2)]
        return float(values[0] - values[1]) / Q

    shifts = [shift(angle) for angle in (0.2, 0.9, 1.4)]
    # The difference of two values of order 1, each right to some ulp.
    assert max(shifts) - min(shifts) < 1e-14


@settings(max_examples=examples(5, 15), deadline=None)
@given(st.sampled_from(BODIES), st.fractions(-2, 2, max_denominator=4), st.floats(0.1, 3.0))
def test_a_power_of_w_gives_a_homogeneous_function(body: RigidBody, m: Fraction, factor: float) -> None:
    def F(w: np.ndarray) -> np.ndarray:
        return w ** float(m)

    degree = 2.0 * (float(body.alpha) - 1.0) * float(m)
    at = gamma(0.5, 0.4)
    scaled = float(angular_part(body, F, factor * at))
    # w^m for |m| ≤ 2 loses some ulp, and V1 is a fraction of the largest F along the path.
    assert scaled == pytest.approx(factor**degree * float(angular_part(body, F, at)), rel=1e-13)


def test_a_kink_of_F_is_resolved() -> None:
    body, c = BODIES[0], 0.2

    def kinked(w: np.ndarray) -> np.ndarray:
        return np.abs(w - c)

    value = float(angular_part(body, kinked, gamma(0.41, 0.7)))
    with ctx.workprec(200):
        ball = angular_balls(body, curve_function("abs(w-0.2)"), 0, arb(0.41), arb(0.7), arb.pi() / 4)[0]
        # The panel with the kink is halved until it is negligible, 1e-17 of the whole.
        assert abs(value - float(ball)) < 1e-15


def test_close_to_a_pole_along_a_curve() -> None:
    # ρ → 0 with w fixed: F = F(0) all along the path but its end, of no weight, so that
    # V1 → F(0) (C ρ / u0 - 1) with u0 = ρ (A + C)/2.
    body = BODIES[0]
    g1 = np.array([1e-40, 1e-150, 1e-300])
    points = np.stack([g1, np.ones(3), g1 ** (1 / 1.7)], axis=-1)
    # What F = exp(-w) differs from F(0) by is of the order (g1/g3)² w, below 1e-30.
    assert np.allclose(angular_part(body, lambda w: np.exp(-w), points), 2 / 2.7 - 1.0, rtol=0, atol=1e-15)


def test_no_value_where_there_is_none() -> None:
    body = BODIES[0]
    assert np.isnan(angular_part(body, lambda w: np.exp(-w), gamma(0.0, 0.5)))
    with np.errstate(invalid="ignore"):
        assert np.isnan(angular_part(body, lambda w: np.sqrt(w - 0.3), gamma(0.41, 0.52)))
    assert angular_part(body, lambda w: w, np.zeros((0, 3))).shape == (0,)
    with pytest.raises(EqualMomentsError):
        angular_part(RigidBody(Fraction(2), None, Fraction(2)), lambda w: w, gamma(0.3, 0.4))


@pytest.mark.one_in(4)
@functions
@bodies
def test_balls_hold_the_exact_values(body: RigidBody, name: str) -> None:
    function = curve_function(name)
    for g1, g3 in DIRECTIONS:
        balls = []
        for bits in (100, 300):
            with ctx.workprec(bits):
                angle = arb.pi() / 4
                balls.append(angular_balls(body, function, 2, arb(g1), arb(g3), angle))
        for coarse, fine in zip(*balls, strict=True):
            assert coarse.overlaps(fine)
            # 8 bits for the ends of the path, and as many as the largest value on it has: θ²F is
            # some 100 times V1 for the sine.
            assert fine.rad() < arb(2) ** -270 * (1 + abs(fine))
        doubles = angular_part(body, FUNCTIONS[name][0], gamma(g1, g3))
        assert float(doubles) == pytest.approx(float(balls[1][0]), rel=1e-14, abs=1e-14)


def test_a_wide_ball_holds_the_values_inside() -> None:
    body, function = BODIES[2], curve_function("w/(1+w)")
    with ctx.workprec(120):
        angle = arb.pi() / 4
        wide = angular_balls(body, function, 0, arb(0.4, 0.01), arb(0.5, 0.01), angle)[0]
        for g1 in (0.391, 0.409):
            for g3 in (0.491, 0.509):
                assert wide.contains(angular_balls(body, function, 0, arb(g1), arb(g3), angle)[0])
        assert curve_ball(body, arb(0.4, 0.01), arb(0.5, 0.01)).contains(curve_ball(body, arb(0.4), arb(0.5)))


@pytest.mark.parametrize("text", ["sqrt(w-1/2)", "log(-w)", "sqrt(w-1/2)*sqrt(w-1/2)", "1/(w-7/10)"])
def test_balls_are_nan_where_F_has_no_real_value_on_the_path(text: str) -> None:
    # w goes from 0.40 to 0.98: complex roots must not cancel to something real, poles must be seen.
    with ctx.workprec(100):
        value = angular_balls(BODIES[0], curve_function(text), 0, arb(0.4), arb(0.7), arb.pi() / 4)[0]
        assert not value.is_finite()
        axis = angular_balls(BODIES[0], curve_function("w"), 0, arb(0, 0.1), arb(0.7), arb.pi() / 4)[0]
        assert axis.is_nan()


@pytest.mark.parametrize(
    "text", ["w^3+2/w-pi", "sqrt(w)^3", "exp(sin(w))*cos(w)/tan(w)", "w^w", "abs(-w)^(1/3)"]
)
def test_complex_balls_continue_the_real_ones(text: str) -> None:
    function = curve_function(text)
    for w in (fmpq(1, 3), fmpq(7, 2)):
        real = function.ball(arb(w), 2)
        for analytic in (False, True):
            values = function.complex_ball(acb(arb(w)), 2, analytic=analytic)
            assert all(value.real.overlaps(expected) for value, expected in zip(values, real, strict=True))
            assert all(value.imag.contains(0) for value in values)


def test_complex_balls_are_not_finite_across_a_cut() -> None:
    analytic, plain = ComplexBallAlgebra(analytic=True), ComplexBallAlgebra(analytic=False)
    across, imaginary = acb(arb(-1), arb(0, 0.1)), acb(arb(0, 0.1), arb(1))
    for name, ball in (("log", across), ("abs", imaginary), ("sign", imaginary)):
        assert not analytic.call(name, ball).is_finite()
        assert plain.call(name, ball).is_finite()
    for exponent in (Fraction(1, 2), Fraction(-1, 2), Fraction(1, 3)):
        assert not analytic.power(across, exponent).is_finite()
        assert plain.power(across, exponent).is_finite()
