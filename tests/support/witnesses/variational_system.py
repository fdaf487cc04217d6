r"""The six variational equations along a planar motion: the check of Hill's equation.

The Euler-Poisson equations I ω̇ = Iω × ω + γ × ∇V, γ̇ = γ × ω linearised, with
[a] the matrix of a × and V'' the hessian:

.. math::
    I\,\delta\dot\omega = ([I\omega] - [\omega] I)\,\delta\omega + ([\gamma] V'' - [\nabla V])\,\delta\gamma,
    \qquad \delta\dot\gamma = [\gamma]\,\delta\omega - [\omega]\,\delta\gamma .
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import Potential
from service.dynamics.reduction.window import StartingPoint
from service.dynamics.solution.dense_output import Period
from workers.solvers.orbits.orbit import Libration, Rotation, make_orbit
from workers.solvers.stability.monodromy import Monodromy, turn_monodromy

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class VariationalSystem:
    """y = (δω/ω_0, δγ), ω_0 = 2π/T, the six in the order of the variables."""

    inertia: FloatArray
    potential: Potential
    orbit: Libration | Rotation
    frequency: float
    """ω_0."""

    @property
    def units(self) -> FloatArray:
        """Return the units of y in those of the six variables."""
        return np.array([self.frequency] * 3 + [1.0] * 3)

    def matrix(self, theta: arb) -> FloatArray:
        """Return A(θ) of dy/dθ = A y."""
        J = self._jacobian(self.orbit.state(theta))
        return float(self.orbit.rate(theta)) * J * self.units / self.units[:, None]

    def _jacobian(self, state: Sequence[arb]) -> FloatArray:
        _, first, second = self.potential.jet_ball(*state[3:])
        gradient = np.array([float(part) for part in first])
        hessian = np.array([[float(part) for part in row] for row in second])
        six = np.array([float(value) for value in state])
        omega, gamma = _cross(six[:3]), _cross(six[3:])
        turning = _cross(self.inertia * six[:3]) - omega * self.inertia
        forcing = gamma @ hessian - _cross(gradient)
        weight = self.inertia[:, None]
        return np.block([[turning / weight, forcing / weight], [gamma, -omega]])


def jacobian_monodromy(
    body: RigidBody, potential: Potential, start: StartingPoint, period: Period
) -> Monodromy:
    """Return the monodromy of all six variables (p, q, r, g1, g2, g3) over a period, from θ = 0.

    Its multipliers are 1 four times and those of Hill's equation. ∇V must be
    continuous along the orbit: a jump would have to be carried through on its
    own. The ``excursion`` is measured with ω in units of 2π/T.

    Raises
    ------
    MissingMomentError
        The body has no B.
    StabilityUndefinedError
        The motion passes a pole at which V is not smooth enough.
    QuadratureNotConvergedError
        The equations are not resolved by the largest number of panels.
    """
    inertia = np.array([float(body.A), float(body.require_B("stability")), float(body.C)])
    orbit = make_orbit(start)
    system = VariationalSystem(inertia, potential, orbit, 2.0 * np.pi / period.hi)
    found = turn_monodromy(system.matrix, orbit)
    return replace(found, matrix=system.units[:, None] * found.matrix / system.units)


def _cross(vector: FloatArray) -> FloatArray:
    """Return the matrix of ``vector`` ×."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
