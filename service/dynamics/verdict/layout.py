"""How large the ring of a proof must be, and the reasons to give a proof up."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import lcm

MAX_ATOMS = 16
"""Roots, exponentials, logarithms, sines, divisors and their like that one proof may use."""
MAX_DEGREE = 10**12
"""Largest denominator of a fractional exponent: exponents must stay far inside 64 bits."""


class NoProofError(Exception):
    """The exact route ends here; the numeric route decides."""


class UndefinedInOctantError(Exception):
    """The formula has no real value anywhere in the octant under study."""


@dataclass(frozen=True, slots=True)
class Layout:
    """What a ring needs to know before its first element is made.

    Parameters
    ----------
    atoms
        Number of generators kept free for what the formula will ask for.
    degrees
        Root degree of each generator by its key (``"g1"``, ``"rho"``, ...):
        the generator is that root of the thing named. 1 where not mentioned.
    """

    atoms: int = 0
    degrees: Mapping[str, int] = field(default_factory=dict)

    def degree(self, key: str) -> int:
        """Return the root degree of the generator ``key``."""
        return self.degrees.get(key, 1)

    def with_degree(self, key: str, multiple: int) -> "Layout":
        """Return a layout where the degree of ``key`` is a multiple of ``multiple`` too."""
        degree = lcm(self.degree(key), multiple)
        if degree > MAX_DEGREE:
            raise NoProofError(f"a root of a degree beyond {MAX_DEGREE}")
        return Layout(self.atoms, {**self.degrees, key: degree})

    def with_more_atoms(self) -> "Layout":
        """Return a layout with more free generators."""
        if self.atoms >= MAX_ATOMS:
            raise NoProofError(f"more than {MAX_ATOMS} independent roots, exponentials, logarithms, ...")
        return Layout(min(MAX_ATOMS, 2 * self.atoms or 4), self.degrees)


class LayoutTooSmallError(Exception):
    """The ring cannot hold what is asked; ``layout`` can."""

    def __init__(self, layout: Layout) -> None:
        super().__init__("the ring is too small")
        self.layout = layout
