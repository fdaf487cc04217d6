"""Stretches too short to be cut again, about which the equations have no bound, and what may hide on them.

At a kink, or where a power such as |g1|^(4/3) has no second derivative, V itself hardly varies on a stretch
so short; nor where it divides 0 by 0 and has a limit. A wall or a well that is narrower than it lets V vary
by its height, which no node need have seen.
"""

import numpy as np
from numpy.typing import NDArray

from service.dynamics.defect.accumulation import StretchBatch
from service.dynamics.defect.equations import Equations
from service.dynamics.defect.stretches import SERIES_RELATIVE_ROUNDING

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
