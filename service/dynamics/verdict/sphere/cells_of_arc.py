"""Cuts an arc of a motion's loop into cells on which g1, g2 and g3 are monotonic and keep their signs."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction

from flint import arb

from service.dynamics.reduction.arc import Arc
from service.dynamics.reduction.geometry.loop import Loop, ball

Axes = tuple[arb, arb, arb]

PARTS = 16
"""Cells of a quarter of the loop to begin with."""
SLIVER = 2.0**-80
"""An arc may end beside a multiple of π/2 as close as this: the cell on the other side has that end in it."""


@dataclass(frozen=True, slots=True)
class Cell:
    """A stretch lower ≤ v ≤ upper inside one quarter of the loop, and what g1, g2, g3 are at its ends.

    The axes are those of the client, not the primed ones of the loop.
    """

    loop: Loop
    lower: arb
    upper: arb
    at_lower: Axes
    at_upper: Axes

    @property
    def g(self) -> Axes:
        """Return balls of g1, g2 and g3 all over the cell: they are monotonic in it."""
        g1, g2, g3 = (x.union(y) for x, y in zip(self.at_lower, self.at_upper, strict=True))
        return g1, g2, g3

    @property
    def middle(self) -> arb:
        """Return an exact v in the middle."""
        return ((self.lower + self.upper) / 2).mid()

    @property
    def octant(self) -> tuple[int, int, int]:
        """Return the signs of g1, g2, g3 inside."""
        first, second, third = (1 if each > 0 else -1 for each in place_on(self.loop, self.middle))
        return first, second, third

    def halves(self) -> tuple["Cell", "Cell"]:
        """Return both halves."""
        middle = self.middle
        there = place_on(self.loop, middle)
        return replace(self, upper=middle, at_upper=there), replace(self, lower=middle, at_lower=there)


def cells_of(arc: Arc) -> Iterator[Cell]:
    """Yield cells that cover the arc."""
    quarter = arb.pi() / 2
    # An arc lies within -2π ≤ v ≤ 2π.
    for number in range(-4, 4):
        low, high = quarter * number, quarter * (number + 1)
        starts_inside, ends_inside = arc.lower > low, arc.upper < high
        lower, upper = (arc.lower if starts_inside else low), (arc.upper if ends_inside else high)
        if not upper - lower > SLIVER:
            continue
        places = [lower + (upper - lower) * ball(Fraction(k, PARTS)) for k in range(1, PARTS)]
        first = place_on(arc.loop, lower) if starts_inside else _corner(arc.loop, number)
        last = place_on(arc.loop, upper) if ends_inside else _corner(arc.loop, number + 1)
        points = [first, *(place_on(arc.loop, v) for v in places), last]
        edges = [lower, *places, upper]
        for k in range(PARTS):
            yield Cell(arc.loop, edges[k], edges[k + 1], points[k], points[k + 1])


def place_on(loop: Loop, v: arb) -> Axes:
    """Return g1, g2, g3 at v, where neither sin v nor cos v is 0."""
    at = loop.point(v)
    return (at.g3, at.g2, at.g1) if loop.mirrored else (at.g1, at.g2, at.g3)


def _corner(loop: Loop, number: int) -> Axes:
    """Return g1, g2, g3 at v = number · π/2: a pole or a place on the equator."""
    first, second, third = arb(0), arb(0), arb(0)
    if number % 2:
        first, third = loop.G * loop.g1_sign, loop.Z if number % 4 == 1 else -loop.Z
    else:
        second = arb(1) if number % 4 == 0 else arb(-1)
    return (third, second, first) if loop.mirrored else (first, second, third)
