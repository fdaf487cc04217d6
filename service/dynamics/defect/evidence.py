r"""Evidence that a function of time gives of its own error, and the least claim that goes with it.

Let ε be the claimed bound of the error of the six variables. If it is true, then at every time

.. math::
    |D(t)| \le 2\varepsilon + \int |F(y) - F(y_p)|\,dt , \qquad
    |I(y_p(t)) - I| \le \max_{|y - y_p| \le \varepsilon} |I(y) - I(y_p)|

for the integrated defect D (:mod:`.accumulation`) and each of the three integrals I. Both right-hand sides
are bounded by discs of the radius ε about the states. A claim that breaks one of the bounds is false, and is
raised: by D to all of what D has accumulated, times what F amplifies over the same time, as far as
``MAX_CLAIM_GROWTH`` goes; by an integral until the bound holds; and beyond all bounds by a stretch too short
to be cut on which V may vary without any node having seen it. So the claim is never
below what the solution itself shows. It is not proved by that: errors grow where motions are unstable, and no
defect tells how far.

At a kink, or where a power such as |g1|^(4/3) has no second derivative, V itself hardly varies on a stretch
so short; nor where it divides 0 by 0 and has a limit. A wall or a well that is narrower than it lets V vary
by its height, which no node need have seen.
"""

from dataclasses import dataclass
from math import inf, isfinite, nan

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.defect.accumulation import SERIES_RELATIVE_ROUNDING, Blocks, StretchBatch, accumulate
from service.dynamics.defect.equations import Equations
from service.dynamics.motion import Estimate
from service.dynamics.numerics import is_within, largest
from service.dynamics.potentials.potential import Potential
from service.dynamics.solution.dense_output import DenseOutput

FloatArray = NDArray[np.float64]
HIDDEN_VARIATION = 1e-6
"""Variation of V on such a stretch that is looked for."""
VARIATION_RATIO = 100.0
"""How many times the variation seen at the nodes it must be: intervals add up what cancels."""
SLOPE_RATIO = 10.0
"""And how many times what the slopes at the nodes make of the whole stretch: along a curve on which V hardly
varies those in γ1 and in γ2 cancel, in intervals they do not."""
LEBESGUE_BOUND = 4.0
"""More than the Lebesgue constant of forty Chebyshev points: a polynomial that is at most 1 at them is
at most this between them."""
WIDER_FOR_ZEROS = 4.0
"""How many times wider a stretch is taken to look for places in g2 where V divides 0 by 0."""
NEAR_POLE_DISTANCE = 1e-3
"""Limit of |g1| and |g3| below which a state is next to a pole: V may have a limit there and no value."""


