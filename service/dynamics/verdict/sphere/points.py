"""Generates rational points exactly on the unit sphere, in a fixed order."""

from collections.abc import Iterator
from fractions import Fraction
from functools import cache

Point = tuple[Fraction, Fraction, Fraction]

# (a, b, c, d) with a² + b² + c² = d² and no two ratios alike: in general
# position to each other and to coordinate planes, diagonals and rational cones.
_QUADRUPLES = (
    (2, 6, 3, 7),
    (4, 8, 1, 9),
    (6, 2, 9, 11),
    (12, 4, 3, 13),
    (8, 9, 12, 17),
    (6, 10, 15, 19),
)
_OCTANTS = (
    (1, 1, 1),
    (-1, 1, -1),
    (1, -1, -1),
    (-1, -1, 1),
    (-1, 1, 1),
    (1, 1, -1),
    (1, -1, 1),
    (-1, -1, -1),
)


def sphere_points() -> Iterator[Point]:
    """Yield 48 points of moderate height, every octant among the first 8 and six times in all.

    The k-th visit of an octant brings another quadruple, so that 8 successive
    points do not lie on one cone.
    """
    return iter(_usual())


@cache
def _usual() -> tuple[Point, ...]:
    return tuple(_points_of_octants())


def _points_of_octants() -> Iterator[Point]:
    for visit in range(len(_QUADRUPLES)):
        for number, signs in enumerate(_OCTANTS):
            a, b, c, d = _QUADRUPLES[(visit + number) % len(_QUADRUPLES)]
            yield (Fraction(signs[0] * a, d), Fraction(signs[1] * b, d), Fraction(signs[2] * c, d))


def fine_sphere_points(steps: int = 9) -> Iterator[Point]:
    """Yield points all over the sphere, close to the axes too: for formulas that are defined on small parts.

    Stereographic images of a grid of ``4 steps²`` points in the square
    -1 < u, v < 1, from both ends of the first axis; no grid point is on an axis.
    """
    halves = [Fraction(2 * k + 1, 2 * steps) for k in range(steps)]
    for u_size in halves:
        for v_size in halves:
            # A little more than v, to keep |g2| = |g3| out.
            v_size += Fraction(1, 40 * steps)
            norm = 1 + u_size**2 + v_size**2
            first, second, third = (2 - norm) / norm, 2 * u_size / norm, 2 * v_size / norm
            for signs in _OCTANTS:
                yield (signs[0] * first, signs[1] * second, signs[2] * third)
