"""Plans the size of the ring of a proof, and defines when a proof is abandoned."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
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
    """The parameters of a ring, fixed before its first element is made.

    Parameters
    ----------
    atoms
        Number of generators reserved for the functions of the formula.
    degrees
        Root degree of each generator by its key (``"g1"``, ``"rho"``, ...):
        the generator is that root of the thing named. 1 where not mentioned.
    signs
        Signs of polynomials in the coordinates, by octant and text, wherever
        the formula has a value: it takes a root or the logarithm of them.
    """

    atoms: int = 0
    degrees: Mapping[str, int] = field(default_factory=dict)
    signs: Mapping[str, int] = field(default_factory=dict)

    def degree(self, key: str) -> int:
        """Return the root degree of the generator ``key``."""
        return self.degrees.get(key, 1)

    def with_degree(self, key: str, multiple: int) -> "Layout":
        """Return a layout where the degree of ``key`` is a multiple of ``multiple`` too."""
        degree = lcm(self.degree(key), multiple)
        if degree > MAX_DEGREE:
            raise NoProofError(f"a root of a degree beyond {MAX_DEGREE}")
        return replace(self, degrees={**self.degrees, key: degree})

    def with_more_atoms(self) -> "Layout":
        """Return a layout with more free generators."""
        if self.atoms >= MAX_ATOMS:
            raise NoProofError(f"more than {MAX_ATOMS} independent roots, exponentials, logarithms, ...")
        return replace(self, atoms=min(MAX_ATOMS, 2 * self.atoms or 4))

    def with_sign(self, name: str, sign: int) -> "Layout":
        """Return a layout that knows of one more sign."""
        return replace(self, signs={**self.signs, name: sign})


class LayoutTooSmallError(Exception):
    """The ring is too small; ``layout`` is large enough."""

    def __init__(self, layout: Layout) -> None:
        super().__init__("the ring is too small")
        self.layout = layout
