"""Elements of the ring of a proof, and the functions that its generators represent."""

from dataclasses import dataclass

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
