"""Periodic planar motions, and the closed form of their multipliers where there is one."""

from dataclasses import dataclass
from fractions import Fraction

from flint import acb, arb, ctx, fmpq

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.window import StartingPoint, Window, starting_point
from service.dynamics.reduction.windows import REDUCTION_BITS, choose_window, find_windows
from service.dynamics.solution.dense_output import Period
from tests.support.planar import Exact, body, formula
from tests.support.witnesses.variational_system import jacobian_monodromy
from workers.solvers.orbits.orbit import make_orbit, starting_state
from workers.solvers.quadrature.squared_speed import time_map_of
from workers.solvers.stability.assessment import Stability, assess_stability, hill_monodromy
from workers.solvers.stability.monodromy import Monodromy

TOLERANCE = 1e-8


@dataclass(frozen=True)
class Case:
    body: RigidBody
    potential: Potential
    start: StartingPoint
    period: Period

    def assess(self, tolerance: float = TOLERANCE) -> Stability:
        with ctx.workprec(REDUCTION_BITS):
            return assess_stability(self.body, self.potential, self.start, self.period, tolerance)

    def hill(self) -> Monodromy:
        with ctx.workprec(REDUCTION_BITS):
            return hill_monodromy(self.body, self.potential, make_orbit(self.start), self.period)

    def jacobian(self) -> Monodromy:
        with ctx.workprec(REDUCTION_BITS):
            return jacobian_monodromy(self.body, self.potential, self.start, self.period)

    def state(self) -> list[float]:
        with ctx.workprec(REDUCTION_BITS):
            return [float(value) for value in starting_state(self.start)]


def nu(value: Exact, **wishes: object) -> PlanarMotion:
    return PlanarMotion(None, Fraction(value), **wishes)


def lambda_(value: Exact, **wishes: object) -> PlanarMotion:
    return PlanarMotion(Fraction(value), None, **wishes)


def case(A: Exact, B: Exact | None, C: Exact, text: str, motion: PlanarMotion) -> Case:
    """Return the periodic motion of a potential given as a formula."""
    rigid_body = body(A, C, B)
    potential = formula(text, rigid_body)
    window = choose_window(find_windows(rigid_body, potential, motion), motion)
    return in_window(rigid_body, potential, motion, window)


def in_window(rigid_body: RigidBody, potential: Potential, motion: PlanarMotion, window: Window) -> Case:
    assert window.kind == "periodic"
    with ctx.workprec(REDUCTION_BITS):
        start = starting_point(window, motion)
        orbit = make_orbit(start)
        period = time_map_of(orbit).period
    return Case(rigid_body, potential, start, period)


def bobylev_steklov(nu_: Exact, B: Exact) -> Case:
    """Return V = −g1 with A = 2, C = 1."""
    return case(2, B, 1, "-g1", nu(nu_))


def lame_trace(nu_: Exact, B: Exact) -> arb:
    r"""Return μ + 1/μ of Bobylev's and Steklov's motion (A = 2, C = 1, V = −g1) in closed form.

    Hill's equation is Lamé's, q'' = (2℘ + E) q, with e_i = −(x_i + ν/3)/2, x_i
    the zeros of x (1 − x² − ν x), and E = ν/3 − ν (2 − B)/(2B). With ℘(v) = E one
    solution is e^{−ζ(v) z} σ(z + v)/σ(z), and over the real period 1 of z = t/T_1

    .. math:: \rho = \exp(2ζ(1/2) v - ζ(v)) .

    The period of the six variables is 2 T_1.
    """
    exact_nu, exact_B = Fraction(nu_), Fraction(B)
    with ctx.workprec(200):
        n, b = (arb(fmpq(*number.as_integer_ratio())) for number in (exact_nu, exact_B))
        root = (n * n + 4).sqrt()
        e1, e2, e3 = (-(x + n / 3) / 2 for x in (-(n + root) / 2, arb(0), 2 / (n + root)))
        E = n / 3 - n * (2 - b) / (2 * b)
        m = acb((e2 - e3) / (e1 - e3))
        K = m.elliptic_k()
        tau = acb(0, 1) * (1 - m).elliptic_k() / K
        period = 2 * K / acb(e1 - e3).sqrt()
        v = (period * period * E).elliptic_inv_p(tau)
        rho = (2 * acb(0.5).elliptic_zeta(tau) * v - v.elliptic_zeta(tau)).exp()
        return (rho * rho + 1 / (rho * rho)).real
