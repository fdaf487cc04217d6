r"""Hill's equation of the perturbations that leave the plane of a planar motion.

To first order they are q and the rest M of the second Euler-Poisson equation,

.. math::
    M = (A-C) p r - g_3 V_1 + g_1 V_3,\qquad B \dot q = -M,\qquad \dot M = c(t)\,q,

.. math::
    c = (A-C)\Bigl[\frac{(B-C) r^2}{A} + \frac{(A-B) p^2}{C}\Bigr]
        - \frac{(A-C) B g_2}{Q}\Bigl[\frac{(g_2V_3-g_3V_2) g_3}{A} + \frac{(g_1V_2-g_2V_1) g_1}{C}\Bigr]
        + \Bigl(1 + \frac{B g_2^2}{Q}\Bigr) D_\varphi ,

with Q = A g1² + C g3², D = g1 V_3 − g3 V_1, D_φ = g1 ∂D/∂g3 − g3 ∂D/∂g1 and the
third integral kept zero. Four of the six multipliers of a periodic motion are 1
(two Casimir functions, the energy, the shift of time); the other two, μ and 1/μ,
are those of this equation.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import Potential
from service.dynamics.reduction.geometry.loop import ball
from service.dynamics.solution.dense_output import Period
from workers.solvers.errors import PrecisionLostError
from workers.solvers.orbits.orbit import Libration, Rotation
from workers.solvers.stability.monodromy import Monodromy, turn_monodromy

FloatArray = NDArray[np.float64]

KNOWN_BITS = 56
"""Bits to which c is known, in parts of the larger of itself and of B ω²."""


@dataclass(frozen=True, slots=True)
class HillSystem:
    """y = (q, M/(B ω)) with ω = 2π/T: two angular velocities."""

    A: arb
    B: arb
    C: arb
    potential: Potential
    orbit: Libration | Rotation
    frequency: arb
    """ω."""

    def matrix(self, theta: arb) -> FloatArray:
        """Return A(θ) of dy/dθ = A(θ) y; raises PrecisionLostError."""
        c = self.coefficient(self.orbit.state(theta))
        scale = self.B * self.frequency
        if not c.rad() * arb(2) ** KNOWN_BITS <= abs(c.mid()) + scale * self.frequency:
            raise PrecisionLostError(f"Hill's coefficient is known to fewer than {KNOWN_BITS} bits")
        rate = self.orbit.rate(theta)
        return np.array([[0.0, -float(rate * self.frequency)], [float(rate * c / scale), 0.0]])

    def coefficient(self, state: Sequence[arb]) -> arb:
        """Return c at a state (p, q, r, g1, g2, g3) of a planar motion, not at a pole."""
        p, _, r, g1, g2, g3 = state
        A, B, C = self.A, self.B, self.C
        _, (V_1, V_2, V_3), ((V_11, _, V_13), _, (_, _, V_33)) = self.potential.jet_ball(g1, g2, g3)
        Q = A * g1 * g1 + C * g3 * g3
        D_phi = g1 * g1 * V_33 - 2 * g1 * g3 * V_13 + g3 * g3 * V_11 - g1 * V_1 - g3 * V_3
        gyration = (B - C) * r * r / A + (A - B) * p * p / C
        torque = (g2 * V_3 - g3 * V_2) * g3 / A + (g1 * V_2 - g2 * V_1) * g1 / C
        return (A - C) * (gyration - B * g2 / Q * torque) + (1 + B * g2 * g2 / Q) * D_phi


def hill_monodromy(
    body: RigidBody, potential: Potential, orbit: Libration | Rotation, period: Period
) -> Monodromy:
    """Return the monodromy of (q, M/(B ω)), ω = 2π/T, over a period, from θ = 0.

    Raises
    ------
    MissingMomentError
        The body has no B.
    StabilityUndefinedError
        The motion passes a pole at which V is not smooth enough.
    QuadratureNotConvergedError, PrecisionLostError
        c is not resolved, or not known to a double's precision.
    """
    B = ball(body.require_B("stability"))
    frequency = 2 * arb.pi() / (arb(period.hi) + arb(period.lo))
    system = HillSystem(ball(body.A), B, ball(body.C), potential, orbit, frequency)
    return turn_monodromy(system, orbit)
