"""Exact arithmetic for proofs: Laurent polynomials in the coordinates and in atoms.

The ring is Q[pi][x1, x2, x3, y, u0, u1, ...] with all generators invertible and

* g_i = ε_i x_i^(d_i), ε the signs of the octant under study and x_i > 0 there
  (with d_i = 1 and ε = (+, +, +) nothing depends on the octant, unless
  :attr:`Ring.sign_dependent` says so);
* y^d = rho = g1² + g3², and the sphere: x2^(2 d2) = 1 - x1^(2 d1) - x3^(2 d3);
* u_k the atoms of the formula: roots, algebraic numbers, divisors, bases of
  high powers, exponentials, logarithms, sines and cosines, each with what is
  known of it (its *nature*).

Soundness. Every relation used (the sphere, u^q = base, cos² + sin² = 1) and
every rule of derivation is true of the real functions that the generators
stand for, wherever the formula has a value: fractional powers, abs and log are
split only over factors whose sign is known, and a generator is inverted only
if the formula divides by it or needs it positive. So an element whose normal
form is zero *is* zero there. The converse is not claimed: atoms may hide a
relation (a cube root of a sum of roots is found in the ring in some cases only).
Without atoms the ring is a domain and the zero test is decisive.
"""

from dataclasses import dataclass
from fractions import Fraction

from flint import Ordering, fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from service.dynamics.verdict.exact_ring.generators import (
    MAX_COEFFICIENT_BITS,
    CircleConstant,
    Coordinate,
    Cosine,
    CosineOfTurn,
    Divisor,
    Element,
    Layout,
    LayoutTooSmallError,
    Nature,
    NoProofError,
    Root,
    Work,
    exponents_of,
    height,
    require_room,
)


@dataclass(frozen=True, slots=True)
class Relation:
    """clearing · u^power = tail, as the polynomial clearing · u^power - tail, u a generator."""

    index: int
    """The generator."""
    power: int
    polynomial: fmpq_mpoly
    clearing: tuple[int, ...] | None
    tail_terms: int
    step: int
    """Amount by which one replacement lowers the power."""

    @classmethod
    def of(cls, context: fmpq_mpoly_ctx, index: int, power: int, base: Element) -> "Relation":
        """Return u^power = base, its negative exponents cleared to the left side."""
        below = tuple(max(-exponent, 0) for exponent in base.shift)
        above = tuple(max(exponent, 0) for exponent in base.shift)
        tail = base.numerator * context.term(exp_vec=above)
        left = list(below)
        left[index] += power
        return cls(
            index,
            power,
            context.term(exp_vec=tuple(left)) - tail,
            below if any(below) else None,
            len(tail),
            power - max(int(tail.degrees()[index]), 0),
        )

    def applied_to(self, x: Element, context: fmpq_mpoly_ctx, work: Work) -> Element:
        """Return x, an equal element with powers of u below ``power`` alone; raises NoProofError."""
        numerator, shift = x.numerator, x.shift
        excess = int(numerator.degrees()[self.index]) - self.power
        if excess < 0:  # flint gives the zero polynomial the degree -1
            return x
        times = excess // self.step + 1
        growth = times * (height(self.polynomial) + self.tail_terms.bit_length())
        work.expand(self.tail_terms, times, len(numerator), height(numerator) + growth)
        if self.clearing is not None:
            numerator *= context.term(exp_vec=tuple(times * e for e in self.clearing))
            shift = tuple(a - times * b for a, b in zip(shift, self.clearing, strict=True))
        return Element(numerator % self.polynomial, shift)


MAX_DIVISION_STEPS = 400
"""Degree of a quotient worth trying: dividing g1^N + 1 by rho makes N/2 terms before it fails."""
UNCHECKED_PRODUCTS = 1000
"""Products of terms below which the size of the coefficients is not looked at."""
MAX_EXPONENT = 2**48
"""Exponents must stay inside 64 bits after the few products that follow."""


class Ring:
    """The ring of one formula in one octant; it grows by atoms while the formula is read.

    Raises (all methods)
    --------------------
    LayoutTooSmallError
        Start again with the layout it carries.
    NoProofError
        Too many terms, too much work.
    """

    def __init__(self, layout: Layout, signs: tuple[int, int, int], work: Work | None = None) -> None:
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
        self._relations: dict[int, Relation] = {}
        self._by_key: dict[str, int] = {}
        self.aliases: dict[str, Element] = {}
        self._keys = {self.rho_index: "rho", self.pi_index: "pi"}
        self.work = work if work is not None else Work()
        squares = []
        for position, index in enumerate(self.coordinate_index):
            degree = layout.degree(f"g{position + 1}")
            self.natures[index] = Coordinate(position, degree)
            self._keys[index] = f"g{position + 1}"
            squares.append(self._power_of(index, 2 * degree))
        self.g1_squared, _, self.g3_squared = squares
        self.rho = self.g1_squared + self.g3_squared
        self.g2_squared = 1 - self.rho
        x2 = self.coordinate_index[1]
        self._relate(x2, 2 * layout.degree("g2"), self.polynomial(self.g2_squared))
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

    def plain(self, x: Element) -> Element:
        """Return x, whose exponents are not negative, with no shift."""
        return self.polynomial(x.numerator * self._term(x.shift)) if any(x.shift) else x

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
            case CosineOfTurn(_, tail, degree):
                self._relate(index, degree, tail)

    def _relate(self, index: int, power: int, base: Element) -> None:
        self._relations[index] = Relation.of(self.context, index, power, base)

    def relation_power(self, index: int) -> int:
        """Return the power of a generator that its relation takes away, 0 if it has none."""
        relation = self._relations.get(index)
        return relation.power if relation is not None else 0

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
        self.work.spend(products)
        if products > UNCHECKED_PRODUCTS:
            require_room(products, height(x.numerator) + height(y.numerator))
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
        growth = height(x.numerator) - 1 + (size - 1).bit_length()
        self.work.expand(size, exponent, 1, exponent * growth)
        return Element(x.numerator**exponent, tuple(exponent * e for e in x.shift))

    def normal(self, x: Element, *, divisors: bool = True) -> Element:
        """Return x with every relation applied: its numerator is zero only if x vanishes, see the module.

        Without those of ``divisors`` a sum is left as it is, with the denominators of its terms.
        """
        for index in sorted(self._relations):
            if not divisors and self._relations[index].power == 1:
                continue
            x = self._relations[index].applied_to(x, self.context, self.work)
        return x

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
        """Return dividend / divisor if that is quickly recognised as a polynomial, else None."""
        degrees = zip(dividend.degrees(), divisor.degrees(), strict=True)
        steps = max((int(high) // int(low) for high, low in degrees if low > 0), default=0)
        if steps > MAX_DIVISION_STEPS or steps * len(dividend) * height(dividend) > MAX_COEFFICIENT_BITS:
            return None
        self.work.spend(len(dividend) * len(divisor) * (steps + 1))
        quotient, remainder = divmod(dividend, divisor)
        return None if remainder else quotient

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
