"""Integrates by Taylor series of high order in compiled code, which is the same for all formulas.

What a formula does is a list of operations that kernels go through (:mod:`workers.solvers.compiled.general`):
nothing is compiled for a potential or a body. Four runs tell the error by their differences, and the finest
is held against the equations, by kernels too; what these do not settle goes through
:func:`.interface.followed`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import inf

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.defect.evidence import MIN_TRUNCATION, TRUNCATION_SHARE
from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.potentials.potential import FormulaPotential, Potential
from service.dynamics.solution.dense_output import UNIT_ROUNDOFF
from workers.solvers.compiled.evaluation.program import Program, make_program, numbers_of
from workers.solvers.compiled.general.run_pair import (
    COLLIDED,
    NUMBERS,
    OPEN,
    VERIFIED,
    solve_pair,
    solve_pairs,
)
from workers.solvers.compiled.general.sampling import TIMES_TOGETHER, values_at
from workers.solvers.compiled.general.steps import (
    ARRIVED,
    ORDER,
    STATE,
    STEP_SHARE,
    TIRED,
    new_pieces,
    seen,
    take_steps,
)
from workers.solvers.compiled.lanes import LANES
from workers.solvers.compiled.records import Asked, Equations, Gradient, Models
from workers.solvers.compiled.residual.nodes import in_lanes
from workers.solvers.compiled.residual.residual import hold
from workers.solvers.errors import (
    CollisionError,
    IntegrationError,
    UndefinedStartError,
    UnsupportedFormulaError,
)
from workers.solvers.integration.interface import (
    COLLAPSED_STEP_RATIO,
    COLLISION_GRADIENT_GROWTH,
    MAX_DEFECT_TOLERANCES,
    STEP_RELATIVE_ROUNDING,
    UNCHECKED_TIME_SHARE,
    Rounding,
    Run,
    Steps,
    collapse,
    neighbour_of,
    rounded_moments,
    too_many_steps,
)
from workers.solvers.integration.programs import shared_gradient
from workers.solvers.integration.run_pair import (
    COARSE_DEFECT_RATIO,
    DIFFERENCE_FACTOR,
    SHARED_RELATIVE_ROUNDING,
    Span,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

RADIUS_DOUBT = 1.25
"""Factor by which a radius of convergence that two terms tell may be too large."""
_NONE, _NO_REFERENCE = np.empty(0), np.zeros(3)


class CompiledIntegrator:
    """The six equations for the kernels."""

    name = "taylor"
    finest = 1e-20
    coarsest = 5e-13  # longer steps are cut again when they are held against the equations, and cost more
    first_share = 5e-4
    leaves_out = 1.0
    tightening = 5.0  # the claim is four times the error of the coarser run: not much above that of the finer

    def __init__(
        self, body: RigidBody, potential: FormulaPotential, rounding: Rounding = nearest_double
    ) -> None:
        """Prepare the operations; raises MissingMomentError, UnsupportedFormulaError."""
        self._body, self._potential, self._rounding = body, potential, rounding
        self.moments = rounded_moments(body, rounding)
        self.gradient = _gradient_program(potential, rounding)

    @cached_property
    def _other(self) -> "CompiledIntegrator":
        return CompiledIntegrator(self._body, self._potential, neighbour_of)

    @cached_property
    def equations(self) -> Equations:
        """The equations by V and its gradient, with rounded constants."""
        program, constants = _formula_program(self._potential, self._rounding)
        return Equations(program.gradient, constants, self.moments)

    @cached_property
    def structure(self) -> tuple[object, ...]:
        """Key shared by integrators whose motions can be computed side by side."""
        program, (code, constants, places, registers) = self.equations.gradient, self.gradient
        of_series = code.tobytes(), len(constants), places.tobytes(), registers
        return program.code.tobytes(), program.results.tobytes(), *of_series

    @cached_property
    def models(self) -> Models:
        """The model of its own."""
        return models_of([self])

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
            return Run(np.zeros(1), np.zeros((0, 1, 6)), UndefinedStartError())
        last = coefficients[-1].sum(axis=0) if len(coefficients) else state
        end_gradient = self._potential.gradient(last[3:])
        ending = collapse(since + run.reached, start_gradient, end_gradient)
        return Run(breaks, coefficients, ending)

    def keeps(self, run: Run, goal: float, allowed: float) -> bool:
        """See Integrator.keeps."""
        padded = in_lanes(run.coefficients)
        is_kept, _, _ = hold(
            self.equations,
            run.breaks,
            padded,
            padded.shape[1],
            goal,
            allowed,
            False,
            0.0,
            _NO_REFERENCE,
            0.0,
            0.0,
        )
        return bool(is_kept)

    def steps(
        self, state: FloatArray, end: float, *, local_tolerance: float, max_steps: int, longest: float = inf
    ) -> tuple[int, FloatArray, FloatArray]:
        """Return how the kernel's run ends, its breaks and its series."""
        statuses, counts, breaks, pieces, _ = take_steps(
            self.gradient.code,
            self.gradient.gradient,
            self.gradient.constants[:, None],
            self.moments[:, None],
            self.gradient.registers,
            state[:, None],
            np.array([float(end)]),
            np.array([local_tolerance]),
            max_steps,
            longest,
            COLLAPSED_STEP_RATIO,
            new_pieces(1),
        )
        count = int(counts[0])
        length, _ = seen(pieces[0, :count])
        return int(statuses[0]), breaks[0, : count + 1].copy(), pieces[0, :count, :length, :STATE].copy()


