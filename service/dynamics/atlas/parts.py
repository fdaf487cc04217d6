"""The parts of an atlas: a range of λ, the parts that it is cut into, and the changes between them.

Between two parts windows appear, vanish, merge or split, or an end moves.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.atlas.bands import Measured, WindowSeries
from service.dynamics.atlas.curves import LambdaStretch, PlainHalves
from service.dynamics.atlas.sign_maps import EQUATOR, Signature, signs_in
from service.dynamics.atlas.zeros import Zeros
from service.dynamics.errors import DynamicsError
from service.dynamics.problem import Sign

FloatArray = NDArray[np.float64]

ChangeKind = Literal[
    "window_appears",
    "window_vanishes",
    "windows_merge",
    "window_splits",
    "end_crosses_equator",
    "end_at_pole",
    "several",
]
"""As λ grows. Where a window appears or vanishes its motion is an equilibrium; where windows merge or split
there is a separatrix."""


@dataclass(frozen=True, slots=True)
class Change:
    """The enclosure of a value of λ at which the windows change, in the client's axes."""

    lower: arb
    upper: arb
    kind: ChangeKind
    g1: Measured | None
    """Where on the curve; the error is estimated, as the distance of the two zeros that meet. Shape ()."""
    g2: Measured | None


@dataclass(frozen=True, slots=True)
class Beside:
    """A part next to a change, as seen from it."""

    signatures: tuple[Signature, ...]
    """The signatures of the part, one for each half curve."""
    zeros: Callable[[int], Zeros]
    """Returns the zeros of p² on a half curve, at the λ of the part next to the change; shape (1, zeros)."""


def change_between(
    halves: Sequence[PlainHalves], before: Beside, after: Beside, enclosure: tuple[arb, arb]
) -> Change:
    """Return what changes between two parts, the first with the smaller λ of the client."""
    kinds: list[tuple[ChangeKind, Measured | None, Measured | None]] = []
    for k, half in enumerate(halves):
        if before.signatures[k] != after.signatures[k]:
            kinds.append(_of_half(half, k, before, after))
    kind, g1, g2 = kinds[0]
    if any(each[0] != kind for each in kinds):
        kind, g1, g2 = "several", None, None
    return Change(*enclosure, kind, g1, g2)


def _of_half(
    half: PlainHalves, k: int, before: Beside, after: Beside
) -> tuple[ChangeKind, Measured | None, Measured | None]:
    one, other = (_signs(each.signatures[k]) for each in (before, after))
    if one == other:
        return "end_crosses_equator", None, Measured(np.zeros(()), np.zeros(()))
    if (len(one) - len(other)) % 2:
        return "end_at_pole", Measured(np.zeros(()), np.zeros(())), None
    if len(one) == len(other):
        return "several", None, None
    grows = len(other) > len(one)
    many = after if grows else before
    sign, g1, g2 = _meeting(half, k, many)
    if sign == 0:
        return "several", None, None
    if sign > 0:
        return ("window_appears" if grows else "window_vanishes"), g1, g2
    return ("window_splits" if grows else "windows_merge"), g1, g2


def _signs(signature: Signature) -> list[int]:
    """Return the signs along the whole half curve: those on both sides of the equator are one."""
    border = signature.index(EQUATOR)
    return [*signs_in(signature[:border]), *signs_in(signature[border:])[1:]]


def _meeting(half: PlainHalves, number: int, beside: Beside) -> tuple[int, Measured | None, Measured | None]:
    """Return the sign of p² between the two neighbouring zeros that are closest, and where they are."""
    zeros = beside.zeros(number)
    x = 0.5 * (zeros.low[0] + zeros.high[0])
    v = np.where(zeros.hemisphere > 0, x, np.pi - x)
    gaps = np.diff(v) / np.sin(np.minimum(v[1:], v[:-1]))
    if not gaps.size or np.isnan(gaps).all():
        return 0, None, None
    first = int(np.nanargmin(gaps))
    g1, g2 = (_about(bounds, first) for bounds in _points(half, zeros))
    return _signs(beside.signatures[number])[first + 1], g1, g2


def _points(half: PlainHalves, zeros: Zeros) -> list[tuple[FloatArray, ...]]:
    sign = half.shape.third_sign if half.shape.is_mirrored else half.shape.first_sign
    g1 = tuple(sign * side[0] for side in zeros.size)
    return [g1, tuple(side[0] for side in zeros.height)]


def _about(bounds: tuple[FloatArray, ...], first: int) -> Measured:
    both = np.concatenate([side[first : first + 2] for side in bounds])
    return Measured(np.asarray(0.5 * (both.min() + both.max())), np.asarray(both.max() - both.min()))


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
