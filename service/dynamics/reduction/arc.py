"""An arc of the loop on which p² > 0, and the kinds of its two ends."""

import math
from dataclasses import dataclass, field
from typing import Literal

from flint import arb, ctx

from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.root_finding.gap import NearRest

ArcEnd = Literal["rest", "double", "standstill", "flat", "collision", "pole", "edge"]
"""A simple zero of P; a zero of order two or more; one of an order between these; one of no order that is
known; P → ∞, at a pole or elsewhere; a pole that is not passed; the edge of the potential's domain."""


QUARTER = 0.5 * math.pi
ASIDE = 2.0**-30
"""Distance between doubles at which balls agree about what is inside: more than these are rounded by."""


@dataclass(frozen=True, slots=True)
class Arc:
    """A maximal interval lower ≤ v ≤ upper with p² ≥ 0, or the whole loop."""

    loop: Loop
    lower: arb
    upper: arb
    lower_end: ArcEnd | None
    """None, with ``upper_end``, if the arc is the whole loop: p never vanishes."""
    upper_end: ArcEnd | None
    slow: tuple[NearRest, ...] = field(default=(), compare=False, repr=False)
    """Places of the whole loop, −π < v < π, where P nearly touches 0."""

    @property
    def is_whole_loop(self) -> bool:
        """Tell whether the motion goes round the loop."""
        return self.lower_end is None

    @property
    def poles(self) -> list[arb]:
        """Return the v inside the arc where it passes a pole: multiples of π."""
        return self._inside(0)

    @property
    def equators(self) -> list[arb]:
        """Return the v inside the arc where it crosses the equator: odd multiples of π/2."""
        return self._inside(1)

    def _inside(self, parity: int) -> list[arb]:
        # An arc lies within −2π ≤ v ≤ 2π.
        low, high = float(self.lower) - ASIDE, float(self.upper) + ASIDE
        quarters = [k for k in range(-4, 5) if k % 2 == parity and low < k * QUARTER < high]
        if not quarters:
            return []
        # An end next to one of them may be known to many more bits than the current precision.
        with ctx.workprec(max(ctx.prec, self.lower.bits(), self.upper.bits())):
            places = [arb.pi() * k / 2 for k in quarters]
            return [v for v in places if self.lower < v and v < self.upper]