def models_of(integrators: Sequence[CompiledIntegrator]) -> Models:
    """Return the models of integrators of one structure."""
    first = integrators[0]
    others = [integrator.neighbour() for integrator in integrators]
    return Models(
        first.equations.gradient,
        first.gradient.code,
        first.gradient.gradient,
        first.gradient.registers,
        np.array([integrator.equations.constants for integrator in integrators]),
        np.array([integrator.gradient.constants for integrator in integrators]),
        np.array([integrator.gradient.constants for integrator in others]),
        np.array([integrator.moments for integrator in integrators]),
        np.array([integrator.moments for integrator in others]),
    )


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
    return shared_gradient(potential.tape, rounding).gradient


@lru_cache(maxsize=64)
def _formula_program(potential: FormulaPotential, rounding: Rounding) -> tuple[Program, FloatArray]:
    program, constants = make_program(potential.tape)
    for slot, number in enumerate(numbers_of(potential.tape)):
        if number is not None:
            constants[slot] = rounding(number)
    return program, constants


@dataclass(frozen=True, slots=True)
class VerifiedRun:
    """Runs that arrive, the finest of which keeps the equations in every step, and what they show."""

    breaks: FloatArray
    coefficients: FloatArray
    """Series of the finer run, as :class:`~service.dynamics.solution.dense_output.DenseOutput` has them."""
    error: float
    """The claim; not below what the motion shows."""
    difference: float
    energy: float
    energy_error: float
    defect: float
    drift: float
    growth: float
    """Part of the claim: what errors that the run makes on its way grow to."""


def pair_request(
    integrator: Steps,
    span: Span,
    *,
    local_tolerance: float,
    max_steps: int,
    tolerance: float,
    is_last: bool = True,
) -> Asked:
    """Return what :func:`.run_pair.run_pair` asks of two runs, the looser ``local_tolerance`` being given.

    Unless it ``is_last``, finer runs follow where these are not accurate enough.
    """
    finer = local_tolerance / integrator.tightening
    return Asked(
        first=span.first,
        last=span.last,
        fine=finer,
        coarse=local_tolerance,
        max_steps=max_steps,
        collapsed=COLLAPSED_STEP_RATIO,
        singular=COLLISION_GRADIENT_GROWTH,
        before_the_end=UNCHECKED_TIME_SHARE,
        tolerance=tolerance,
        safety=DIFFERENCE_FACTOR,
        rounding=SHARED_RELATIVE_ROUNDING,
        noise=UNIT_ROUNDOFF,
        tail=_tail_of(finer),
        fine_defect=max(MAX_DEFECT_TOLERANCES * finer, STEP_RELATIVE_ROUNDING),
        coarse_defect=max(
            MAX_DEFECT_TOLERANCES * local_tolerance, COARSE_DEFECT_RATIO * STEP_RELATIVE_ROUNDING
        ),
        goal=TRUNCATION_SHARE,
        finest=MIN_TRUNCATION,
        is_last=is_last,
    )


