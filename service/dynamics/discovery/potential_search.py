"""Polynomial potentials with planar motions: all up to a degree, and every ratio A/C with more than others.

L(V) = 0 is linear in the coefficients of V, and in A and C. On the sphere it is solved degree by degree by
homogeneous polynomials, see :mod:`service.dynamics.inverse.projection`, and separately for the parities of
their exponents. A basis has of each degree what is no multiple by |γ|² of what the one two below has.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import reduce
from itertools import product as pairs_of

from flint import Ordering, acb_poly, fmpz_mpoly, fmpz_mpoly_ctx, fmpz_poly

from service.dynamics.discovery.functions import Functions
from service.dynamics.discovery.setting import (
    POTENTIAL_POINTER,
    AdmittingRatios,
    NotPolynomialError,
    PotentialSearch,
    SearchTooLargeError,
    SpecialRatio,
    Tell,
    read_setting,
    steps_of,
    thirds_of,
    untold,
)
from service.dynamics.discovery.strata import (
    PRIME,
    Letters,
    Row,
    Stratum,
    coefficients,
    echelon,
    evaluated,
    kernel,
    rank_modulo,
    root_modulo,
    special_strata,
)
from service.dynamics.equations.compatibility import pde_residual
from service.dynamics.errors import EqualMomentsError
from service.dynamics.formula.tree import VARIABLES

MAX_DEGREE = 16
"""The largest degree of a search."""
_GAMMA = slice(-3, None)
"""The places of g1, g2, g3."""
_AT = (1_000_003, 998_244_353)
"""Values of A and C at which ranks are compared modulo a prime."""
_PRIMES = range(10_007, 14_007, 2)
"""Odd numbers among which a prime is looked for modulo which a polynomial has a root."""


@dataclass(frozen=True, slots=True)
class _Ring:
    """Polynomials in A, C, g1, g2, g3; with the letters A and C, or numbers in their places."""

    whole: fmpz_mpoly_ctx
    letters: Letters
    A: fmpz_mpoly
    C: fmpz_mpoly
    kernels: "dict[_Block, list[fmpz_mpoly]]" = field(default_factory=dict)
    """Bases that were found: each is asked for by blocks above it, and beside others."""

    @property
    def gamma(self) -> tuple[fmpz_mpoly, ...]:
        return tuple(self.whole.gens()[-3:])

    def residual(self, polynomial: fmpz_mpoly) -> fmpz_mpoly:
        """Return L of a polynomial."""
        first = [polynomial.derivative(name) for name in VARIABLES]
        second = [[part.derivative(name) for name in VARIABLES] for part in first]
        return pde_residual(self.A, self.C, self.gamma, first, second)


def _ring(ratio: Fraction | None) -> _Ring:
    names = ("A", "C") if ratio is None else ()
    whole = fmpz_mpoly_ctx.get((*names, *VARIABLES), Ordering.lex)
    letters = Letters(fmpz_mpoly_ctx.get(names, Ordering.lex), frozenset(range(len(names))))
    if ratio is None:
        A, C, *_ = whole.gens()
        return _Ring(whole, letters, A, C)
    return _Ring(whole, letters, whole.constant(ratio.numerator), whole.constant(ratio.denominator))


@dataclass(frozen=True, slots=True)
class _Block:
    """The homogeneous polynomials of one degree whose exponents have given parities."""

    degree: int
    parities: tuple[int, int, int]

    @property
    def monomials(self) -> list[tuple[int, int, int]]:
        """The exponents, those of high powers of g2 first."""
        n, (a, b, c) = self.degree, self.parities
        found = [
            (i, j, n - i - j) for i in range(a, n + 1, 2) for j in range(b, n + 1 - i, 2) if n - i - j >= c
        ]
        return sorted(found, key=lambda exponents: (-exponents[1], exponents))

    @property
    def below(self) -> "_Block":
        """The block whose multiples by |γ|² are in this one."""
        return _Block(self.degree - 2, self.parities)

    def rows(self, ring: _Ring) -> list[Row]:
        """Return the equations L(V) = 0 for the coefficients of the monomials."""
        rows: dict[tuple[int, ...], Row] = {}
        for column, monomial in enumerate(self.monomials):
            padded = (*(0,) * (len(ring.whole.names()) - 3), *monomial)
            image = ring.residual(ring.whole.from_dict({padded: 1}))
            for place, entry in coefficients(image, ring.letters.ring, _GAMMA).items():
                rows.setdefault(place, {})[column] = entry
        return list(rows.values())

    def kernel(self, ring: _Ring) -> list[fmpz_mpoly]:
        """Return a basis of the admissible ones, with high powers of g2 first."""
        found = ring.kernels.get(self)
        if found is None:
            found = ring.kernels[self] = [] if self.degree < 0 else self._solved(ring)
        return found

    def _solved(self, ring: _Ring) -> list[fmpz_mpoly]:
        monomials, found = self.monomials, list[fmpz_mpoly]()
        for row in echelon(kernel(self.rows(ring), len(monomials), ring.letters)):
            terms = {
                (*low, *monomials[place]): value for place, each in row.items() for low, value in each.terms()
            }
            found.append(ring.whole.from_dict(terms))
        return found


def search_potentials(
    ratio: Fraction | None,
    degree: int,
    is_late: Callable[[], bool] = lambda: False,
    tell: Tell = untold,
) -> PotentialSearch:
    """Return all admissible polynomials up to a degree on the sphere, for A/C = ``ratio``.

    Without a ratio: for all A ≠ C, with every ratio at which there are more. ``tell`` is told the share of
    blocks that are solved, without a ratio also that of those in which ratios are looked for, and that of
    ratios, a third each.

    Raises
    ------
    EqualMomentsError
        The ratio is 1.
    SearchTooLargeError
        A degree beyond ``MAX_DEGREE``.
    TimeoutError
        It is late.
    """
    if not 0 <= degree <= MAX_DEGREE:
        raise SearchTooLargeError(f"degrees from 0 to {MAX_DEGREE} are searched", pointer="/degree")
    if ratio == 1:
        raise EqualMomentsError("A = C: the compatibility equation needs A ≠ C", pointer="/body")
    ring = _ring(ratio)
    blocks = list(_blocks(degree))
    first, second, third = thirds_of(tell) if ratio is None else (tell, untold, untold)
    found = [factored_text(each) for block in steps_of(blocks, first) for each in _new(ring, block, ())]
    special: set[Fraction] = set()
    if ratio is None:
        for block in steps_of(blocks, second):
            for stratum in special_strata(block.rows(ring), ring.letters, is_late):
                special |= _ratios(ring, block, stratum)
    ratios = []
    in_order = sorted(special - {Fraction(1)}, key=lambda each: (max(each, 1 / each), -each))
    for each in steps_of(in_order, third):
        there, more = _ring(each), list[str]()
        for block in blocks:
            known = [_specialised(V, each) for V in block.kernel(ring)]
            more += map(factored_text, _new(there, block, known))
        ratios.append(SpecialRatio(each, len(found) + len(more), tuple(more)))
    return PotentialSearch(tuple(found), tuple(each for each in ratios if each.potentials))


def ratios_that_admit(
    potential: str,
    parameters: Mapping[str, Fraction],
    *,
    B: Fraction | None = None,
    C: Fraction = Fraction(1),
) -> AdmittingRatios:
    """Return every ratio A/C ≠ 1 for which a polynomial formula is admissible, exactly.

    The formula may have A, B and C in it; ``B`` and ``C`` are the numbers of the last two.

    Raises
    ------
    NotPolynomialError
        The formula is no polynomial in g1, g2, g3 as it stands.
    FunctionTooLargeError
        It is too large.
    FormulaError
        It is no formula.
    """
    moments = {"C": C} if B is None else {"B": B, "C": C}
    setting = read_setting(moments, potential, parameters)
    tape = setting.tape(setting.potential)
    functions = Functions(setting, [tape])
    V, ring = functions.read(tape, POTENTIAL_POINTER), _ring(None)
    known = {name: place for place, name in enumerate(ring.whole.names())}
    terms: dict[tuple[int, ...], int] = {}
    names = [*functions.ring.names()]
    for exponents, value in V.numerator.terms():
        used = {name: int(k) for name, k in zip(names, exponents, strict=True) if k}
        if not used.keys() <= known.keys():
            terms = {}
            break
        terms[tuple(used.get(name, 0) for name in known)] = int(value)
    if not V.denominator.is_constant() or (V.numerator and not terms):
        reason = "ratios are found for potentials that are polynomials in g1, g2, g3"
        raise NotPolynomialError(reason, pointer=POTENTIAL_POINTER)
    A, _, g1, g2, g3 = ring.whole.gens()
    # A is the letter, C a number: L is homogeneous in the two, so that integers can stand for them.
    residual = _Ring(ring.whole, ring.letters, A * C.denominator, ring.whole.constant(C.numerator)).residual(
        ring.whole.from_dict(terms)
    )
    rest = residual % (g1**2 + g2**2 + g3**2 - 1)
    zero = ring.letters.ring.constant(0)
    common = reduce(lambda x, y: x.gcd(y), coefficients(rest, ring.letters.ring, _GAMMA).values(), zero)
    if not common:
        return AdmittingRatios(all=True)
    ratios, others = set[Fraction](), list[str]()
    for factor, _ in common.factor()[1]:
        polynomial = _in_one_letter(factor)
        if polynomial.degree() == 1:
            ratios.add(Fraction(-int(polynomial[0]), int(polynomial[1])) / C)
        elif _has_positive_root(polynomial):
            others.append(str(factor))
    return AdmittingRatios(
        False, tuple(sorted(each for each in ratios if each > 0 and each != 1)), tuple(others)
    )


def _blocks(degree: int) -> Iterator[_Block]:
    for n in range(degree + 1):
        for a, b, c in pairs_of((0, 1), repeat=3):
            if (n - a - b - c) % 2 == 0 and a + b + c <= n:
                yield _Block(n, (a, b, c))


def _new(ring: _Ring, block: _Block, known: Sequence[fmpz_mpoly]) -> list[fmpz_mpoly]:
    """Return admissible polynomials of a block that span it with ``known`` and multiples by |γ|²."""
    g1, g2, g3 = ring.gamma
    square = g1**2 + g2**2 + g3**2
    span = [*known, *(square * each for each in block.below.kernel(ring))]
    found: list[fmpz_mpoly] = []
    rank = _rank(span, block)
    for each in block.kernel(ring):
        if _rank([*span, each], block) > rank:
            rank += 1
            each = _shortened(ring, each, span)
            span.append(each)
            found.append(each)
    return found


def _shortened(ring: _Ring, polynomial: fmpz_mpoly, span: Sequence[fmpz_mpoly]) -> fmpz_mpoly:
    """Return the polynomial plus a multiple of one of ``span`` if that is shorter; its first term is > 0."""
    best = polynomial
    for other in span:
        ours, theirs = (coefficients(each, ring.letters.ring, _GAMMA) for each in (polynomial, other))
        for monomial in ours.keys() & theirs.keys():
            scale, change = (
                each.compose(*ring.whole.gens()[:-3], ctx=ring.whole)
                for each in (theirs[monomial], ours[monomial])
            )
            candidate = scale * polynomial - change * other
            if len(candidate) < len(best):
                best = candidate
    best = best.primitive()[1]
    return -best if int(best.leading_coefficient()) < 0 else best


def _rank(polynomials: Sequence[fmpz_mpoly], block: _Block) -> int:
    """Return the rank of polynomials; of those with letters, at values of these modulo a prime."""
    places: dict[tuple[int, ...], int] = {m: place for place, m in enumerate(block.monomials)}
    rows = []
    for each in polynomials:
        names = each.context().names()[:-3]
        low = fmpz_mpoly_ctx.get(names, Ordering.lex)
        parts = coefficients(each, low, _GAMMA)
        rows.append({places[m]: evaluated(entry, _AT[: len(names)]) for m, entry in parts.items()})
    return rank_modulo(rows, len(places))


def _specialised(polynomial: fmpz_mpoly, ratio: Fraction) -> fmpz_mpoly:
    whole = _ring(ratio).whole
    A, C = whole.constant(ratio.numerator), whole.constant(ratio.denominator)
    return polynomial.compose(A, C, *whole.gens(), ctx=whole)


def _ratios(ring: _Ring, block: _Block, stratum: Stratum) -> set[Fraction]:
    """Return the ratios A/C of a stratum: none where the rank is the same after all.

    Raises
    ------
    SearchTooLargeError
        It is not known.
    """
    polynomial = _in_one_letter(stratum.conditions[-1])
    if polynomial.degree() == 1:
        ratio = Fraction(-int(polynomial[0]), int(polynomial[1]))
        return {ratio} if ratio > 0 else set()
    if not _has_positive_root(polynomial) or _keeps_rank(ring, block, polynomial):
        return set()
    raise SearchTooLargeError(
        f"whether there are more where A/C is a root of {polynomial} was not found", pointer="/degree"
    )


def _keeps_rank(ring: _Ring, block: _Block, polynomial: fmpz_poly) -> bool:
    """Whether the rank at the roots of an irreducible polynomial is that at others, proved modulo a prime.

    A minor that is not 0 at a root modulo a prime is not 0 at the roots, which are conjugate.
    """
    rows = block.rows(ring)
    usual = _rank_at(rows, _AT, PRIME)
    for prime in _PRIMES:
        if any(prime % k == 0 for k in range(3, 120, 2)):
            continue
        known = [int(c) for c in polynomial.coeffs()]
        root = root_modulo(known, prime) if known[-1] % prime else None
        if root is not None:
            return _rank_at(rows, (root, 1), prime) == usual
    return False


def _rank_at(rows: Sequence[Row], values: Sequence[int], prime: int) -> int:
    numbers = [{k: evaluated(entry, values, prime) for k, entry in row.items()} for row in rows]
    return rank_modulo(numbers, max((max(row) for row in rows if row), default=0) + 1, prime)


def _in_one_letter(polynomial: fmpz_mpoly) -> fmpz_poly:
    """Return a polynomial in A and C with C = 1."""
    values = [0] * (int(polynomial.degrees()[0]) + 1)
    for (degree, *_), coefficient in polynomial.terms():
        values[int(degree)] += int(coefficient)
    return fmpz_poly(values)


def _has_positive_root(polynomial: fmpz_poly) -> bool:
    """Whether a polynomial without multiple roots may have a positive one: none of it is 0, or a pair."""
    roots = acb_poly([int(each) for each in polynomial.coeffs()]).roots()
    return any(bool(root.imag.contains(0)) and not root.real < 0 for root in roots)


def factored_text(polynomial: fmpz_mpoly) -> str:
    """Return the polynomial as a product of irreducible factors, shorter ones first, with its sign."""
    if polynomial.is_constant():
        return str(polynomial)
    constant, factors = polynomial.factor()
    pieces = []
    for factor, power in sorted(factors, key=lambda each: (len(each[0]), str(each[0]))):
        is_only = len(factors) == 1 and power == 1 and constant == 1
        piece = str(factor) if len(factor) == 1 or is_only else f"({factor})"
        pieces.append(piece if power == 1 else f"{piece}^{power}")
    text = "*".join(pieces)
    return text if constant == 1 else f"-{text}" if constant == -1 else f"{constant}*{text}"
