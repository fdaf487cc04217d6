"""The golden motions written down a second time, by hand: nothing here reads a document."""

from fractions import Fraction
from typing import Any  # numbers of mpmath and series of python-flint have no types

from tests.golden.by_taylor import AnyState, Formula, Planar

Number = Any
Options = Any


def gravity(weight: int) -> dict[str, Formula]:
    return {"V": lambda g1, g2, g3: -weight * g1, "gradient": lambda g1, g2, g3: (-weight + 0 * g1, 0, 0)}


def three_terms(over: int, twice_c: tuple[int, int]) -> dict[str, Formula]:
    """V = -g1 + 1/(over g3²) + c (g1² - g2²), 2c = numerator / denominator."""
    top, bottom = twice_c

    def gradient(g1: Number, g2: Number, g3: Number) -> tuple[Number, Number, Number]:
        return -1 + top * g1 / bottom, -top * g2 / bottom, -2 / (over * (g3 * g3 * g3))

    return {
        "V": lambda g1, g2, g3: -g1 + 1 / (over * g3 * g3) + top * (g1 * g1 - g2 * g2) / (2 * bottom),
        "gradient": gradient,
    }


def cubic_well() -> dict[str, Formula]:
    """V = (3 g1² + g3²)(g2² - 1/2 + g2³/5)."""

    def G(g2: Number) -> Number:
        return g2 * g2 + g2 * g2 * g2 / 5 - (g2 * 0 + 1) / 2

    def gradient(g1: Number, g2: Number, g3: Number) -> tuple[Number, Number, Number]:
        slope = 2 * g2 + 3 * g2 * g2 / 5
        return 6 * g1 * G(g2), (3 * g1 * g1 + g3 * g3) * slope, 2 * g3 * G(g2)

    return {"V": lambda g1, g2, g3: (3 * g1 * g1 + g3 * g3) * G(g2), "gradient": gradient}


def cubic() -> dict[str, Formula]:
    """V = -g1 (4 g1² + 3 g3²) + (4 g1² + g3²)/10."""

    def V(g1: Number, _: Number, g3: Number) -> Number:
        return -g1 * (4 * g1 * g1 + 3 * g3 * g3) + (4 * g1 * g1 + g3 * g3) / 10

    def gradient(g1: Number, _: Number, g3: Number) -> tuple[Number, Number, Number]:
        return -12 * g1 * g1 - 3 * g3 * g3 + 4 * g1 / 5, 0, -6 * g1 * g3 + g3 / 5

    return {"V": V, "gradient": gradient}


def planar(A: int, C: str, k: int, curve: str, formulas: dict[str, Formula], **more: Options) -> Planar:
    """k = 1: ``curve`` is lambda; k = 2: nu, lambda squared."""
    return Planar(Fraction(A), Fraction(C), (Fraction(curve), k), **formulas, **more)


TAYLOR: dict[str, Planar | AnyState] = {
    "G1": planar(2, "1", 2, "1", gravity(1)),
    "G2": planar(3, "3/2", 2, "3/10", gravity(2)),
    "G4": planar(2, "1", 2, "1", three_terms(20, (0, 1))),
    "G6": planar(2, "1", 2, "1", three_terms(50, (12, 5)), rest=("0.37", 1)),
    "G10": planar(3, "1", 1, "4/5", cubic_well(), rest=("0.33", -1)),
    "G12": planar(4, "1", 1, "9/10", cubic()),
    "quadrature, libration": planar(3, "1", 1, "4/5", cubic_well()),
    "collision": planar(
        2,
        "1",
        2,
        "1",
        three_terms(-20, (-1, 1)),
        is_periodic=False,
        times=(Fraction(0), Fraction(1, 2), Fraction(1)),
    ),
    "any state": AnyState(
        (Fraction(2), Fraction(3, 2), Fraction(1)),
        lambda g1, g2, g3: g1 - g3 / 2,
        lambda g1, g2, g3: (1 + 0 * g1, 0, -(1 + 0 * g1) / 2),
        tuple(Fraction(each) for each in ("2/5", "1/10", "9/10", "3/5", "0", "4/5")),
        (Fraction(0), Fraction(1), Fraction(5)),
    ),
}

SAME = {
    "doubles, rotation": "G1",
    "quadrature, rotation": "G1",
    "doubles, libration": "G4",
    "certified": "G6",
}
"""Documents of one motion: they differ in the way of solving."""
