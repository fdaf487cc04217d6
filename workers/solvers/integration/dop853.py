"""Integrates by SciPy's DOP853, the Runge-Kutta method of order 8 by Dormand and Prince.

Needs nothing that is not everywhere. Its continuous extension is a polynomial of
degree 7 on each step, so eight values carry all of it.
"""

import operator
from math import inf

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from service.dynamics.body import RigidBody
from service.dynamics.equations.euler_poisson import FourOperations, rates_in
from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.potentials.potential import FormulaPotential, Potential
from service.dynamics.solution.dense_output import chebyshev_coefficients, chebyshev_points
from workers.solvers.integration.errors import IntegrationError, UndefinedStartError
from workers.solvers.integration.interface import (
    Rounding,
    Run,
    collapse,
    neighbour_of,
    rounded_moments,
    step_has_collapsed,
    too_many_steps,
)
from workers.solvers.integration.programs import GradientFunction, gradient_function

FloatArray = NDArray[np.float64]

_rates = rates_in(FourOperations(operator.add, operator.sub, operator.mul, operator.truediv))
_PIECE_DEGREE = 7
_PIECE_POINTS = 0.5 * (1.0 + chebyshev_points(_PIECE_DEGREE))


class Dop853Integrator:
    """The six equations for SciPy's DOP853."""

    name = "dop853"
    finest = 3e-14  # SciPy takes no relative tolerance below 100 ulp, 2.2e-14
    coarsest = 1e-6  # above it a method of order 8 is not in its element
    first_share = 0.01
    leaves_out = 0.2  # measured: the tolerance is that of a lower order
    tightening = 4.0  # the error is proportional to the tolerance

    def __init__(self, body: RigidBody, potential: Potential, rounding: Rounding = nearest_double) -> None:
        """Prepare the right-hand sides; raises MissingMomentError."""
        self._body, self._potential = body, potential
        self._moments = rounded_moments(body, rounding).tolist()
        # A potential given by an integral has no program: its own gradient, to some ulp, serves both runs.
        self._gradient: GradientFunction = (
            gradient_function(potential.tape, rounding)
            if isinstance(potential, FormulaPotential)
            else potential.gradient_at
        )

    def neighbour(self) -> "Dop853Integrator":
        """See Integrator.neighbour."""
        return Dop853Integrator(self._body, self._potential, neighbour_of)

    def run(
        self,
        state: FloatArray,
        end: float,
        *,
        local_tolerance: float,
        max_steps: int,
        longest: float = inf,
        since: float = 0.0,
    ) -> Run:
        """Integrate from ``state`` to ``end``; see Integrator.run."""
        start_gradient = self._gradient_of(state)
        if not np.isfinite(start_gradient).all():
            return Run(np.zeros(1), np.zeros((0, _PIECE_DEGREE + 1, 6)), UndefinedStartError())
        solver = DOP853(
            self._derivative, 0.0, state, end, rtol=local_tolerance, atol=local_tolerance, max_step=longest
        )
        breaks, values = [0.0], list[FloatArray]()
        longest_taken = 0.0
        ending: IntegrationError | None = None
        while breaks[-1] != end:
            if len(breaks) > max_steps:
                ending = too_many_steps(since + breaks[-1], since + end, max_steps)
                break
            before = solver.y
            with np.errstate(all="ignore"):  # trial steps may leave the potential's domain
                solver.step()
            step = float(solver.t) - breaks[-1]
            longest_taken = max(longest_taken, abs(step))
            # A step that the solver gave up is one of length zero.
            if float(solver.t) != end and step_has_collapsed(step, longest_taken, breaks[-1]):
                ending = collapse(since + breaks[-1], start_gradient, self._gradient_of(before))
                break
            values.append(solver.dense_output()(breaks[-1] + step * _PIECE_POINTS))
            breaks.append(float(solver.t))
        shape = (_PIECE_DEGREE + 1, len(values), 6)
        table = np.array(values).transpose(2, 0, 1) if values else np.zeros(shape)
        return Run(np.array(breaks), chebyshev_coefficients(table).transpose(1, 0, 2), ending)

    def keeps(self, run: Run, goal: float, allowed: float) -> bool:
        """See Integrator.keeps; nothing is known here."""
        return False

    def _gradient_of(self, state: FloatArray) -> FloatArray:
        return np.array(self._gradient(*state[3:].tolist()))

    def _derivative(self, _time: float, state: FloatArray) -> FloatArray:
        return np.array(_rates(self._moments, state.tolist(), self._gradient(*state[3:].tolist())))
