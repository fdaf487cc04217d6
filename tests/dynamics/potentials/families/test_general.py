"""Laws of the general family V1[F] + Q G: the equation, the energy, the symmetries, the motion."""

from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx, fmpq
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from service.dynamics.body import RigidBody
from service.dynamics.equations.compatibility import residual_of
from service.dynamics.equations.euler_poisson import energy_integral, euler_poisson_rhs
from service.dynamics.errors import (
    DynamicsError,
    EqualMomentsError,
    FormulaError,
    MissingMomentError,
    UnknownNameError,
)
from service.dynamics.formula.parameters import ParameterNameError
from service.dynamics.potentials.angular_part.balls import curve_ball
from service.dynamics.potentials.families.general_solution import QUADRANTS, GeneralPotential
from service.dynamics.potentials.families.written import (
    FormulaText,
    QuadrantError,
    ReferenceAngleError,
    general_potential,
)
from service.dynamics.potentials.potential import NoClosedFormError
from service.dynamics.problem import PlanarMotion
from tests.support.heyoka_integrator import HeyokaIntegrator
from tests.support.planar import body, planar
from tests.support.solving import solve_planar
from workers.solvers.errors import UnsupportedFormulaError

ODD_G = "-3*(6/10 - g2^2) + 3/10*g2"
BODIES = [body("17/10", 1, "7/5"), body(3, 1, "5/2"), body("3/5", 1, "9/10"), body("13/5", 2, "29/10")]
POINT = np.array([0.41, 0.1, 0.52])

bodies = pytest.mark.parametrize("on", BODIES, ids=lambda on: f"A={on.A},C={on.C}")
functions = pytest.mark.parametrize("F", ["w", "exp(-w)", "w/(1+w)"])


def general(
    on: RigidBody, F: FormulaText, G: FormulaText = ODD_G, angle: str = "pi/4", **parameters: Fraction
) -> GeneralPotential:
    return general_potential(on, F, G, parameters, angle)


def on_sphere(u: Fraction, v: Fraction) -> tuple[Fraction, Fraction, Fraction]:
    """The stereographic image of (u, v): a rational point of the sphere."""
    norm = 1 + u * u + v * v
    return 2 * u / norm, (2 - norm) / norm, 2 * v / norm


def ball(value: Fraction) -> arb:
    return arb(fmpq(value.numerator, value.denominator))


def test_golden_numbers() -> None:
    V = general(BODIES[0], "exp(-w)", "0")
    # Sums of some numbers below 1, in doubles.
    assert V.value(POINT) == pytest.approx(-0.041620346663238774496953810491708, abs=1e-15)
    expected = [0.3791204483482637175486383929824, 0.0, -0.25728557694380736911953880444124]
    assert V.gradient(POINT) == pytest.approx(expected, abs=1e-15)
    with ctx.workprec(200):
        g1, g2, g3 = ball(Fraction(41, 100)), ball(Fraction(1, 10)), ball(Fraction(52, 100))
        value, (first, _, third), _ = V.jet_ball(g1, g2, g3)
        # Half a unit in the last of the 32 digits printed.
        assert abs(value - arb("-0.041620346663238774496953810491708")) < arb("1e-33")
        assert abs(first - arb("0.3791204483482637175486383929824")) < arb("1e-31")
        assert abs(third - arb("-0.25728557694380736911953880444124")) < arb("1e-32")
        w = curve_ball(BODIES[0], g1, g3)
        assert abs(w - arb("0.50166324485769543854265060545731")) < arb("1e-32")


@pytest.mark.one_in(3)
@functions
@bodies
@settings(max_examples=3, deadline=None)
@given(
    u=st.fractions(Fraction(1, 10), 3, max_denominator=20),
    v=st.fractions(Fraction(1, 10), 3, max_denominator=20),
    signs=st.tuples(st.sampled_from([1, -1]), st.sampled_from([1, -1])),
)
def test_it_solves_the_equation(
    on: RigidBody, F: str, u: Fraction, v: Fraction, signs: tuple[int, int]
) -> None:
    with ctx.workprec(300):
        ball = residual_of(on, general(on, F), on_sphere(signs[0] * u, signs[1] * v))
        assert ball.residual.contains(0)
        # 300 bits are 90 digits; 30 are left for the second derivatives of w at |g1| ≥ 1/100.
        assert ball.residual.abs_upper() < arb("1e-60")


