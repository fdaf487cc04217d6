"""Integrates by Taylor series of high order in compiled code, which is the same for all formulas.

What a formula does is a list of operations that kernels go through (:mod:`workers.solvers.compiled.general`):
nothing is compiled for a potential or a body. Two runs, the difference of which is the error, are held
against the equations by kernels too; what these do not settle goes through :mod:`.followed`.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import inf

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.defect.evidence import FINEST, GOAL
from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.potentials.potential import FormulaPotential, Potential
from workers.solvers.compiled.evaluation.program import make_program
from workers.solvers.compiled.general.held import hold
from workers.solvers.compiled.general.records import Asked, Formula, Gradient
from workers.solvers.compiled.general.sampling import values_at
from workers.solvers.compiled.general.series import STATE
from workers.solvers.compiled.general.steps import ARRIVED, TIRED, take_steps
from workers.solvers.compiled.general.twin import HELD, OPEN, solve_twin
from workers.solvers.integration.errors import UnsupportedFormulaError
from workers.solvers.integration.followed import ROUNDING as STEP_ROUNDING
from workers.solvers.integration.followed import SLACK
from workers.solvers.integration.interface import (
    COLLAPSED_STEP,
    Rounding,
    Run,
    collapse,
    neighbour_of,
    too_many_steps,
    undefined_start,
)
from workers.solvers.integration.programs import gradient_program
from workers.solvers.integration.twin import LOOSER, ROUNDING, SAFETY, Span

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NONE, _NO_REFERENCE = np.empty(0), np.zeros(3)


def moments_of(body: RigidBody, rounding: Rounding) -> FloatArray:
    """Return A, B, C, B − C, C − A, A − B; raises MissingMomentError if B was left out."""
    A, B, C = body.A, body.require_B("integration of the six equations"), body.C
    return np.array([rounding(each) for each in (A, B, C, B - C, C - A, A - B)])


class CompiledIntegrator:
    """The six equations for the kernels."""

    name = "taylor"
    finest = 1e-20
    coarsest = 1e-11  # longer steps are cut again when they are held against the equations, and cost more
    tightening = 100.0

    def __init__(
        self, body: RigidBody, potential: FormulaPotential, rounding: Rounding = nearest_double
    ) -> None:
        """Prepare the operations; raises MissingMomentError, UnsupportedFormulaError."""
        self._body, self._potential, self._rounding = body, potential, rounding
        self.moments = moments_of(body, rounding)
        self.gradient = _gradient_program(potential, rounding)

    @cached_property
    def _other(self) -> "CompiledIntegrator":
        return CompiledIntegrator(self._body, self._potential, neighbour_of)

    @cached_property
    def formula(self) -> Formula:
        """V, with the constants nearest to the exact ones."""
        return _formula_program(self._potential)

    def neighbour(self) -> "CompiledIntegrator":
        """See Integrator.neighbour."""
        return self._other

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
        status, breaks, coefficients = self.steps(
            state, end, local_tolerance=local_tolerance, max_steps=max_steps, longest=longest
        )
        run = Run(breaks, coefficients, None)
        if status == ARRIVED:
            return run
        if status == TIRED:
            return Run(breaks, coefficients, too_many_steps(since + run.reached, since + end, max_steps))
        start_gradient = self._potential.gradient(state[3:])
        if not np.isfinite(start_gradient).all():
            return Run(np.zeros(1), np.zeros((0, 1, 6)), undefined_start())
        last = coefficients[-1].sum(axis=0) if len(coefficients) else state
        end_gradient = self._potential.gradient(last[3:])
        ending = collapse(since + run.reached, start_gradient, end_gradient)
        return Run(breaks, coefficients, ending)

    def keeps(self, run: Run, goal: float, allowed: float) -> bool:
        """See Integrator.keeps."""
        is_kept, _, _ = hold(
            self.formula,
            self.gradient,
            self.moments,
            run.breaks,
            run.coefficients,
            goal,
            allowed,
            False,
            0.0,
            _NO_REFERENCE,
            0.0,
        )
        return bool(is_kept)

    def steps(
        self,
        state: FloatArray,
        end: float,
        *,
        local_tolerance: float,
        max_steps: int,
        longest: float = inf,
    ) -> tuple[int, FloatArray, FloatArray]:
        """Return how the kernel's run ends, its breaks and its series."""
        found: tuple[int, FloatArray, FloatArray] = take_steps(
            *self.gradient[:3],
            self.moments,
            self.gradient.registers,
            state,
            end,
            local_tolerance,
            max_steps,
            longest,
            COLLAPSED_STEP,
        )
        return found


