"""Integrates the six Euler-Poisson equations from any state, with a measured error."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.defect.equations import Equations
from service.dynamics.equations.euler_poisson import energy_integral
from service.dynamics.motion import COLUMNS, Estimate, Motion
from service.dynamics.numerics import is_within
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import Problem
from service.dynamics.sampling import sample_times
from service.dynamics.solution.dense_output import DenseOutput
from workers.solvers.errors import AccuracyNotMetError, IntegrationError, UnsupportedFormulaError
from workers.solvers.evidence import COVERED, DEFECT, DRIFT, with_claim_raised
from workers.solvers.integration.interface import Integrator, Steps, neighbour_of
from workers.solvers.integration.run_pair import SHARED_RELATIVE_ROUNDING, RunPair, Span, run_pair
from workers.solvers.ways import is_plain

if TYPE_CHECKING:
    from workers.solvers.compiled.records import Asked
    from workers.solvers.integration.compiled import VerifiedRun

FloatArray = NDArray[np.float64]
IntegratorName = Literal["auto", "taylor", "dop853"]
MakeIntegrator = Callable[[RigidBody, Potential], Integrator]
"""Makes another one, which comparisons bring along."""

MAX_STEPS = 200_000
"""In one direction: some 0.1 GB of dense output, a second or more by series, a minute or more by DOP853."""
CHECK_TIMES = 257
"""Equidistant times, besides those asked for, at which the two runs are compared: with few times
asked the difference may vanish there by chance."""
RESIDUAL = "error_by_residual"
"""Key of the evidence: the error that what a run leaves of the equations makes, to first order."""
LOCAL_TOLERANCE = "local_tolerance"
"""Key of the evidence: that of the finer run."""
GROWTH = "grown_errors"
"""Key of the evidence: what errors that a run makes on its way have grown to, a part of the claim."""


def integrate_from(
    problem: Problem, omega: Sequence[Fraction | float], gamma: Sequence[Fraction | float]
) -> Motion:
    """Integrate from a state to the times of a problem, to its tolerance: see :func:`integrate_state`."""
    times = sample_times(problem.time, None)
    return integrate_state(
        problem.body,
        problem.potential,
        omega,
        gamma,
        times.doubles,
        tolerance=problem.tolerance,
        low_parts=times.low_parts,
    )


def integrate_state(
    body: RigidBody,
    potential: Potential,
    omega: Sequence[Fraction | float],
    gamma: Sequence[Fraction | float],
    times: FloatArray,
    *,
    tolerance: float,
    integrator: IntegratorName | MakeIntegrator = "auto",
    low_parts: FloatArray | None = None,
) -> Motion:
    """Integrate from omega = (p, q, r), gamma = (g1, g2, g3) at t = 0 to all ``times``, of either sign.

    With ``low_parts`` the times are the sums of both.
    ``tolerance`` is the largest absolute error allowed in any of the six
    variables at ``times``; the error of the result is measured by a second run.

    Raises
    ------
    MissingMomentError
        The body has no B.
    CollisionError, StepCollapseError
        The motion cannot be followed to all ``times``; both say until when it can.
    AccuracyNotMetError
        The finest local tolerance leaves a larger error than ``tolerance``.
    UnsupportedFormulaError
        The one by Taylor series was asked for by name and cannot be used.
    """
    times = np.asarray(times, dtype=np.float64)
    chosen = choose_integrator(body, potential, integrator)
    equations = Equations.of(body, potential)
    start = (*omega, *gamma)
    state = np.array([float(number) for number in start])
    neighbour = np.array([neighbour_of(number) for number in start])
    run_request = run_request_of(times, tolerance)
    span, check = run_request.span, run_request.check
    reached = np.inf
    for local_tolerance in tolerances(chosen, tolerance):
        verified = run_request.try_kernels(chosen, state, neighbour, local_tolerance)
        if isinstance(verified, float):
            reached = min(reached, verified)
            continue
        if isinstance(verified, IntegrationError):
            raise verified
        if verified is not None:
            return _verified_motion(verified, times, low_parts, local_tolerance / chosen.tightening)
        pair = run_pair(
            chosen, equations, state, neighbour, span, local_tolerance=local_tolerance, max_steps=MAX_STEPS
        )
        if pair.ending is not None:
            raise pair.ending
        error = float(pair.error_estimate(body, potential, check).max())
        if is_within(error, tolerance):
            found = _motion(
                replace(pair.fine, error=error),
                times,
                pair.fine(times),
                _energy(pair, body, potential, check),
                {
                    "integrator": chosen.name,
                    "steps": pair.steps,
                    LOCAL_TOLERANCE: pair.local_tolerance,
                    "difference_of_runs": float(pair.difference(check).max()),
                    RESIDUAL: float(pair.residual.max()),
                    GROWTH: float(pair.growth.max()),
                },
            )
            found = with_claim_raised(body, potential, found)
            if is_within(found.error, tolerance):
                return replace(found, samples=pair.fine(times, low_parts), low_parts=low_parts)
            error = found.error
        reached = min(reached, error)
    raise AccuracyNotMetError(reached, tolerance)


@dataclass(frozen=True, slots=True)
class RunRequest:
    """A request for the motions of one or many states: the times, and the largest error."""

    span: Span
    check: FloatArray
    """Times of the comparison of two runs: those asked for, and others."""
    tolerance: float

    def try_kernels(
        self, integrator: Integrator, state: FloatArray, neighbour: FloatArray, local_tolerance: float
    ) -> "VerifiedRun | IntegrationError | float | None":
        """Return what kernels settle alone: see :func:`.compiled.verified_run`."""
        if integrator.name != "taylor":
            return None
        from workers.solvers.integration import compiled  # noqa: PLC0415

        if not isinstance(integrator, compiled.CompiledIntegrator):
            return None
        asked = self.asked(integrator, local_tolerance)
        return compiled.verified_run(integrator, state, neighbour, self.check, asked)

    def asked(self, integrator: Steps, local_tolerance: float) -> "Asked":
        """Return what is asked of kernels."""
        from workers.solvers.integration import compiled  # noqa: PLC0415

        return compiled.pair_request(
            integrator,
            self.span,
            local_tolerance=local_tolerance,
            max_steps=MAX_STEPS,
            tolerance=self.tolerance,
            is_last=local_tolerance == tolerances(integrator, self.tolerance)[-1],
        )


def run_request_of(times: FloatArray, tolerance: float) -> RunRequest:
    """Return the request for the motions at all ``times``."""
    span = Span(min(0.0, float(times.min())), max(0.0, float(times.max())))
    return RunRequest(span, np.concatenate([times, span.uniform(CHECK_TIMES)]), tolerance)


def choose_integrator(
    body: RigidBody, potential: Potential, name: IntegratorName | MakeIntegrator
) -> Integrator:
    """Return the integrator called ``name``; ``auto`` is the compiled one wherever it can be used.

    Raises
    ------
    MissingMomentError
        The body has no B.
    UnsupportedFormulaError
        The one by Taylor series was asked for by name and cannot be used.
    """
    # Not at the top: SciPy and the compiler take most of the time that a solver needs to start, and
    # not every motion needs each of them.
    if callable(name):
        return name(body, potential)
    if name == "dop853" or (name == "auto" and is_plain()):
        return _by_scipy(body, potential)
    from workers.solvers.integration.compiled import integrator_of  # noqa: PLC0415

    try:
        return integrator_of(body, potential)
    except UnsupportedFormulaError:
        if name == "taylor":
            raise
        return _by_scipy(body, potential)


def _by_scipy(body: RigidBody, potential: Potential) -> Integrator:
    from workers.solvers.integration.dop853 import Dop853Integrator  # noqa: PLC0415

    return Dop853Integrator(body, potential)


def tolerances(integrator: Steps, tolerance: float) -> list[float]:
    """Return the local tolerances to try, of the coarser run: by the tolerance, then the finest."""
    finest = integrator.finest * integrator.tightening
    first = integrator.first_share * tolerance
    # What is hardly looser than the finest would take the same steps.
    has_other_steps = first > integrator.tightening * finest
    return [min(first, integrator.coarsest), finest] if has_other_steps else [finest]


def _verified_motion(
    verified: "VerifiedRun", times: FloatArray, low_parts: FloatArray | None, local_tolerance: float
) -> Motion:
    from workers.solvers.integration.compiled import samples_of  # noqa: PLC0415

    motion = _motion(
        DenseOutput(COLUMNS, verified.breaks, verified.coefficients, None, verified.error),
        times,
        samples_of(verified, times, low_parts),
        Estimate(verified.energy, verified.energy_error, "estimate"),
        {
            "integrator": "taylor",
            "steps": len(verified.breaks) - 1,
            LOCAL_TOLERANCE: local_tolerance,
            "difference_of_runs": verified.difference,
            GROWTH: verified.growth,
            DEFECT: verified.defect,
            DRIFT: verified.drift,
            COVERED: 1.0,
        },
    )
    return replace(motion, low_parts=low_parts)


def _motion(
    dense: DenseOutput,
    times: FloatArray,
    samples: FloatArray,
    energy: Estimate,
    evidence: dict[str, float | int | str],
) -> Motion:
    return Motion(
        method="integration",
        dense=dense,
        times=times,
        samples=samples,
        error=dense.error,
        samples_kind="difference",
        function_kind="difference",
        energy=energy,
        window=None,
        aperiodic=None,
        past=None,
        future=None,
        cross_check=None,
        conventions=(),
        evidence=evidence,
    )


def _energy(pair: RunPair, body: RigidBody, potential: Potential, check: FloatArray) -> Estimate:
    """Return the energy at t = 0; its error is how far it strays along the motion, which rounds it anew."""
    states = pair.fine(np.concatenate([np.zeros(1), check]))
    h = energy_integral(body, potential, states[:, :3], states[:, 3:])
    error = float(np.abs(h - h[0]).max() + SHARED_RELATIVE_ROUNDING * abs(h[0]))
    return Estimate(float(h[0]), error, "estimate")
