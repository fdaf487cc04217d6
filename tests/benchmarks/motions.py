"""The motions that are measured, their reference, and the rivals that integrate them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import heyoka as hy
import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion, StartAtRest
from tests.support.planar import body, formula
from workers.solvers.certified.certify import Certified
from workers.solvers.choose import enclose
from workers.solvers.compiled.motion import SpectralMotion
from workers.solvers.compiled.solve import Tier, solve_spectral

FloatArray = NDArray[np.float64]
REFERENCE_BITS = 96
SAMPLES = 1000


@dataclass(frozen=True)
class Measured:
    """A motion with its body and potential."""

    name: str
    body: RigidBody
    potential: Potential
    motion: PlanarMotion

    def solved(self, tier: Tier) -> SpectralMotion:
        """Return the motion by the compiled solver, which has it."""
        found = self.solved_if_kept(tier)
        assert found is not None
        return found

    def solved_if_kept(self, tier: Tier) -> SpectralMotion | None:
        """Return the motion by the compiled solver; None where it does not keep the tier by itself."""
        return solve_spectral(self.body, self.potential, self.motion, tier=tier)

    def grid(self, first: int, last: int) -> FloatArray:
        """Return the times of 1000 samples from one number of periods to another."""
        period = float(enclose(self.body, self.potential, self.motion, [], 64).period)
        return np.linspace(first * period, last * period, SAMPLES)

    def error(self, times: FloatArray, samples: FloatArray, stride: int = 1) -> float:
        """Return the largest distance of a variable from the certified one at the very same doubles."""
        chosen = [Fraction(t) for t in times[::stride].tolist()]
        found = enclose(self.body, self.potential, self.motion, chosen, REFERENCE_BITS)
        return _largest(found, samples[::stride])

    def error_after(self, turns: Sequence[Fraction], samples: FloatArray) -> float:
        """Return the largest distance of a variable from the certified one after so many periods."""
        found = enclose(
            self.body,
            self.potential,
            self.motion,
            turns,
            REFERENCE_BITS,
            about_a_period=self.solved("standard").period.hi,
        )
        return _largest(found, samples)

    def state(self) -> FloatArray:
        """Return the six variables at t = 0, rounded."""
        found = enclose(self.body, self.potential, self.motion, [Fraction(0)], 64)
        return np.array([float(value) for value in found.states[0]])

    def right_side(self) -> Callable[[float, FloatArray], tuple[float, ...]]:
        """Return the Euler-Poisson equations in plain floats, as a careful user of solve_ivp writes them."""
        A, B, C = float(self.body.A), float(self.body.B or 1), float(self.body.C)
        gradient_at = self.potential.gradient_at

        def rhs(_: float, y: FloatArray) -> tuple[float, ...]:
            p, q, r, g1, g2, g3 = y.tolist()
            V_1, V_2, V_3 = gradient_at(g1, g2, g3)
            return (
                ((B - C) * q * r + g2 * V_3 - g3 * V_2) / A,
                ((C - A) * p * r + g3 * V_1 - g1 * V_3) / B,
                ((A - B) * p * q + g1 * V_2 - g2 * V_1) / C,
                r * g2 - q * g3,
                p * g3 - r * g1,
                q * g1 - p * g2,
            )

        return rhs

    def by_scipy(self, state: FloatArray, times: FloatArray, rtol: float) -> FloatArray:
        """Return samples of solve_ivp; absolute tolerance a tenth of the relative one."""
        span = (0.0, float(times[-1]))
        found = solve_ivp(self.right_side(), span, state, "DOP853", times, rtol=rtol, atol=rtol / 10)
        return np.asarray(found.y.T)


NU_1 = PlanarMotion(None, nu=Fraction(1))
AT_REST = PlanarMotion(Fraction(4, 5), start=StartAtRest(-1))
DOUBLE = body(2, 1, "3/2")
LIBRATION = "(A*g1^2+C*g3^2)*(g2^2-1/2+g2^3/5)"


def elliptic() -> Measured:
    """A = 2C, a motion in elliptic functions."""
    return Measured("A = 2C", DOUBLE, formula("-g1 + 1/(20*g3^2)", DOUBLE), NU_1)


def near_separatrix(gap: Fraction) -> Measured:
    """A = 2C, c1 below its critical value (1 + √5)/4 by a share of it, exact to 80 digits."""
    with ctx.workprec(400):
        digits = ((1 + arb(5).sqrt()) / 4 * 10**80).floor().unique_fmpz()
    assert digits is not None
    critical = Fraction(int(digits), 10**80)
    potential = formula(f"-g1 + ({critical * (1 - gap)})*(g1^2-g2^2)", DOUBLE)
    return Measured(f"gap {float(gap):.0e}", DOUBLE, potential, NU_1)


def librations() -> list[Measured]:
    """Motions for other ratios of the moments; their potential is not even in g2."""
    bodies = (("7/5", "6/5"), ("17/10", "13/10"), (3, "5/2"))
    found = []
    for A, B in bodies:
        rigid_body = body(A, 1, B)
        name = f"α = {float(Fraction(A)):.3g}"
        found.append(Measured(name, rigid_body, formula(LIBRATION, rigid_body), AT_REST))
    return found


def taylor_of_elliptic(state: FloatArray, tol: float) -> hy.taylor_adaptive:
    """Return heyoka's integrator of :func:`elliptic`, its equations written out."""
    p, q, r, g1, g2, g3 = hy.make_vars("p", "q", "r", "g1", "g2", "g3")
    V_1, V_3 = -1.0, -0.1 / g3**3
    system = [
        (p, (0.5 * q * r + g2 * V_3) / 2.0),
        (q, (-1.0 * p * r + g3 * V_1 - g1 * V_3) / 1.5),
        (r, 0.5 * p * q - g2 * V_1),
        (g1, r * g2 - q * g3),
        (g2, p * g3 - r * g1),
        (g3, q * g1 - p * g2),
    ]
    return hy.taylor_adaptive(system, state.tolist(), tol=tol)


def _largest(found: Certified, samples: FloatArray) -> float:
    with ctx.workprec(2 * REFERENCE_BITS):
        return max(
            float(abs(value - arb(double)).upper())
            for state, row in zip(found.states, samples.tolist(), strict=True)
            for value, double in zip(state, row, strict=True)
        )