@np.errstate(all="ignore")
def hides_something(equations: Equations, block: StretchBatch, *, is_planar: bool) -> NDArray[np.bool_]:
    """Say on which stretches V may vary by more than any node shows, shape (n,); not where F is bounded.

    A planar motion comes to g1 = 0 or g3 = 0 at a pole only: where doubles do not tell one of them from 0, it
    is next to a pole, however large the other one still is, as |g3| ~ |g1|^(C/A) is where A/C is large.
    """
    hidden = ~block.stretches.is_settled
    if not hidden.any():
        return hidden
    gamma = block.states[hidden, :, 3:]
    middle = gamma[:, gamma.shape[1] // 2]
    size = np.abs(gamma).max(axis=1)
    radius = LEBESGUE_BOUND * np.abs(gamma - middle[:, None]).max(axis=1) + SERIES_RELATIVE_ROUNDING * size
    varies = equations.value_spread(middle.T, radius.T)
    V = block.integrals[hidden, :, 0] - kinetic_of(equations, block.states[hidden])
    seen = VARIATION_RATIO * (V.max(axis=1) - V.min(axis=1))
    explained = SLOPE_RATIO * np.vecdot(np.abs(equations.slopes(gamma)).max(axis=1), radius)
    small = size[:, [0, 2]]
    at_pole = (small < NEAR_POLE_DISTANCE).all(axis=1) | (
        is_planar & (small < SERIES_RELATIVE_ROUNDING).any(axis=1)
    )
    most = HIDDEN_VARIATION + np.fmax(_finite(seen), _finite(explained))
    hides = ~(varies <= most) & ~at_pole
    # A place where V divides 0 by 0 may be beside the stretch, where intervals are wide.
    wide = radius * [1.0, WIDER_FOR_ZEROS, 1.0]
    for k in np.flatnonzero(hides):
        hides[k] = not equations.spread_about_zeros(middle[k], wide[k]) <= most[k]
    hidden[hidden] = hides
    return hidden


def _finite(variations: FloatArray) -> FloatArray:
    """Return variations, 0 where a node has none: it says nothing."""
    return np.where(np.isfinite(variations), variations, 0.0)


def kinetic_of(equations: Equations, states: FloatArray) -> FloatArray:
    """Return (A p² + B q² + C r²)/2, shape (...)."""
    kinetic: FloatArray = 0.5 * (equations.moments * states[..., :3] ** 2).sum(axis=-1)
    return kinetic


MAX_CLAIM_GROWTH = 64.0
"""Largest multiple of the claim that is put down to its own growth by F: in a feature narrower than the claim
any defect would pass for that."""
TRUNCATION_SHARE = 0.1
"""Share of the claim that the truncation of F may be."""
MIN_TRUNCATION = 1e-17
"""Least truncation asked for, beside variables of the size 1: far below their rounding."""
FIRST_TRUNCATION = 1e-7
"""The truncation allowed at first."""
MAX_DEFECT_CLAIMS = 1e3
"""A defect beyond so many claims is told without more digits."""
STATE_RELATIVE_ROUNDING = 2.0**-50
"""Rounding error of a state, relative to its size."""
ERROR_QUARTER_POWERS = np.arange(1.0, 31.0)
"""Powers of 1/4 of an error that are tried where V is not bounded within it: down to 1e-18 of it."""


@dataclass(frozen=True, slots=True)
class ResidualEvidence:
    """The evidence that a function of time gives of its own error."""

    defect: float
    """Bound of |D| over all stretches that are settled; without a formula the value seen."""
    drift: float
    """Largest departure of the energy, the areas integral, or γ·γ seen between and at the nodes."""
    settled: float
    """Share of the time for which the bound of the defect is a theorem; 0 without a formula."""
    error: float
    """The claim, raised as far as the above shows that it is too small."""


def check_residual(
    body: RigidBody,
    potential: Potential,
    dense: DenseOutput,
    claim: float,
    energy: Estimate,
    *,
    is_planar: bool,
) -> ResidualEvidence:
    """Hold the six variables of ``dense``, claimed to be within ``claim``, against equations and integrals.

    The integrals of a planar motion are its energy, 0 and 1; of another those at t = 0.
    """
    if not (np.isfinite(dense.coefficients).all() and np.isfinite(dense.breaks).all() and isfinite(claim)):
        return ResidualEvidence(nan, nan, 0.0, nan)
    equations = Equations.of(body, potential)
    has_formula = equations.tape is not None
    goal = max(TRUNCATION_SHARE * claim, MIN_TRUNCATION * float(np.abs(dense.coefficients).max(initial=1.0)))
    bound = equations.bound if has_formula else None
    pieces = Blocks(dense, equations.at, bound)
    for wanted in (max(goal, FIRST_TRUNCATION), goal):
        # What was not resolved shows at once, where bounds to the last digit would be dear.
        blocks = list(pieces.cut(wanted))
        found = accumulate(dense, blocks, has_bounds=has_formula)
        defect = float(found.sizes.max())
        if (
            found.truncation <= goal
            or defect - found.truncation > MAX_DEFECT_CLAIMS * claim + FIRST_TRUNCATION
        ):
            break
    error = claim
    if not is_within(defect, 2.0 * claim):
        defect, error = _by_defect(equations, dense, blocks, defect, claim)
    if has_formula and any(hides_something(equations, block, is_planar=is_planar).any() for block in blocks):
        error = inf
    drift, raised = _by_integrals(equations, dense, blocks, error, energy, is_planar=is_planar)
    return ResidualEvidence(defect, drift, found.settled_share if has_formula else 0.0, raised)


def check_samples(
    body: RigidBody, potential: Potential, samples: FloatArray, claim: float, energy: Estimate
) -> float:
    """Return the claim of planar ``samples``, shape (n, 6), raised as far as their integrals show."""
    equations = Equations.of(body, potential)
    reference = np.array([energy.value, 0.0, 1.0])
    slack = np.array([energy.error, 0.0, 0.0])
    drifts = _drifts(equations.at(samples)[1], reference)
    return _raised(equations, samples, drifts, claim, reference, slack)


def _by_defect(
    equations: Equations, dense: DenseOutput, blocks: list[StretchBatch], defect: float, claim: float
) -> tuple[float, float]:
    """Return what of the defect no rounding of the states explains, and the claim raised by it."""
    if equations.tape is None:
        # Without bounds of F its rounding is not known: D counts beyond the claim's own growth only.
        return defect, claim if is_within(defect, (2.0 + MAX_CLAIM_GROWTH) * claim) else defect
    rounding, growth = (_spread(equations, dense, blocks, radius) for radius in (0.0, claim))
    defect = float(accumulate(dense, blocks, has_bounds=True, excused=rounding).sizes.max())
    # What is not known amplifies nothing.
    more = float(np.where(np.isfinite(growth), growth - rounding, 0.0).sum(axis=0).max())
    amplified = min(more, MAX_CLAIM_GROWTH * claim) if more > 0.0 else 0.0
    if is_within(defect, 2.0 * claim + amplified):
        return defect, claim
    return defect, defect * (1.0 + amplified / claim) if claim != 0.0 else defect


@np.errstate(all="ignore")
def _spread(
    equations: Equations, dense: DenseOutput, blocks: list[StretchBatch], radius: float
) -> FloatArray:
    """Return what the integral of F over each stretch differs by, where states differ by ``radius``.

    And by their rounding, which is that of the largest in their piece: next to a pole g1 and g3 are small
    beside it, and F may depend on them without bound. Shape (n, 6); NaN where F has no bound.
    """
    sizes = np.abs(dense.coefficients).sum(axis=1)
    found = []
    for block in blocks:
        states, radii = block.states, radius + STATE_RELATIVE_ROUNDING * sizes[block.stretches.piece]
        each = np.broadcast_to(radii[:, None], states.shape).reshape(-1, 6).T
        wide = equations.spread(states.reshape(-1, 6).T, each).T.reshape(states.shape).max(axis=1)
        found.append(2.0 * block.times[:, None] * np.where(np.isfinite(wide), wide, nan))
    return np.concatenate(found)


def _by_integrals(
    equations: Equations,
    dense: DenseOutput,
    blocks: list[StretchBatch],
    claim: float,
    energy: Estimate,
    *,
    is_planar: bool,
) -> tuple[float, float]:
    reference, slack = np.array([energy.value, 0.0, 1.0]), np.array([energy.error, 0.0, 0.0])
    if not is_planar:
        at_0 = dense(np.clip(np.zeros(1), dense.breaks[0], dense.breaks[-1]))
        reference[1:] = equations.at(at_0)[1][0, 1:]
    drift, error = 0.0, claim
    for block in blocks:
        drifts = _drifts(block.integrals.reshape(-1, 3), reference)
        if equations.tape is None:
            drifts[_is_at_pole(dense, block), 0] = 0.0
        drift = largest((drift, float(drifts.max(initial=0.0))))
        error = _raised(equations, block.states.reshape(-1, 6), drifts, error, reference, slack)
    return drift, error


def _is_at_pole(dense: DenseOutput, block: StretchBatch) -> NDArray[np.bool_]:
    """Say at which states g1 and g3 are roundings of their piece or its times: V1 depends on g3/g1 there."""
    piece = block.stretches.piece
    lengths = np.diff(dense.breaks)[piece]
    later = np.abs(dense.breaks[1:])[piece] / lengths
    sizes = np.abs(dense.coefficients[:, 1:]).sum(axis=1)[piece] * (
        STATE_RELATIVE_ROUNDING * (1.0 + later[:, None])
    )
    is_small: NDArray[np.bool_] = np.abs(block.states) <= sizes[:, None]
    return (is_small[..., 3] & is_small[..., 5]).ravel()


@np.errstate(all="ignore")
def _drifts(integrals: FloatArray, reference: FloatArray) -> FloatArray:
    """Return the departures; 0 for the energy of a state where V has no value, as next to a pole.

    NaN where the state, or what it is compared with, is not finite: that passes no bound.
    """
    drifts: FloatArray = np.abs(integrals - reference)
    # The other two integrals have a value wherever the state has one.
    has_none = ~np.isfinite(integrals[:, 0]) & np.isfinite(integrals[:, 1:]).all(axis=1)
    drifts[has_none & np.isfinite(reference[0]), 0] = 0.0
    return drifts


@np.errstate(all="ignore")
def _raised(
    equations: Equations,
    states: FloatArray,
    drifts: FloatArray,
    claim: float,
    reference: FloatArray,
    slack: FloatArray,
) -> float:
    """Return the claim, doubled until the integrals are where it lets them be; NaN if one is not known."""
    if not (np.isfinite(drifts).all() and np.isfinite(slack).all()):
        return nan
    if equations.tape is None:
        return claim
    is_small = _are_small(equations, states, drifts, claim, slack)
    if is_small.all():
        return claim
    error = largest((claim, float(np.finfo(np.float64).tiny)))
    columns = states[~is_small].T
    says_nothing = _has_no_energy(equations, columns)
    while error < 1.0:
        explained = _explained(equations, columns, error, reference, slack)
        explained[0] |= says_nothing
        # V may be unbounded within the claim of a state: a smaller error that explains it will do. Next to a
        # pole on a coordinate plane that is one relative to the coordinate, or rounding alone.
        for less in (np.minimum(error, 0.5 * np.abs(columns)), 0.0, *(error * 4.0**-ERROR_QUARTER_POWERS)):
            if explained.all():
                break
            explained |= _explained(equations, columns, less, reference, slack)
        beyond = ~explained.all(axis=0)
        if not beyond.any():
            return error
        columns, says_nothing = columns[:, beyond], says_nothing[beyond]
        error = 2.0 * error
    return error


def _explained(
    equations: Equations,
    columns: FloatArray,
    error: float | FloatArray,
    reference: FloatArray,
    slack: FloatArray,
) -> NDArray[np.bool_]:
    """Say which integrals an ``error`` of the states lets be what they are, shape (3, n); not if unknown.

    The error is one for all variables, or one for each, shape (6, n).
    """
    centres, radii = equations.integrals_on(columns, error + STATE_RELATIVE_ROUNDING * np.abs(columns))
    return np.asarray(np.abs(centres - reference[:, None]) <= radii + slack[:, None])


def _has_no_energy(equations: Equations, columns: FloatArray) -> NDArray[np.bool_]:
    """Say which states doubles do not tell from a place where V has no value, shape (n,)."""
    centres, radii = equations.integrals_on(columns, STATE_RELATIVE_ROUNDING * np.abs(columns))
    has_none: NDArray[np.bool_] = ~np.isfinite(centres[0] + radii[0])
    return has_none


def _are_small(
    equations: Equations, states: FloatArray, drifts: FloatArray, claim: float, slack: FloatArray
) -> NDArray[np.bool_]:
    """Say at which states, shape (n,), the drifts are below what the claim lets the integrals change.

    V is left out: the kinetic energy, the areas and γ·γ.
    """
    moments, size = equations.moments, np.abs(states)
    least = claim * np.stack(
        [
            (size[:, :3] * moments).sum(axis=1),
            (size * np.concatenate([moments, moments])).sum(axis=1),
            2.0 * size[:, 3:].sum(axis=1),
        ],
        axis=1,
    )
    return np.asarray((drifts <= least + slack).all(axis=1))