def integrator_of(body: RigidBody, potential: Potential) -> CompiledIntegrator:
    """Return the integrator of the equations; raises what :class:`CompiledIntegrator` does.

    A potential given by an integral has no formula to take apart.
    """
    if not isinstance(potential, FormulaPotential):
        raise UnsupportedFormulaError(
            "a Taylor integrator needs a formula, and this potential is given by an integral; "
            "the Runge-Kutta integrator takes it",
            pointer="/potential",
        )
    return _kept_integrator(body, potential)


@lru_cache(maxsize=64)
def _kept_integrator(body: RigidBody, potential: FormulaPotential) -> CompiledIntegrator:
    return CompiledIntegrator(body, potential)


@lru_cache(maxsize=64)
def _gradient_program(potential: FormulaPotential, rounding: Rounding) -> Gradient:
    return gradient_program(potential, rounding)


@lru_cache(maxsize=64)
def _formula_program(potential: FormulaPotential) -> Formula:
    program, constants = make_program(potential.tape)
    return Formula(program.code, constants, program.result)


@dataclass(frozen=True, slots=True)
class Held:
    """Two runs that arrive, every step of which keeps the equations, and what they show."""

    breaks: FloatArray
    coefficients: FloatArray
    """Of the finer run, as :class:`~service.dynamics.solution.dense_output.DenseOutput` has them."""
    error: float
    """The claim; not below what the motion shows."""
    difference: float
    energy: float
    energy_error: float
    defect: float
    drift: float


def asked_of_twin(
    integrator: CompiledIntegrator, span: Span, *, local_tolerance: float, max_steps: int, tolerance: float
) -> Asked:
    """Return what :func:`.twin.run_twin` asks of two runs, the looser ``local_tolerance`` being given."""
    finer = local_tolerance / integrator.tightening
    return Asked(
        first=span.first,
        last=span.last,
        fine=finer,
        coarse=local_tolerance,
        max_steps=max_steps,
        collapsed=COLLAPSED_STEP,
        tolerance=tolerance,
        safety=SAFETY,
        rounding=ROUNDING,
        fine_defect=max(SLACK * finer, STEP_ROUNDING),
        coarse_defect=max(SLACK * local_tolerance, LOOSER * STEP_ROUNDING),
        goal=GOAL,
        finest=FINEST,
    )


def held_twin(
    integrator: CompiledIntegrator,
    state: FloatArray,
    neighbour: FloatArray,
    check: FloatArray,
    asked: Asked,
) -> Held | float | None:
    """Return what :func:`.twin.run_twin` finds where all is settled by kernels; None where not.

    A number is the estimated error of the finer run, where that is larger than the tolerance.
    """
    other = integrator.neighbour()
    status, breaks, coefficients, found = solve_twin(
        integrator.formula,
        integrator.gradient,
        integrator.moments,
        other.gradient,
        other.moments,
        state,
        neighbour,
        check,
        asked,
    )
    if status == OPEN:
        return None
    numbers: list[float] = found.tolist()
    return Held(breaks, coefficients, *numbers) if status == HELD else numbers[0]


def samples_of(held: Held, times: FloatArray, rests: FloatArray | None) -> FloatArray:
    """Return the six variables at the times, shape (n, 6): what the dense output has there."""
    values = np.empty((STATE, len(times)))
    values_at(held.breaks, held.coefficients, times, _NONE if rests is None else rests, values)
    return np.ascontiguousarray(values.T)
