"""Exact arithmetic for proofs: Laurent polynomials in the coordinates and in atoms.

The ring is Q[pi][x1, x2, x3, y, u0, u1, ...] with all generators invertible and

* g_i = ε_i x_i^(d_i), ε the signs of the octant under study and x_i > 0 there
  (with d_i = 1 and ε = (+, +, +) nothing depends on the octant, unless
  :attr:`Ring.sign_dependent` says so);
* y^d = rho = g1² + g3², and the sphere: x2^(2 d2) = 1 - x1^(2 d1) - x3^(2 d3);
* u_k the atoms of the formula: roots, divisors, exponentials, logarithms,
  sines and cosines, each with what is known of it (its *nature*).

Soundness. Every relation used (the sphere, u^q = base, cos² + sin² = 1) and
every rule of derivation is true of the real functions that the generators
stand for, wherever the formula has a value: fractional powers, abs and log are
split only over factors whose sign is known, and a generator is inverted only
if the formula divides by it or needs it positive. So an element whose normal
form is zero *is* zero there. The converse is not claimed: atoms may hide a
relation (sin(2 g2) and sin(g2) are unrelated here). Without atoms the ring is
a domain and the zero test is decisive.
"""

from dataclasses import dataclass
from fractions import Fraction
from math import comb

from flint import Ordering, fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from service.dynamics.verdict.layout import Layout, LayoutTooSmallError, NoProofError
from service.dynamics.verdict.natures import (
    CircleConstant,
    Coordinate,
    Cosine,
    Divisor,
    Element,
    Nature,
    Root,
    exponents_of,
)

MAX_TERMS = 20_000
"""Terms of one polynomial; beyond, the numeric route is the faster one."""
MAX_WORK = 4_000_000
"""Products of terms in one proof, about a second."""
MAX_DIVISION_STEPS = 400
"""Degree of a quotient worth trying: dividing g1^N + 1 by rho makes N/2 terms before it fails."""
MAX_BITS = 2**27
"""Bits of all coefficients of one polynomial (16 MB): flint aborts the process if it gets no memory."""
SMALL = 1000
"""Products of terms below which the size of the coefficients is not looked at."""
MAX_EXPONENT = 2**48
"""Exponents must stay inside 64 bits after the few products that follow."""


@dataclass(frozen=True, slots=True)
class _Relation:
    """clearing · u^power = tail, as the polynomial clearing · u^power - tail."""

    power: int
    polynomial: fmpq_mpoly
    clearing: tuple[int, ...] | None
    tail_terms: int


