"""Integrates by Taylor series of order 24 in compiled code, which is the same for all formulas.

What a formula does is a list of operations that kernels go through (:mod:`workers.solvers.compiled.general`):
nothing is compiled for a potential or a body. Two runs, the difference of which is the error, are held
against the equations by kernels too; what these do not settle goes through :mod:`.followed`.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.defect.evidence import FINEST, GOAL
from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.potentials.potential import FormulaPotential, Potential
from workers.solvers.compiled.evaluation.program import Program, make_program
from workers.solvers.compiled.general import series as operations
from workers.solvers.compiled.general.held import hold
from workers.solvers.compiled.general.sampling import compare, values_at
from workers.solvers.compiled.general.steps import ARRIVED, TIRED, take_steps
from workers.solvers.integration.errors import UnsupportedFormulaError
from workers.solvers.integration.followed import ROUNDING as STEP_ROUNDING
from workers.solvers.integration.followed import SLACK
from workers.solvers.integration.interface import (
    COLLAPSED_STEP,
    Rounding,
    Run,
    collapse,
    joined,
    neighbour_of,
    too_many_steps,
    undefined_start,
)
from workers.solvers.integration.programs import GradientProgram, gradient_program
from workers.solvers.integration.twin import LOOSER, ROUNDING, SAFETY, Span

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NONE = np.empty(0)


class FormulaProgram(NamedTuple):
    """V as the kernels that bound it take it."""

    program: Program
    constants: FloatArray


def moments_of(body: RigidBody, rounding: Rounding) -> FloatArray:
    """Return A, B, C, B − C, C − A, A − B; raises MissingMomentError if B was left out."""
    A, B, C = body.A, body.require_B("integration of the six equations"), body.C
    return np.array([rounding(each) for each in (A, B, C, B - C, C - A, A - B)])


class CompiledIntegrator:
    """The six equations for the kernels."""

    name = "taylor"
    finest = 1e-20
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
    def formula(self) -> FormulaProgram:
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
            ending = too_many_steps(since + run.reached, since + end, max_steps)
            return Run(breaks, coefficients, ending)
        start_gradient = self._potential.gradient(state[3:])
        if not np.isfinite(start_gradient).all():
            return Run(np.zeros(1), np.zeros((0, 1, 6)), undefined_start())
        last = coefficients[-1].sum(axis=0) if len(coefficients) else state
        end_gradient = self._potential.gradient(last[3:])
        ending = collapse(since + run.reached, start_gradient, end_gradient)
        return Run(breaks, coefficients, ending)

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
def _gradient_program(potential: FormulaPotential, rounding: Rounding) -> GradientProgram:
    return gradient_program(potential, rounding)


@lru_cache(maxsize=64)
def _formula_program(potential: FormulaPotential) -> FormulaProgram:
    return FormulaProgram(*make_program(potential.tape))


@dataclass(frozen=True, slots=True)
class Held:
    """Two runs that arrive, every step of which keeps the equations, and what they show."""

    breaks: FloatArray
    coefficients: FloatArray
    """Of the finer run, as :class:`~service.dynamics.solution.dense_output.DenseOutput` has them."""
    difference: float
    error: float
    """The claim; not below what the motion shows."""
    energy: float
    energy_error: float
    defect: float
    drift: float


def held_twin(
    integrator: CompiledIntegrator,
    state: FloatArray,
    neighbour: FloatArray,
    span: Span,
    check: FloatArray,
    *,
    local_tolerance: float,
    max_steps: int,
    tolerance: float,
) -> Held | float | None:
    """Return what :func:`.twin.run_twin` finds where all is settled by kernels; None where not.

    A number is the estimated error of the finer run, where that is larger than ``tolerance``.
    """
    finer = local_tolerance / integrator.tightening
    ends = [end for end in (span.first, span.last) if end != 0.0]
    other = integrator.neighbour()
    fine = [integrator.steps(state, end, local_tolerance=finer, max_steps=max_steps) for end in ends]
    coarse = [
        other.steps(neighbour, end, local_tolerance=local_tolerance, max_steps=max_steps) for end in ends
    ]
    if not ends or any(status != ARRIVED for status, _, _ in (*fine, *coarse)):
        return None
    (breaks, coefficients), others = _joined(fine), _joined(coarse)
    program, constants = integrator.formula
    error, difference, energy, energy_error, reference = compare(
        program.code,
        constants,
        program.result,
        integrator.moments,
        breaks,
        coefficients,
        *others,
        check,
        SAFETY,
        ROUNDING,
    )
    for _, its_breaks, its_series in coarse:
        if not _holds(integrator, its_breaks, its_series, local_tolerance, LOOSER):
            return None
    if not error <= tolerance:
        is_held = all(_holds(integrator, *run[1:], finer, 1.0) for run in fine)
        return float(error) if is_held else None
    goal = max(GOAL * error, FINEST * max(1.0, float(np.abs(coefficients).max())))
    claim = _Claim(error, reference, energy_error, goal / (span.last - span.first))
    shown = [_shown(integrator, *run[1:], finer, 1.0, claim) for run in fine]
    if not all(is_held for is_held, _, _ in shown):
        return None
    defect, drift = (max(side[k] for side in shown) for k in (1, 2))
    return Held(breaks, coefficients, difference, error, energy, energy_error, defect, drift)


class _Claim(NamedTuple):
    """What the finer run is held against."""

    error: float
    reference: FloatArray
    """The three integrals at t = 0."""
    slack: float
    """Of the energy."""
    goal: float
    """What interpolation may leave out in a unit of time."""


def _holds(
    integrator: CompiledIntegrator,
    breaks: FloatArray,
    coefficients: FloatArray,
    local_tolerance: float,
    looseness: float,
) -> bool:
    """Say whether every step of a run keeps the equations as :func:`.followed.followed` asks."""
    return _shown(integrator, breaks, coefficients, local_tolerance, looseness, None)[0]


def _shown(
    integrator: CompiledIntegrator,
    breaks: FloatArray,
    coefficients: FloatArray,
    local_tolerance: float,
    looseness: float,
    claim: _Claim | None,
) -> tuple[bool, float, float]:
    """Say whether a run keeps the equations and the claim, if there is one; return defect and drift."""
    size = float(np.abs(coefficients).max())
    allowed = size * max(SLACK * local_tolerance, looseness * STEP_ROUNDING)
    goal = 0.1 * allowed * len(coefficients)
    if claim is not None:
        goal = min(goal, claim.goal * abs(float(breaks[-1])))
    error, reference, slack = (0.0, np.zeros(3), 0.0) if claim is None else claim[:3]
    program, constants = integrator.formula
    found: tuple[bool, float, float] = hold(
        program.code,
        constants,
        program.result,
        integrator.moments,
        coefficients,
        np.diff(breaks),
        goal,
        allowed,
        claim is not None,
        error,
        reference,
        slack,
    )
    return found


def _joined(sides: list[tuple[int, FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Return runs from t = 0 both ways as one function of time."""
    runs = [Run(breaks, coefficients, None) for _, breaks, coefficients in sides]
    if len(runs) == 1 and runs[0].reached > 0.0:
        return runs[0].breaks, runs[0].coefficients
    backward = next((run for run in runs if run.reached < 0.0), None)
    forward = next((run for run in runs if run.reached > 0.0), None)
    dense = joined(backward, forward)
    return dense.breaks, np.ascontiguousarray(dense.coefficients)


def samples_of(held: Held, times: FloatArray, rests: FloatArray | None) -> FloatArray:
    """Return the six variables at the times, shape (n, 6): what the dense output has there."""
    values = np.empty((operations.STATE, len(times)))
    values_at(held.breaks, held.coefficients, times, _NONE if rests is None else rests, values)
    return np.ascontiguousarray(values.T)
