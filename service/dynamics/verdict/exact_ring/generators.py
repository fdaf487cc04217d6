"""Elements of the ring of a proof, the functions its generators represent, and the size it is planned with.

Terms, products and bits of its polynomials are limited: beyond a limit the proof is abandoned.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import comb, lcm

from flint import fmpq_mpoly


@dataclass(frozen=True, slots=True)
class Element:
    """``numerator`` times the monomial with exponents ``shift`` (any signs)."""

    numerator: fmpq_mpoly
    shift: tuple[int, ...]

    @property
    def is_zero(self) -> bool:
        """Whether the numerator is zero as it stands (take the normal form first)."""
        return not self.numerator

    @property
    def is_number(self) -> bool:
        """Whether the element is a rational number as it stands."""
        return bool(self.numerator.is_constant()) and not any(self.shift)

    @property
    def text(self) -> str:
        """A name of the element in its ring, the same for equal elements in canonical form."""
        return f"{self.numerator} * {self.shift}" if any(self.shift) else str(self.numerator)


@dataclass(frozen=True, slots=True)
class Coordinate:
    """x with |g_position| = x^degree."""

    position: int
    degree: int


@dataclass(frozen=True, slots=True)
class CircleConstant:
    """u > 0 with u^degree = pi, transcendental."""

    degree: int


@dataclass(frozen=True, slots=True)
class Root:
    """u > 0 with u^degree = base, where base > 0."""

    base: Element
    degree: int


@dataclass(frozen=True, slots=True)
class Divisor:
    """u = base, something the formula divides by or raises to a high power."""

    base: Element
    degree: int = 1


@dataclass(frozen=True, slots=True)
class Exponential:
    """u > 0 with u^degree = exp(exponent)."""

    exponent: Element
    degree: int


@dataclass(frozen=True, slots=True)
class Logarithm:
    """u = log(argument), where argument > 0."""

    argument: Element


@dataclass(frozen=True, slots=True)
class Sine:
    """u = sin(argument); the generator ``cosine`` is its cosine."""

    argument: Element
    cosine: int


@dataclass(frozen=True, slots=True)
class Cosine:
    """u = cos(argument); the generator ``sine`` is its sine."""

    argument: Element
    sine: int


@dataclass(frozen=True, slots=True)
class CosineOfTurn:
    """u = 2 cos(2π/order), with u^degree = tail, the tail having lower powers of u and lesser generators."""

    order: int
    tail: Element
    degree: int


Nature = Coordinate | CircleConstant | Root | Divisor | Exponential | Logarithm | Sine | Cosine | CosineOfTurn


def exponents_of(monomial: fmpq_mpoly) -> tuple[int, ...]:
    """Return the exponents of a polynomial of one term (flint's integers made Python's)."""
    return tuple(int(exponent) for exponent in monomial.monomial(0))


MAX_ATOMS = 16
"""Roots, exponentials, logarithms, sines, divisors and their like that one proof may use."""
MAX_EXPONENT_DENOMINATOR = 10**12
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
        if degree > MAX_EXPONENT_DENOMINATOR:
            raise NoProofError(f"a root of a degree beyond {MAX_EXPONENT_DENOMINATOR}")
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


MAX_TERMS = 20_000
"""Terms of one polynomial; beyond, the numeric route is the faster one."""
MAX_TERM_PRODUCTS = 4_000_000
"""Products of terms in one proof, about a second."""
MAX_COEFFICIENT_BITS = 2**27
"""Bits of all coefficients of one polynomial (16 MB): flint aborts the process if it gets no memory."""


@dataclass(slots=True)
class Work:
    """Products of terms spent on one proof, in all its rings.

    Raises (all methods)
    --------------------
    NoProofError
        Too many terms, too much work.
    """

    spent: int = 0

    def spend(self, products: int) -> None:
        """Count operations; abandon the proof when it gets too long."""
        self.spent += products
        if products > MAX_TERM_PRODUCTS // 4 or self.spent > MAX_TERM_PRODUCTS:
            raise NoProofError("polynomials too large for a proof")

    def expand(self, terms: int, exponent: int, factor: int, bits: int) -> None:
        """Give up before ``factor`` terms times a power of ``terms`` terms would be too large.

        ``bits`` are those of the largest coefficient that can come of it.
        """
        # Both above 64 is too many terms, and would make the binomial itself long.
        smaller = min(max(terms - 1, 0), exponent)
        count = comb(exponent + terms - 1, smaller) if 0 < smaller <= 64 else 1
        if smaller > 64 or count > MAX_TERMS:
            raise NoProofError("a power with too many terms for a proof")
        self.spend(factor * count)
        require_room(factor * count, bits)


def require_room(terms: int, bits: int) -> None:
    """Give up before ``terms`` coefficients of so many bits would take too much memory."""
    if terms * bits > MAX_COEFFICIENT_BITS:
        raise NoProofError("coefficients too large for a proof")


def height(polynomial: fmpq_mpoly) -> int:
    """Return the bits of the largest numerator or denominator among the coefficients."""
    return max((int(coefficient.height_bits()) for coefficient in polynomial.coeffs()), default=0)