class Ring:
    """The ring of one formula in one octant; it grows by atoms while the formula is read.

    Raises (all methods)
    --------------------
    LayoutTooSmallError
        Start again with the layout it carries.
    NoProofError
        Too many terms, too much work.
    """

    def __init__(self, layout: Layout, signs: tuple[int, int, int]) -> None:
        # Lexicographic order with later atoms greater: the leading monomial of
        # every relation is then a power of its own generator, and a relation's
        # tail only has lesser generators, so one pass reduces completely.
        self.layout = layout
        self.signs = signs
        self.sign_dependent: set[int] = set()
        atoms = layout.atoms
        names = [f"u{k}" for k in reversed(range(atoms))] + ["y", "x2", "x1", "x3", "pi"]
        self.context = fmpq_mpoly_ctx.get(names, Ordering.lex)
        self.width = len(names)
        self.no_shift = (0,) * self.width
        self.rho_index, self.pi_index = atoms, atoms + 4
        self.coordinate_index = (atoms + 2, atoms + 1, atoms + 3)
        self.natures: dict[int, Nature] = {self.pi_index: CircleConstant(layout.degree("pi"))}
        self._relations: dict[int, _Relation] = {}
        self._by_key: dict[str, int] = {}
        self._keys = {self.rho_index: "rho", self.pi_index: "pi"}
        self._work = 0
        squares = []
        for position, index in enumerate(self.coordinate_index):
            degree = layout.degree(f"g{position + 1}")
            self.natures[index] = Coordinate(position, degree)
            self._keys[index] = f"g{position + 1}"
            squares.append(self._power_of(index, 2 * degree))
        self.g1_squared, g2_squared, self.g3_squared = squares
        self.rho = self.g1_squared + self.g3_squared
        self.g2_squared = 1 - self.rho
        x2 = self.coordinate_index[1]
        self._relations[x2] = _Relation(
            2 * layout.degree("g2"), g2_squared - self.g2_squared, None, len(self.g2_squared)
        )
        self._adopt(self.rho_index, Root(self.polynomial(self.rho), layout.degree("rho")))

    # --- making elements -------------------------------------------------

    def polynomial(self, numerator: fmpq_mpoly) -> Element:
        """Return a polynomial as an element."""
        return Element(numerator, self.no_shift)

    def constant(self, value: Fraction) -> Element:
        """Return a rational number as an element."""
        return self.polynomial(self.context.constant(fmpq(value.numerator, value.denominator)))

    def monomial(self, exponents: dict[int, int]) -> Element:
        """Return the product of generators to integer powers of any sign."""
        shift = list(self.no_shift)
        for index, exponent in exponents.items():
            if abs(exponent) > MAX_EXPONENT:
                raise NoProofError("exponents beyond what proofs handle")
            shift[index] = exponent
        return Element(self.context.constant(1), tuple(shift))

    def coordinate(self, position: int) -> Element:
        """Return g1, g2 or g3 (position 0, 1, 2)."""
        index = self.coordinate_index[position]
        degree = self.layout.degree(f"g{position + 1}")
        return self.polynomial(self.signs[position] * self._power_of(index, degree))

    def pi(self) -> Element:
        """Return the number pi."""
        return self.polynomial(self._power_of(self.pi_index, self.layout.degree("pi")))

    # --- atoms -------------------------------------------------------------

    def find(self, key: str) -> int | None:
        """Return the generator made under ``key``, or None."""
        return self._by_key.get(key)

    def key(self, index: int) -> str:
        """Return the key of a generator: of its degree in the layout, and of an atom to find it."""
        return self._keys[index]

    def next_atom(self) -> int:
        """Return the generator that the next atom will get; the one after gets the next smaller index."""
        return self.layout.atoms - 1 - len(self._by_key)

    def atom(self, key: str, nature: Nature) -> int:
        """Make the next free generator; it is greater than all made before."""
        index = self.next_atom()
        if index < 0:
            raise LayoutTooSmallError(self.layout.with_more_atoms())
        self._by_key[key] = index
        self._keys[index] = key
        self._adopt(index, nature)
        return index

    def _adopt(self, index: int, nature: Nature) -> None:
        self.natures[index] = nature
        match nature:
            case Root(base, degree) | Divisor(base, degree):
                self._relate(index, degree, base)
            case Cosine(_, sine):
                self._relate(index, 2, self.polynomial(1 - self.context.gen(sine) ** 2))

    def _relate(self, index: int, power: int, base: Element) -> None:
        """Record u^power = base, its negative exponents cleared to the left side."""
        below = tuple(max(-exponent, 0) for exponent in base.shift)
        above = tuple(max(exponent, 0) for exponent in base.shift)
        tail = base.numerator * self._term(above)
        left = list(below)
        left[index] += power
        clearing = below if any(below) else None
        self._relations[index] = _Relation(power, self._term(tuple(left)) - tail, clearing, len(tail))

    # --- arithmetic ----------------------------------------------------------

    def add(self, x: Element, y: Element) -> Element:
        """Return x + y."""
        if x.shift == y.shift:
            return Element(x.numerator + y.numerator, x.shift)
        if x.is_zero:
            return y
        if y.is_zero:
            return x
        common = tuple(map(min, x.shift, y.shift))
        return Element(self._raised(x, common) + self._raised(y, common), common)

    def negate(self, x: Element) -> Element:
        """Return -x."""
        return Element(-x.numerator, x.shift)

    def multiply(self, x: Element, y: Element) -> Element:
        """Return x y."""
        products = len(x.numerator) * len(y.numerator)
        self.spend(products)
        if products > SMALL:
            self._require_room(products, _height(x.numerator) + _height(y.numerator))
        if y.shift == self.no_shift:
            shift = x.shift
        else:
            shift = tuple(a + b for a, b in zip(x.shift, y.shift, strict=True))
        return Element(x.numerator * y.numerator, shift)

    def integer_power(self, x: Element, exponent: int) -> Element:
        """Return x^exponent, exponent >= 0, by repeated squaring."""
        size = len(x.numerator)
        degree = max((*map(int, x.numerator.degrees()), *map(abs, x.shift)), default=0)
        if exponent * degree > MAX_EXPONENT:
            raise NoProofError("exponents beyond what proofs handle")
        # Coefficients ±1 have height 1 and keep it; a sum of n terms may grow by n each time.
        growth = _height(x.numerator) - 1 + (size - 1).bit_length()
        self._expand(size, exponent, 1, exponent * growth)
        return Element(x.numerator**exponent, tuple(exponent * e for e in x.shift))

    def normal(self, x: Element) -> Element:
        """Return x with every relation applied: its numerator is zero only if x vanishes, see the module."""
        numerator, shift = x.numerator, x.shift
        for index in sorted(self._relations):
            relation = self._relations[index]
            times = int(numerator.degrees()[index]) // relation.power
            if times <= 0:  # flint gives the zero polynomial the degree -1
                continue
            growth = times * (_height(relation.polynomial) + relation.tail_terms.bit_length())
            self._expand(relation.tail_terms, times, len(numerator), _height(numerator) + growth)
            if relation.clearing is not None:
                numerator *= self._term(tuple(times * e for e in relation.clearing))
                shift = tuple(a - times * b for a, b in zip(shift, relation.clearing, strict=True))
            numerator %= relation.polynomial
        return Element(numerator, shift)

    def canonical(self, x: Element) -> Element:
        """Return the normal form of x with its whole monomial in ``shift``: equal elements look equal."""
        x = self.normal(x)
        if x.is_zero:
            return self.polynomial(x.numerator)
        exponents = exponents_of(x.numerator.term_content())
        if not any(exponents):
            return x
        shift = tuple(a + b for a, b in zip(x.shift, exponents, strict=True))
        return Element(x.numerator / self._term(exponents), shift)

    def exact_quotient(self, dividend: fmpq_mpoly, divisor: fmpq_mpoly) -> fmpq_mpoly | None:
        """Return dividend / divisor if that is a polynomial and quickly seen to be one, else None."""
        degrees = zip(dividend.degrees(), divisor.degrees(), strict=True)
        steps = max((int(high) // int(low) for high, low in degrees if low > 0), default=0)
        if steps > MAX_DIVISION_STEPS or steps * len(dividend) * _height(dividend) > MAX_BITS:
            return None
        self.spend(len(dividend) * len(divisor) * (steps + 1))
        quotient, remainder = divmod(dividend, divisor)
        return None if remainder else quotient

    def spend(self, products: int) -> None:
        """Count work; give up when the proof gets too long."""
        self._work += products
        if products > MAX_WORK // 4 or self._work > MAX_WORK:
            raise NoProofError("polynomials too large for a proof")

    def _expand(self, terms: int, exponent: int, factor: int, height: int) -> None:
        """Give up before ``factor`` terms times a power of ``terms`` terms would be too large."""
        # Both above 64 is too many terms, and would make the binomial itself long.
        smaller = min(max(terms - 1, 0), exponent)
        count = comb(exponent + terms - 1, smaller) if 0 < smaller <= 64 else 1
        if smaller > 64 or count > MAX_TERMS:
            raise NoProofError("a power with too many terms for a proof")
        self.spend(factor * count)
        self._require_room(factor * count, height)

    def _require_room(self, terms: int, height: int) -> None:
        if terms * height > MAX_BITS:
            raise NoProofError("coefficients too large for a proof")

    def _raised(self, x: Element, common: tuple[int, ...]) -> fmpq_mpoly:
        if x.shift == common:
            return x.numerator
        return x.numerator * self._term(tuple(a - b for a, b in zip(x.shift, common, strict=True)))

    def _term(self, exponents: tuple[int, ...]) -> fmpq_mpoly:
        return self.context.term(exp_vec=exponents)

    def _power_of(self, index: int, exponent: int) -> fmpq_mpoly:
        exponents = list(self.no_shift)
        exponents[index] = exponent
        return self._term(tuple(exponents))


def _height(polynomial: fmpq_mpoly) -> int:
    """Return the bits of the largest numerator or denominator among the coefficients."""
    return max((int(coefficient.height_bits()) for coefficient in polynomial.coeffs()), default=0)
