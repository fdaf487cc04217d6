r"""Proves where p² grows without bound between two places, and that it is continuous where it is 0.

Where a part u of the formula vanishes, which depends on g2 alone and is monotone there, each side of u = 0
is enclosed in an algebra whose scale is δ = |u|: D = g1 V_3 − g3 V_1 is δ^e times something bounded. If e < 0
and the coefficient is away from 0, |D| → ∞. So it does where X D is δ^e with e ≤ −1 and a coefficient away
from 0: its integral diverges, as that of 1/δ for a logarithm in D. There D is monotone besides, and has one
zero at most on that side, however weak the infinite part is beside the rest.

Where u has a zero of a higher order, or other parts vanish at the same place, the place is exact and the
scale is the distance from it (:mod:`.neighbourhoods`).

The time to such a place, ∫ dv/√P, is finite.
"""

from dataclasses import dataclass
from itertools import pairwise

from flint import arb

from service.dynamics.formula.algebras.long_intervals import LongInterval
from service.dynamics.formula.vanishing import VanishingPart, has_essential_part, vanishing_parts
from service.dynamics.reduction.geometry.slopes import derivatives_along
from service.dynamics.reduction.root_finding.zeros import LoopPlace, Radicand, enclose_zero
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import QUARTER_TURN
from service.dynamics.reduction.sign_proofs.cells import (
    Curves,
    Half,
    Side,
    place_at,
    place_on_stretch,
    region_of_stretch,
    width_of,
)
from service.dynamics.reduction.sign_proofs.neighbourhoods import (
    UNDEFINED,
    UNDEFINED_HERE,
    LongDomainIntervals,
    Neighbourhood,
    UnbrokenBalls,
    neighbourhoods,
    sign_of,
)

MAX_STRETCHES = 2000
"""At stretches of one half."""
STRETCH_MIN_RELATIVE_WIDTH = 1e-9
"""Relative width of a stretch that is not cut any more."""
INFINITY_LOG2_DISTANCES = (4, 8, 16, 32, 64, 96, 128)
"""-log2 of the distances from an infinity, against the stretch, at which P is tried for the sign it has next
to it."""


@dataclass(frozen=True, slots=True)
class Infinity:
    """The one place of a stretch where P is infinite, and its sign on both sides of it, or UNDEFINED."""

    start: Side
    stop: Side
    place: LoopPlace
    ends: tuple[arb, arb]
    """The coordinates of both ends, in the region of the place."""
    signs: tuple[int, int]

    def cuts(self, radicand: Radicand, before: int, after: int) -> list[LoopPlace] | None:
        """Return places that show the signs of P on the stretch, which has these labels, or 0, at its ends.

        None where they are not found.
        """
        cuts = [self.place]
        for near, label, end in zip(self.signs, (before, after), self.ends, strict=True):
            if near == label or (near == UNDEFINED and label == 0):
                continue
            beside = None if UNDEFINED in (near, label) else self._beside(radicand, end, near)
            if beside is None:
                return None
            cuts.append(beside)
        return cuts

    def _beside(self, radicand: Radicand, end: arb, sign: int) -> LoopPlace | None:
        """Return a place on the side of ``end`` where P has the sign that it has next to the infinity."""
        centre = self.place.x.mid()
        for bits in INFINITY_LOG2_DISTANCES:
            x = (centre + (end - centre) * arb(2) ** -bits).mid()
            if radicand(LoopPlace(self.place.region, x)) * sign > 0:
                return LoopPlace(self.place.region, x, sign=sign)
        return None


def infinity_between(half: Half, start: Side, stop: Side) -> Infinity | None:
    """Return where P is proved to be infinite between two places, the first at the smaller v; None if not."""
    g = place_on_stretch(half, start, stop)
    region, ends = region_of_stretch(start, stop)
    for near in neighbourhoods(half, g):

        def value(x: arb, near: Neighbourhood = near) -> arb:
            return near.crossing(place_at(half, region, x)[1])

        signs = near.limits(value(ends[0]), value(ends[1]))
        if signs is not None:
            place = LoopPlace(region, enclose_zero(value, *ends), is_infinite=True)
            return Infinity(start, stop, place, (ends[0], ends[1]), signs)
    return None


