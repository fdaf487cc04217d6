"""Checks a quadrature by an integration, over the time that the integration is accurate.

The orbit of a planar motion may be unstable across the plane: then every
integrator leaves it after some periods, however good, because rounding grows
by the multiplier in each period. The witness knows how far it can be trusted:
by the difference of its own two runs.
"""

from math import isfinite

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.defect.equations import Equations
from service.dynamics.motion import CrossCheck, Motion
from service.dynamics.numerics import is_within
from service.dynamics.potentials.potential import Potential
from workers.solvers.integration.interface import neighbour_of
from workers.solvers.integration.run_pair import RunPair, Span, run_pair
from workers.solvers.integration.solve import IntegratorName, MakeIntegrator, choose_integrator, tolerances

FloatArray = NDArray[np.float64]

WITNESS_MAX_ERROR = 1e-9
"""A witness whose own error is larger than this (and than the tolerance) has nothing to say."""
CHECK_TIMES = 513
"""Equidistant times of the comparison, besides those asked for."""
MAX_STEPS: dict[str, int] = {"dop853": 4_000}
MAX_SERIES_STEPS = 20_000
"""Largest number of steps of a check: some seconds at most; hundreds of periods by series, tens by DOP853."""


def compare(
    quadrature: Motion,
    body: RigidBody,
    potential: Potential,
    tolerance: float,
    *,
    limit: float | None = None,
    integrator: IntegratorName | MakeIntegrator = "auto",
) -> CrossCheck:
    """Integrate from the quadrature's state at t = 0 over its times, and compare.

    Parameters
    ----------
    tolerance
        Largest absolute error that was allowed in any variable.
    limit
        Compare at |t| < ``limit`` only: where the quadrature passes a pole by a
        convention, the equations do not determine what follows.

    Raises
    ------
    MissingMomentError
        The body has no B.
    UnsupportedFormulaError
        The one by Taylor series was asked for by name and cannot be used.
    """
    chosen = choose_integrator(body, potential, integrator)
    state = quadrature.dense(np.zeros(1))[0]
    pair = run_pair(
        chosen,
        Equations.of(body, potential),
        state,
        _neighbour(state, quadrature.dense.error_at(np.zeros(1))),
        _span(quadrature.times, limit),
        local_tolerance=tolerances(chosen, tolerance)[-1],
        max_steps=MAX_STEPS.get(chosen.name, MAX_SERIES_STEPS),
    )
    times = np.concatenate([quadrature.times, pair.span.uniform(CHECK_TIMES), np.zeros(1)])
    times = times[(times >= pair.span.first) & (times <= pair.span.last)]
    times = times[np.argsort(np.abs(times), kind="stable")]
    witness = np.maximum.accumulate(pair.error_estimate(body, potential, times))
    meaningful = int(np.searchsorted(witness, max(tolerance, WITNESS_MAX_ERROR), side="right"))
    # A NaN estimate is not below any bound: searchsorted puts it last.
    times, witness = times[: max(1, meaningful)], witness[: max(1, meaningful)]
    disagreement = float(np.abs(pair.fine(times) - quadrature.dense(times)).max())
    horizon = float(np.abs(times[-1]))
    asked = float(np.abs(quadrature.times).max())
    allowed = quadrature.error + float(witness[-1]) + tolerance
    explained = isfinite(allowed) and is_within(disagreement, allowed)
    # A comparison at t = 0 alone, where the witness starts, confirms nothing.
    is_none = horizon == 0.0 and asked > 0.0
    return CrossCheck(
        method=f"integration ({chosen.name})",
        disagreement=disagreement,
        horizon=horizon,
        agrees=explained and not is_none,
        why_none=_why_none(chosen.name, pair, limit) if is_none else None,
    )


def _why_none(name: str, pair: RunPair, limit: float | None) -> str:
    """Return why the witness says nothing of any time but its start."""
    text = f"there is no cross-check: the integration ({name}) "
    if limit == 0.0:
        return f"{text}cannot follow the motion from t = 0 on, where it passes a pole by a convention"
    if pair.span.first == pair.span.last == 0.0 and pair.ending is not None:
        return f"{text}could not follow the motion from t = 0 on: {pair.ending.message}"
    return (
        f"{text}does not know its own digits: two runs of it differ by more than the tolerance from t = 0 on"
    )


def _span(times: FloatArray, limit: float | None) -> Span:
    bound = np.inf if limit is None else limit
    return Span(max(-bound, min(0.0, float(times.min()))), min(bound, max(0.0, float(times.max()))))


def _neighbour(state: FloatArray, error: float) -> FloatArray:
    """Return a state as far from ``state`` as the quadrature's error at t = 0 allows; zeros are exact."""
    rounded = np.array([neighbour_of(value) for value in state.tolist()])
    moved = state + np.where(state == 0.0, 0.0, np.copysign(error, state))
    return np.where(np.abs(moved) > np.abs(rounded), moved, rounded)
