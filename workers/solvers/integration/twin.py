"""Runs an integration twice; the difference measures the error of the better run.

The second run has a looser local tolerance, hence other steps and other
rounding, and solves a problem that the rounded data (state, moments,
coefficients) might as well have meant. Their difference therefore shows
truncation, rounding and the growth of both, also where the motion is unstable
and no local estimate would see it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.defect.equations import Equations
from service.dynamics.equations.euler_poisson import euler_poisson_rhs
from service.dynamics.potentials.potential import Potential
from service.dynamics.solution.dense_output import DenseOutput
from workers.solvers.integration.errors import IntegrationError
from workers.solvers.integration.followed import followed
from workers.solvers.integration.interface import Integrator, Run, joined

FloatArray = NDArray[np.float64]

SAFETY = 4.0
"""On the difference. Above the level of rounding it is the error of the worse run, and 1 would do; at that
level two runs err alike and independently, and may differ by less than either errs. With both factors the
claim was never below the actual error in thousands of random problems held against 64-bit significands."""
ROUNDING = 4.0 * 2.0**-53
"""What two runs share, relative to the variables: the rounded state, time, moments and coefficients."""


LOOSER = 8.0
"""Times as much defect may the coarser run leave at a kink. With the same for both they err alike there, and
their difference does not show it; like this it shows seven times what the finer one leaves."""


@dataclass(frozen=True, slots=True)
class Span:
    """The times from ``first`` ≤ 0 to ``last`` ≥ 0."""

    first: float
    last: float

    def uniform(self, count: int) -> FloatArray:
        """Return ``count`` equidistant times, both ends included."""
        return np.linspace(self.first, self.last, count)


@dataclass(frozen=True, slots=True)
class Twin:
    """Two runs from t = 0 in both directions."""

    fine: DenseOutput
    coarse: DenseOutput
    span: Span
    """Where both runs have arrived."""
    ending: IntegrationError | None
    """Why that is less than what was asked for, or None; the earlier one of two."""
    local_tolerance: float
    """Of the finer run."""

    @property
    def steps(self) -> int:
        """Steps of the finer run."""
        return len(self.fine.breaks) - 1

    def difference(self, times: FloatArray) -> FloatArray:
        """Return the largest difference of the two runs in any variable, shape (n,)."""
        difference: FloatArray = np.abs(self.fine(times) - self.coarse(times)).max(axis=1)
        return difference

    def error_estimate(self, body: RigidBody, potential: Potential, times: FloatArray) -> FloatArray:
        """Return the estimated error of the finer run at ``times``, shape (n,).

        To the difference comes what both runs share: the variables are rounded,
        and so are the time and the constants of the problem, which set the rate
        at which the motion goes through time.
        """
        states = self.fine(times)
        rates = euler_poisson_rhs(body, potential, states[:, :3], states[:, 3:])
        speed = np.maximum(np.abs(rates.omega).max(axis=1), np.abs(rates.gamma).max(axis=1))
        rounding = ROUNDING * (np.abs(states).max(axis=1) + np.abs(times) * speed)
        estimate: FloatArray = SAFETY * self.difference(times) + rounding
        return estimate


def run_twin(
    integrator: Integrator,
    equations: Equations,
    state: FloatArray,
    neighbour: FloatArray,
    span: Span,
    *,
    local_tolerance: float,
    max_steps: int,
) -> Twin:
    """Integrate over ``span`` from ``state`` finely, and from ``neighbour`` less so.

    Every step of both is held against the ``equations``, which are those of ``integrator``.
    ``local_tolerance`` is that of the coarser run.
    """
    finer = local_tolerance / integrator.tightening
    ends = [end for end in (span.first, span.last) if end != 0.0]
    fine = [
        followed(integrator, equations, state, end, local_tolerance=finer, max_steps=max_steps)
        for end in ends
    ]
    other = integrator.neighbour()
    coarse = [
        followed(
            other,
            equations,
            neighbour,
            run.reached,
            local_tolerance=local_tolerance,
            max_steps=max_steps,
            looseness=LOOSER,
        )
        for run in fine
        if run.reached != 0.0
    ]
    endings = [run.ending for run in (*fine, *coarse) if run.ending is not None]
    reached = [run.reached for run in coarse]
    return Twin(
        fine=_both_sides(fine, state),
        coarse=_both_sides(coarse, neighbour),
        span=Span(min([0.0, *reached]), max([0.0, *reached])),
        ending=min(endings, key=lambda ending: abs(ending.time), default=None),
        local_tolerance=finer,
    )


def _both_sides(runs: list[Run], state: FloatArray) -> DenseOutput:
    """Join the runs; what has no extent becomes a constant over the shortest time there is."""
    moving = [run for run in runs if run.reached != 0.0]
    backward = next((run for run in moving if run.reached < 0.0), None)
    forward = next((run for run in moving if run.reached > 0.0), None)
    if not moving:
        shortest = float(np.finfo(np.float64).tiny)
        forward = Run(np.array([0.0, shortest]), state.reshape(1, 1, 6).copy(), None)
    return joined(backward, forward)