def _tail_of(local_tolerance: float) -> float:
    """Return x / (1 - x) of steps that are up to x of the radius of convergence.

    That is read off the largest variable: that of one of 1e-7 times its size may be half as large, which is
    within the safety by which all growth is multiplied.
    """
    x: float = min(0.75, RADIUS_DOUBT * STEP_SHARE * local_tolerance ** (1.0 / (ORDER + 1)))
    return x / (1.0 - x)


def verified_run(
    integrator: CompiledIntegrator, state: FloatArray, neighbour: FloatArray, check: FloatArray, asked: Asked
) -> VerifiedRun | IntegrationError | float | None:
    """Return what :func:`.run_pair.run_pair` finds where all is settled by kernels; None where not.

    An error is a singularity that the motion runs into. A number is the estimated error of the finer run,
    where that is larger than the tolerance; infinity where finer runs follow, since then the estimate is not
    held against the equations.
    """
    status, breaks, coefficients, found = solve_pair(integrator.models, state, neighbour, check, asked)
    if status == OPEN:
        return None
    numbers: list[float] = found.tolist()
    if status == COLLIDED:
        time, error, *gradients = numbers[:4]
        return CollisionError(time=time, error=error, start=gradients[0], end=gradients[1])
    if status == VERIFIED:
        return VerifiedRun(breaks, coefficients, *numbers)
    return numbers[0] if asked.is_last else inf


@dataclass(frozen=True, slots=True)
class VerifiedRuns:
    """The results of many motions that were integrated at once."""

    endings: IntArray
    """HELD, INACCURATE, OPEN or COLLIDED, shape (n,)."""
    numbers: FloatArray
    """Error, difference, energy, its error, defect, drift, and the part of growth, shape (n, 7)."""
    samples: FloatArray
    """The six variables at the times, shape (n, times, 6)."""


def verified_runs(
    models: Models,
    which: IntArray,
    states: FloatArray,
    neighbours: FloatArray,
    check: FloatArray,
    asked: Asked,
    times: FloatArray,
    low_parts: FloatArray | None,
) -> VerifiedRuns:
    """Return what :func:`verified_run` finds of many motions, and their values at ``times``.

    ``which`` has the models of the motions; the states have the shape (n, 6).
    """
    count, rows = len(states), -(-len(times) // TIMES_TOGETHER) * TIMES_TOGETHER
    endings, numbers = np.full(count, OPEN), np.full((count, NUMBERS), np.nan)
    samples = np.empty((count, rows, LANES))
    solve_pairs(
        models,
        which,
        states,
        neighbours,
        check,
        asked,
        times,
        _NONE if low_parts is None else low_parts,
        endings,
        numbers,
        samples,
    )
    return VerifiedRuns(endings, numbers, samples[:, : len(times), :STATE])


def samples_of(verified: VerifiedRun, times: FloatArray, low_parts: FloatArray | None) -> FloatArray:
    """Return the six variables at the times, shape (n, 6): what the dense output has there."""
    values = np.empty((-(-len(times) // TIMES_TOGETHER) * TIMES_TOGETHER, LANES))
    series = in_lanes(verified.coefficients)
    low = _NONE if low_parts is None else low_parts
    values_at(verified.breaks, series, series.shape[1], times, low, values)
    return values[: len(times), :STATE].copy()
