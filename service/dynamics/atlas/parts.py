"""The parts of an atlas: a range of λ, the parts that it is cut into, and the changes between them."""

from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np
from flint import arb

from service.dynamics.atlas.bands import WindowSeries
from service.dynamics.atlas.changes import Change
from service.dynamics.atlas.curves import LambdaStretch, PlainHalves
from service.dynamics.errors import DynamicsError
from service.dynamics.problem import Sign

Proof = Literal["proved", "seen"]
"""Proved for every λ; or seen at single λ, so that a window narrower than their distance may be missed."""


@dataclass(frozen=True, slots=True)
class LambdaRange:
    """lower ≤ λ ≤ upper, and the signs of g1 and g3."""

    lower: Fraction
    upper: Fraction
    g1_sign: Sign = 1
    g3_sign: Sign = 1

    def primed(self, half: PlainHalves) -> tuple[float, float]:
        """Return the range of the primed λ, rounded outwards."""
        ends = [float(self.lower), float(self.upper)]
        if half.shape.is_mirrored:
            ends = [end ** -float(1 / half.shape.alpha) for end in reversed(ends)]
        # A power in doubles has an error of some units in the last place.
        return ends[0] * (1.0 - 1e-14), ends[1] * (1.0 + 1e-14)

    def ends(self, half: PlainHalves, first: LambdaStretch, last: LambdaStretch) -> tuple[arb, arb]:
        """Return the λ of the client's axes between which two stretches and all between them are."""
        found = [*half.sent(first), *half.sent(last)]
        lower = min(found, key=lambda end: float(end.mid()))
        upper = max(found, key=lambda end: float(end.mid()))
        least, most = (arb(end.numerator) / end.denominator for end in (self.lower, self.upper))
        return (least if lower < least else lower), (most if upper > most else upper)

    def samples_between(self, ends: tuple[arb, arb], samples: int, fewest: int) -> int:
        """Return how many of all ``samples`` belong to a part of the range."""
        share = np.log(float(ends[1].mid()) / float(ends[0].mid())) / np.log(float(self.upper / self.lower))
        return max(round(samples * float(share)), fewest)


@dataclass(frozen=True, slots=True)
class AtlasPart:
    """A part of the range on which the windows keep their number, kinds and ends."""

    lower: arb
    upper: arb
    series: WindowSeries | None
    """None, with ``reason``, where the kind of the windows is not settled at the λ that was looked at."""
    reason: DynamicsError | None


@dataclass(frozen=True, slots=True)
class Atlas:
    """All planar motions over a range of λ, in the order of growing λ of the client's axes."""

    range: LambdaRange
    parts: tuple[AtlasPart, ...]
    changes: tuple[Change, ...]
    """Outside of them and of ``undecided`` nothing changes."""
    undecided: tuple[tuple[arb, arb], ...]
    proof: Proof = "proved"
    """The proof that all its parts and changes have."""