@functions
@bodies
def test_the_energy_on_a_curve_is_minus_F(on: RigidBody, F: str) -> None:
    V = general(on, F)
    with ctx.workprec(200):
        for point in (
            (Fraction(2, 7), Fraction(6, 7), Fraction(3, 7)),
            (Fraction(-6, 7), Fraction(-3, 7), Fraction(2, 7)),
        ):
            g1, g2, g3 = map(ball, point)
            expected = -V.pieces[0].angular.F.ball(curve_ball(on, g1, g3), 0)[0]
            H = V.H_ball(on, g1, g2, g3)
            assert H.overlaps(expected)
            assert H.rad() < arb("1e-50")
            # H is a difference of terms below 100 of the size of V.
            double = V.H(on, np.array([float(x) for x in point]))
            assert double == pytest.approx(float(expected), rel=1e-13, abs=1e-12)


def test_the_energy_depends_on_the_quadrant_where_F_does() -> None:
    on = BODIES[0]
    F = {"pp": "w", "mp": "-w", "pm": "exp(-w)", "mm": "1"}
    G = {"pp": "g2", "mp": "0", "pm": "log(g2)", "mm": "-g2"}
    V = general(on, F, G)
    points = np.array([[0.3, 0.5, 0.6], [-0.3, 0.5, 0.6], [0.3, 0.5, -0.6], [-0.3, 0.5, -0.6]])
    w = 0.7**0.7 * 0.6**3.4 / 0.3**2
    # Some ulp of numbers below 1.
    assert V.H(on, points) == pytest.approx([-w, w, -np.exp(-w), -1.0], abs=4e-15)
    alone = [
        general(on, F[quadrant], G[quadrant]).value(point)
        for quadrant, point in zip(QUADRANTS, points, strict=True)
    ]
    assert V.value(points).tolist() == alone
    assert np.isfinite(V.hessian(points)).all()
    on_axes = np.array([[0.0, 0.6, 0.8], [0.8, 0.6, 0.0]])
    assert np.isnan(V.value(on_axes)).all()
    assert np.isnan(V.gradient(on_axes)).all()
    assert np.isnan(V.gradient_at(0.0, 0.6, 0.8)).all()
    # Doubles of numpy and of the C library.
    assert V.gradient_at(*points[1]) == pytest.approx(V.gradient(points[1]), rel=1e-14)
    for first, third in ((arb(0, 0.1), arb(0.5)), (arb(0.5), arb(0, 0.1))):
        value, D = V.value_and_D_ball(first, arb(0.5), third)
        assert value.is_nan()
        assert D.is_nan()
        assert V.value_ball(first, arb(0.5), third).is_nan()
        assert V.jet_ball(first, arb(0.5), third)[2][1][1].is_nan()


@bodies
def test_exchanging_the_axes_changes_w_to_its_power(on: RigidBody) -> None:
    # (A, C; g1, g3) → (C, A; g3, g1) takes w to w^(-1/α) and keeps φ0 = π/4.
    mirrored = body(on.C, on.A)
    V, W = general(on, "w/(1+w)"), general(mirrored, "w^(-A/C)/(1+w^(-A/C))".replace("A/C", f"({on.alpha})"))
    points = np.random.default_rng(5).uniform(0.1, 1.0, (20, 3)) * [1, -1, 1]
    assert W.value(points[:, ::-1]) == pytest.approx(V.value(points), rel=1e-13, abs=1e-14)
    # Gradients at |g1| ≥ 0.1 are below 100.
    assert W.gradient(points[:, ::-1])[:, ::-1] == pytest.approx(V.gradient(points), rel=1e-12, abs=1e-12)


def test_mirroring_g1_or_g3_changes_nothing() -> None:
    V = general(BODIES[2], "exp(-w)")
    for mirror in ([-1, 1, 1], [1, 1, -1], [-1, 1, -1]):
        assert V.value(POINT * mirror) == V.value(POINT)
        assert V.gradient(POINT * mirror).tolist() == (V.gradient(POINT) * mirror).tolist()


def test_another_reference_angle_changes_G_by_an_even_function() -> None:
    on = BODIES[0]
    V, W = general(on, "exp(-w)"), general(on, "exp(-w)", angle="k*pi", k=Fraction(1, 3))
    assert V != W
    angles = np.array([0.2, 0.8, 1.3])
    north = np.stack([0.8 * np.cos(angles), np.full(3, 0.6), 0.8 * np.sin(angles)], axis=-1)
    Q = 1.7 * north[:, 0] ** 2 + north[:, 2] ** 2
    shift = (V.value(north) - W.value(north)) / Q
    south = north * [1, -1, 1]
    # Differences of numbers of order 1.
    assert shift == pytest.approx(np.full(3, shift[0]), abs=1e-14)
    assert (V.value(south) - W.value(south)) / Q == pytest.approx(shift, abs=1e-14)