def limits_between(curves: Curves, g: list[arb], ends: tuple[arb, arb]) -> tuple[int, int] | None:
    """Return the signs of P next to the one place in a box where it is infinite, first where g2 is larger.

    The box holds a stretch of a curve, of each λ of some; ``ends`` hold g2 where the stretches begin and end.
    On a side P has this sign, or is monotone.
    """
    for near in neighbourhoods(curves, g):
        signs = near.limits(near.crossing(ends[0]), near.crossing(ends[1]))
        if signs is not None:
            return signs
    return None


def infinities_of(half: Half) -> list[Infinity] | None:
    """Return all places of a half where P is infinite; None where a part vanishes and it is not settled.

    Without bounds of P: for a potential of which the formula is all that can be infinite.
    """
    found = list[Infinity]()
    for part in vanishing_parts(half.tape):
        waiting, looks = _stretches(), 0
        while waiting:
            start, stop = waiting.pop()
            looks += 1
            if looks > MAX_STRETCHES:
                return None
            if not _may_vanish(half, part, start, stop):
                continue
            infinity = infinity_between(half, start, stop)
            if infinity is not None:
                found.append(infinity)
            elif width_of(start, stop) > STRETCH_MIN_RELATIVE_WIDTH:
                waiting.extend(_halves(start, stop))
            elif continuous_sign(half, start, stop) is None:
                return None
    return found


def _may_vanish(half: Half, part: VanishingPart, start: Side, stop: Side) -> bool:
    """Tell whether a part may vanish on a stretch; at the edge of where it has a value it is not asked."""
    g = [LongInterval(x.lower(), x.upper()) for x in place_on_stretch(half, start, stop)]
    algebra = LongDomainIntervals(arb(0), arb(1) / 2)
    u = part.part.evaluate(algebra, g)
    if algebra.is_undefined or u.sign:
        return False
    return bool(u.lo <= u.hi) or width_of(start, stop) > STRETCH_MIN_RELATIVE_WIDTH


def _stretches() -> list[tuple[Side, Side]]:
    """Return stretches from pole to pole, one of them across the equator."""
    ends = [1e-6, 1e-3, 0.1, *(0.25 * k for k in range(1, 7))]
    north = [((1.0, low), (1.0, high)) for low, high in pairwise(ends)]
    south = [((-1.0, high), (-1.0, low)) for low, high in pairwise(ends)]
    return [*north, ((1.0, ends[-1]), (-1.0, ends[-1])), *south]


def _halves(start: Side, stop: Side) -> list[tuple[Side, Side]]:
    if start[0] == stop[0]:
        # A place that is likely to be one where a part vanishes is no end.
        middle = (start[0], start[1] + 0.4871 * (stop[1] - start[1]))
        return [(start, middle), (middle, stop)]
    inner = [(side, QUARTER_TURN - 0.4871 * (QUARTER_TURN - x)) for side, x in (start, stop)]
    return [(start, inner[0]), (inner[0], inner[1]), (inner[1], stop)]


def continuous_sign(half: Half, start: Side, stop: Side) -> int | None:
    """Return the sign of P between two places, 0 if it is not known; None if P is not proved continuous.

    Where P has no value on one side of a place, its limit is that of the other side.
    """
    g = place_on_stretch(half, start, stop)
    (D,) = derivatives_along(UnbrokenBalls(), half.tape, half.body, g, 0)
    if D is None or D.is_finite():
        return sign_of(D) * half.turn
    for near in neighbourhoods(half, g):
        sides = [near.bounded(side) for side in (1, -1)]
        if all(D is not None for D in sides):
            signs = {sign_of(D) for D in sides if D is not UNDEFINED_HERE}
            return signs.pop() * half.turn if len(signs) == 1 else 0
        # It may have no value at the place itself, as sin(g2)/g2; but for sin(1/g2), which has no limit.
        before, after = (0, 0) if has_essential_part(near.part) else (near.sign(1), near.sign(-1))
        if before and before == after:
            return before
    return None


def is_essential(half: Half, start: Side, stop: Side) -> bool:
    """Tell whether exp or a wave is taken, between two places, of what grows without bound there."""
    g = place_on_stretch(half, start, stop)
    return any(has_essential_part(near.part) for near in neighbourhoods(half, g))