def test_the_six_equations_keep_to_the_quadrature() -> None:
    on = BODIES[0]
    V = general(on, "exp(-w)")
    motion = solve_planar(planar(on, V, PlanarMotion(Fraction(11, 10)), (0, 1, 2), tolerance=1e-10))
    times = np.array([0.0, 1.0, 2.0])
    states = motion.samples

    def rates(_time: float, state: np.ndarray) -> np.ndarray:
        rate = euler_poisson_rhs(on, V, state[:3], state[3:])
        return np.concatenate([rate.omega, rate.gamma])

    run = solve_ivp(rates, (0.0, 2.0), states[0], method="DOP853", t_eval=times, rtol=1e-11, atol=1e-11)
    # Some 30 steps of 1e-11 each; the transversal instability multiplies by less than 10 in so short a time.
    assert np.abs(run.y.T - states).max() < 1e-9
    w0 = 0.7**0.7 * 1.1**3.4
    energies = energy_integral(on, V, run.y.T[:, :3], run.y.T[:, 3:])
    assert energies == pytest.approx(np.full(3, -np.exp(-w0)), abs=1e-9)


def test_what_has_no_formula_says_so() -> None:
    V = general(BODIES[0], "exp(-w)", "g2")
    assert V.formula() == "V1[exp(-w); pi/4] + (1.7*g1^2 + 1*g3^2)*g2"
    assert V.family == "general"
    assert V.notices == ()
    for name in ("tree", "tape"):
        with pytest.raises(NoClosedFormError):
            getattr(V, name)
    texts = dict.fromkeys(QUADRANTS, "exp(-w)")
    assert general(BODIES[0], texts, "g2") == V
    assert general(BODIES[0], texts | {"mm": "0"}, "g2").formula().count("V1[") == 4


def test_the_taylor_integrator_refuses_it() -> None:
    with pytest.raises(UnsupportedFormulaError) as caught:
        HeyokaIntegrator(BODIES[0], general(BODIES[0], "exp(-w)"))
    assert caught.value.pointer == "/potential"


@pytest.mark.parametrize(
    ("changes", "error", "pointer"),
    [
        ({"F": "w +"}, FormulaError, "/potential/F"),
        ({"F": "g1"}, UnknownNameError, "/potential/F"),
        ({"G": "w"}, UnknownNameError, "/potential/G"),
        ({"G": dict.fromkeys(QUADRANTS, "g2") | {"pm": "g3"}}, UnknownNameError, "/potential/G_pm"),
        ({"F": {"pp": "w"}}, QuadrantError, "/potential/F"),
        ({"F": dict.fromkeys((*QUADRANTS, "zz"), "w")}, QuadrantError, "/potential/F"),
        ({"reference_angle": "0"}, ReferenceAngleError, "/potential/reference_angle"),
        ({"reference_angle": "pi/2"}, ReferenceAngleError, "/potential/reference_angle"),
        ({"reference_angle": "-1"}, ReferenceAngleError, "/potential/reference_angle"),
        ({"reference_angle": "g2"}, UnknownNameError, "/potential/reference_angle"),
        ({"parameters": {"w": Fraction(1)}}, ParameterNameError, "/potential/parameters/w"),
        ({"parameters": {"g2": Fraction(1)}}, ParameterNameError, "/potential/parameters/g2"),
        ({"F": "B*w"}, MissingMomentError, "/body/B"),
        ({"body": body(2, 2)}, EqualMomentsError, "/body"),
    ],
)
def test_what_is_refused(changes: dict[str, object], error: type[DynamicsError], pointer: str) -> None:
    arguments: dict[str, object] = {"body": body("17/10", 1), "F": "w", "G": "g2", "parameters": {}} | changes
    with pytest.raises(error) as caught:
        general_potential(**arguments)  # type: ignore[arg-type]
    assert caught.value.pointer == pointer


def test_parameters_and_moments_have_their_values() -> None:
    on = BODIES[0]
    V, W = general(on, "k*w^(A/C)", "B*g2", k=Fraction(2)), general(on, "2*w^(17/10)", "7/5*g2")
    assert V.pieces[0].angular == W.pieces[0].angular
    assert V.pieces[0].even.tape == W.pieces[0].even.tape
