"""All polynomial integrals up to a degree in ω and γ: exact linear algebra over the letters.

With the momenta m = (A p, B q, C r) the equations are m' = m × ω + γ × ∇V, γ' = γ × ω, and the areas integral
m·γ has no letters in it. Modulo |γ| = 1, and m·γ = 0 where asked, each polynomial has one form without

    g3²,   m3 g3,   m3 g1²

(the last two for the zero level only: the leading terms of a Gröbner basis), by which no degree rises. A
combination of such monomials is an integral if its derivative in time has the form 0: linear equations, which
fall apart into blocks by the symmetries of the setting. The kernel is taken by rising degree. An integral is
new if the gradients of those before and its own are independent at a random point modulo a prime.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from flint import fmpz_mpoly, nmod_mat

from service.dynamics.discovery.closure import on_sphere, on_zero_areas
from service.dynamics.discovery.functions import ORDER, Functions, Quotient
from service.dynamics.discovery.independence import ModularPoint
from service.dynamics.discovery.known import Candidate, candidates
from service.dynamics.discovery.setting import (
    POTENTIAL_POINTER,
    STATE,
    FoundIntegral,
    FunctionTooLargeError,
    IntegralSearch,
    LetteredSetting,
    NotPolynomialError,
    SearchTooLargeError,
    SpecialIntegrals,
    Tell,
    steps_of,
    thirds_of,
    untold,
)
from service.dynamics.discovery.strata import (
    EVERYWHERE,
    Letters,
    Row,
    Stratum,
    echelon,
    evaluated,
    kernel,
    primitive,
    special_strata,
)
from service.dynamics.formula.algebras.monomials import weighted_sum
from service.dynamics.formula.parameters import MOMENTS
from service.dynamics.formula.tree import VARIABLES, Tree
from service.dynamics.verdict.exact_ring.generators import NoProofError

MAX_UNKNOWNS = 3000
"""Coefficients of one search."""
MAX_LETTER_UNKNOWNS = 400
"""Coefficients of one block in a search with letters."""
MAX_LETTER_DEGREE = 64
"""Largest degree of moments and of the potential in the letters: elimination multiplies them, and no step of
it that takes long can be left."""

Monomial = tuple[int, int, int, int, int, int]
"""Exponents of m1, m2, m3, g1, g2, g3."""
Sum = dict[Monomial, int]


@dataclass(slots=True)
class NormalForms:
    """The forms of monomials on the sphere, and on the zero level of the areas."""

    has_zero_areas: bool
    known: dict[Monomial, Sum] = field(default_factory=dict)

    def of(self, monomial: Monomial) -> Sum:
        """Return the monomial as a sum of those that are left."""
        found = self.known.get(monomial)
        if found is None:
            terms = self._replaced(monomial)
            found = {monomial: 1}
            if terms is not None:
                found = weighted_sum((value, self.of(other)) for other, value in terms)
            self.known[monomial] = found
        return found

    def is_normal(self, monomial: Monomial) -> bool:
        """Whether a monomial is left as it is."""
        return self._replaced(monomial) is None

    def _replaced(self, monomial: Monomial) -> list[tuple[Monomial, int]] | None:
        a, b, c, i, j, k = monomial
        if k >= 2:
            k -= 2
            return [((a, b, c, i, j, k), 1), ((a, b, c, i + 2, j, k), -1), ((a, b, c, i, j + 2, k), -1)]
        if not self.has_zero_areas or not c:
            return None
        if k:
            return [((a + 1, b, c - 1, i + 1, j, k - 1), -1), ((a, b + 1, c - 1, i, j + 1, k - 1), -1)]
        if i >= 2:
            # m3 g1² = m3 (1 - g2²) + g3 (m1 g1 + m2 g2).
            i -= 2
            return [
                ((a, b, c, i, j, k), 1),
                ((a, b, c, i, j + 2, k), -1),
                ((a + 1, b, c - 1, i + 1, j, k + 1), 1),
                ((a, b + 1, c - 1, i, j + 1, k + 1), 1),
            ]
        return None


@dataclass(frozen=True, slots=True)
class _Equations:
    """Derivatives of the six variables in time, times one denominator: coefficients by exponents."""

    rates: tuple[dict[Monomial, fmpz_mpoly], ...]

    def of(self, monomial: Monomial) -> Iterator[tuple[Monomial, fmpz_mpoly]]:
        """Yield the terms of the derivative of a monomial."""
        for place, exponent in enumerate(monomial):
            if not exponent:
                continue
            for other, value in self.rates[place].items():
                total = [a + b for a, b in zip(monomial, other, strict=True)]
                total[place] -= 1
                a, b, c, i, j, k = total
                yield (a, b, c, i, j, k), exponent * value


def search_integrals(
    setting: LetteredSetting,
    omega_degree: int,
    gamma_degree: int,
    *,
    areas_zero: bool = False,
    is_late: Callable[[], bool] = lambda: False,
    tell: Tell = untold,
) -> IntegralSearch:
    """Return all polynomial integrals up to the degrees, for all letters and where there are more.

    Parameters
    ----------
    setting
        A body and a polynomial potential, with any number of letters.
    omega_degree, gamma_degree
        Upper bounds of the degrees in p, q, r and in g1, g2, g3, of some form of the integral on |γ| = 1.
    areas_zero
        Look for what is constant where I3 = 0.
    tell
        Is told the share of steps that are done: blocks that are solved, with letters also blocks in which
        special values are looked for, and values that are tried, a third each.

    Raises
    ------
    NotPolynomialError
        The potential is no polynomial in g1, g2, g3.
    FunctionTooLargeError, UndefinedFunctionError
        The potential is too large, or has no value.
    SearchTooLargeError
        More unknowns than are solved for.
    TimeoutError
        It was late before those for all values of the letters were found.
    """
    search = _Search.of(setting, omega_degree, gamma_degree, areas_zero, is_late)
    has_letters = bool(search.letters.ring.nvars())
    first, second, third = thirds_of(tell)
    generic = search.integrals_on(EVERYWHERE, is_late, first if has_letters else tell)
    strata, is_complete = list[Stratum](), True
    for block in steps_of(search.blocks, second) if has_letters else ():
        try:
            strata += special_strata(block.rows, search.letters, is_late)
        except TimeoutError:
            is_complete = False
    special = list[SpecialIntegrals]()
    for each in search.special(strata, len(generic), is_late, third):
        if each is None:
            is_complete = False
        else:
            special.append(each)
    return IntegralSearch(tuple(generic), tuple(special), len(search.monomials), is_complete)


@dataclass(frozen=True, slots=True)
class _Block:
    """Unknowns that no equation ties to others, and the equations for them, by places in the block."""

    places: tuple[int, ...]
    rows: list[Row]


@dataclass(frozen=True, slots=True)
class _Search:
    field: Functions
    letters: Letters
    monomials: list[Monomial]
    blocks: list[_Block]
    has_zero_areas: bool
    candidates: list[Candidate]

    @classmethod
    def of(
        cls,
        setting: LetteredSetting,
        omega_degree: int,
        gamma_degree: int,
        has_zero_areas: bool,
        is_late: Callable[[], bool],
    ) -> "_Search":
        tape = setting.tape(setting.potential)
        field_ = Functions(setting, [tape])
        letters, forms = field_.letters, NormalForms(has_zero_areas)
        equations = _equations(field_)
        monomials = [
            each for each in _monomials(omega_degree, gamma_degree) if any(each) and forms.is_normal(each)
        ]
        if len(monomials) > MAX_UNKNOWNS:
            raise SearchTooLargeError(
                f"{len(monomials)} coefficients would be solved for; {MAX_UNKNOWNS} are the most",
                pointer="/degree",
            )
        rows: dict[Monomial, Row] = {}
        for column, monomial in enumerate(monomials):
            if is_late():
                raise TimeoutError
            for other, value in equations.of(monomial):
                for each, factor in forms.of(other).items():
                    row = rows.setdefault(each, {})
                    row[column] = row[column] + factor * value if column in row else factor * value
        found = [{k: entry for k, entry in row.items() if entry} for row in rows.values()]
        blocks = _split([row for row in found if row], len(monomials))
        largest = max((len(block.places) for block in blocks), default=0)
        if letters.ring.nvars() and largest > MAX_LETTER_UNKNOWNS:
            raise SearchTooLargeError(
                f"{largest} coefficients hang together; with letters {MAX_LETTER_UNKNOWNS} are the most",
                pointer="/degree",
            )
        return cls(field_, letters, monomials, blocks, has_zero_areas, list(candidates(field_)))

    def integrals_on(
        self, stratum: Stratum, is_late: Callable[[], bool], tell: Tell = untold
    ) -> list[FoundIntegral]:
        """Return the integrals on a stratum, by rising degree; raises TimeoutError if it is late."""
        vectors: list[tuple[int, Row]] = []
        for block in steps_of(self.blocks, tell):
            rows = [row for row in map(stratum.apply, block.rows) if row]
            solved = kernel(rows, len(block.places), self.letters, is_late)
            for vector in echelon(solved):
                whole = {block.places[place]: entry for place, entry in vector.items()}
                vectors.append((max(whole), whole))
        vectors.sort(key=lambda each: self._order(each[0]))
        point = ModularPoint.on(self.field, stratum, has_zero_areas=self.has_zero_areas)
        assert point is not None
        span = point.classical()
        rank, found = point.rank(span), list[FoundIntegral]()
        for _, vector in vectors:
            numbers = {place: evaluated(entry, point.letters, point.prime) for place, entry in vector.items()}
            gradient = point.gradient(self.monomials, numbers)
            if point.rank([*span, gradient]) > rank:
                rank += 1
                found.append(self._found(vector, stratum, [*span, gradient], point))
                span.append(gradient)
        return found

    def independent_on(self, stratum: Stratum) -> int | None:
        """Return how many independent integrals there are at a random point of a stratum, modulo a prime.

        There are no more in truth on nearly all of the stratum. None if no such point was found.
        """
        point = ModularPoint.on(self.field, stratum, has_zero_areas=self.has_zero_areas)
        if point is None:
            return None
        span = point.classical()
        usual = point.rank(span)
        for block in self.blocks:
            matrix = nmod_mat(max(len(block.rows), 1), len(block.places), point.prime)
            for number, row in enumerate(block.rows):
                for column, entry in row.items():
                    matrix[number, column] = evaluated(entry, point.letters, point.prime)
            vectors, dimension = matrix.nullspace()
            for place in range(dimension):
                numbers = {
                    block.places[k]: int(vectors[k, place])
                    for k in range(len(block.places))
                    if vectors[k, place]
                }
                span.append(point.gradient(self.monomials, numbers))
        return point.rank(span) - usual

    def special(
        self, strata: Sequence[Stratum], generic: int, is_late: Callable[[], bool], tell: Tell
    ) -> Iterator[SpecialIntegrals | None]:
        """Yield what strata have beyond all values of the letters and wider strata; None if it is late."""
        found: list[tuple[Stratum, SpecialIntegrals]] = []
        for stratum in steps_of(sorted(strata, key=lambda each: len(each.conditions)), tell):
            if is_late():
                yield None
                return
            texts = tuple(map(str, stratum.equations()))
            wider = [
                len(each.integrals)
                for other, each in found
                if each.is_resolved and not any(map(stratum.apply_to, other.conditions))
            ]
            independent = self.independent_on(stratum)
            has_more = independent is None or independent > max([generic, *wider])
            if stratum.unresolved is None and has_more:
                try:
                    integrals = self.integrals_on(stratum, is_late)
                except TimeoutError:
                    yield None
                    return
                found.append((stratum, SpecialIntegrals(texts, tuple(integrals))))
                yield found[-1][1]
            is_new = not any(texts == each.conditions for _, each in found)
            if stratum.unresolved is not None and is_new and (has_more or not self._is_one_case(stratum)):
                found.append((stratum, SpecialIntegrals(texts, (), is_resolved=False)))
                yield found[-1][1]

    def _is_one_case(self, stratum: Stratum) -> bool:
        """Whether all of an unresolved stratum is known by one point: conjugate values, or equal moments.

        Moments may be multiplied by any number, which changes the time alone: two of them with a given
        ratio are one case. A coefficient that is left may be 0, which would be a case of its own.
        """
        solved = {each.index for each in stratum.substitutions}
        free = set(range(self.letters.ring.nvars())) - solved
        condition = stratum.unresolved
        if len(free) == 1 or condition is None:
            return True
        degrees = {sum(map(int, exponents)) for exponents in condition.monoms()}
        is_ray = len(free) == 2 and free <= self.letters.positive and len(degrees) == 1
        return is_ray and set(MOMENTS) <= set(self.field.setting.letters)

    def _order(self, place: int) -> tuple[int, int, int]:
        monomial = self.monomials[place]
        return (sum(monomial[:3]), sum(monomial[3:]), place)

    def _found(
        self, vector: Row, stratum: Stratum, span: Sequence[Mapping[int, int]], point: ModularPoint
    ) -> FoundIntegral:
        degrees = [self._order(place) for place in vector]
        omega, gamma = max(each[0] for each in degrees), max(each[1] for each in degrees)
        rank = point.rank(span)
        for candidate in self.candidates:
            if self.field.omega_degree(candidate.value) != omega:
                continue
            gradient = point.gradient_of(self.field.quotient_gradient(candidate.value))
            if gradient is None or point.rank([*span, gradient]) > rank:
                continue
            if point.rank([*span[:-1], gradient]) == rank and self._is_integral(candidate, stratum):
                return FoundIntegral(candidate.text, candidate.name, omega, gamma)
        text = self.field.text(self._polynomial(vector, stratum)) or ""
        return FoundIntegral(text, None, omega, gamma)

    def _is_integral(self, candidate: Candidate, stratum: Stratum) -> bool:
        field_ = self.field
        close = on_zero_areas if self.has_zero_areas else on_sphere
        with suppress(NoProofError):
            rate = field_.along(field_.quotient_gradient(candidate.value), field_.rates())
            entries = field_.split(field_.reduced(rate.numerator, close(field_).relations))
            return not stratum.apply(dict(enumerate(entries.values())))
        return False

    def _polynomial(self, vector: Row, stratum: Stratum) -> fmpz_mpoly:
        """Return the integral in p, q, r, g1, g2, g3 and the letters."""
        field_, ring = self.field, self.field.ring
        letters = ring.gens()[field_.first_letter :]
        moments = field_.moments()
        top = max(self._order(place)[0] for place in vector)
        total = ring.constant(0)
        for place, entry in vector.items():
            monomial = self.monomials[place]
            term = (
                entry.compose(*letters, ctx=ring) if letters else ring.constant(entry.leading_coefficient())
            )
            for name, power in zip(STATE, monomial, strict=True):
                term *= ring.gens()[field_.atoms + ORDER.index(name)] ** power
            for moment, power in zip(moments, monomial, strict=False):
                term *= moment.numerator**power * moment.denominator ** (top - power)
            total += term
        parts = field_.split(total)
        row = stratum.apply(dict(enumerate(parts.values())))
        rest, monomials = ring.constant(0), list(parts)
        for place, entry in primitive(row).items():
            lifted = (
                entry.compose(*letters, ctx=ring) if letters else ring.constant(entry.leading_coefficient())
            )
            rest += lifted * ring.term(exp_vec=(*monomials[place], *(0,) * len(letters)))
        return -rest if int(rest.leading_coefficient()) < 0 else rest


def _monomials(omega_degree: int, gamma_degree: int) -> list[Monomial]:
    """Return the exponents up to the degrees, lower degrees first."""

    def triples(degree: int) -> list[tuple[int, int, int]]:
        return [(i, j, degree - i - j) for i in range(degree, -1, -1) for j in range(degree - i, -1, -1)]

    return [
        (*omega, *gamma)
        for n in range(omega_degree + 1)
        for k in range(gamma_degree + 1)
        for omega in triples(n)
        for gamma in triples(k)
    ]


def _equations(field_: Functions) -> _Equations:
    setting = field_.setting
    field_.require_setting()
    V = _read(field_, setting.potential, POTENTIAL_POINTER)
    pairs = zip(MOMENTS, setting.moments, strict=True)
    moments = [_read(field_, each, f"/body/{name}") for name, each in pairs]
    if any(int(k) for k in V.denominator.degrees()[: field_.first_letter]) or any(
        int(k) for k in V.numerator.degrees()[: field_.atoms]
    ):
        raise NotPolynomialError(
            "integrals are searched for potentials that are polynomials in g1, g2, g3",
            pointer=POTENTIAL_POINTER,
        )
    common = V.denominator
    for each in moments:
        common = common * each.numerator / common.gcd(each.numerator)
    letters = field_.letters.ring

    def scaled(value: fmpz_mpoly) -> fmpz_mpoly:
        return field_.split(value).get((0,) * field_.first_letter, letters.constant(0))

    inverse = [scaled(each.denominator * (common / each.numerator)) for each in moments]
    slopes: list[dict[Monomial, fmpz_mpoly]] = [{}, {}, {}]
    for exponents, value in field_.split(V.numerator * (common / V.denominator)).items():
        gamma = [exponents[field_.atoms + ORDER.index(name)] for name in VARIABLES]
        for place, power in enumerate(gamma):
            if power:
                lowered = [power - (k == place) for k, power in enumerate(gamma)]
                slopes[place][0, 0, 0, lowered[0], lowered[1], lowered[2]] = power * value
    rates: list[dict[Monomial, fmpz_mpoly]] = []
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rate = {_product({j: 1, k: 1}): inverse[k] - inverse[j]}
        for place, other, sign in ((j, k, 1), (k, j, -1)):
            for monomial, value in slopes[other].items():
                raised = list(monomial)
                raised[3 + place] += 1
                a, b, c, d, e, f = raised
                rate[a, b, c, d, e, f] = rate.get((a, b, c, d, e, f), letters.constant(0)) + sign * value
        rates.append({monomial: value for monomial, value in rate.items() if value})
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rates.append({_product({3 + j: 1, k: 1}): inverse[k], _product({3 + k: 1, j: 1}): -inverse[j]})
    return _Equations(tuple(rates))


def _read(field_: Functions, tree: Tree, pointer: str) -> Quotient:
    """Return a moment or the potential; one of too high a degree in the letters is refused at ``pointer``."""
    value = field_.read(field_.setting.tape(tree), pointer)
    monomials = (m for part in (value.numerator, value.denominator) for m in part.monoms())
    degree = max(sum(int(k) for k in monomial[field_.first_letter :]) for monomial in monomials)
    if degree > MAX_LETTER_DEGREE:
        reason = f"its degree in the letters is {degree}; a search accepts degrees up to {MAX_LETTER_DEGREE}"
        raise FunctionTooLargeError(reason, pointer=pointer)
    return value


def _product(powers: Mapping[int, int]) -> Monomial:
    a, b, c, d, e, f = (powers.get(k, 0) for k in range(6))
    return (a, b, c, d, e, f)


def _split(rows: Sequence[Row], width: int) -> list[_Block]:
    """Return the blocks of unknowns that rows tie together."""
    leader = list(range(width))

    def find(place: int) -> int:
        while leader[place] != place:
            leader[place] = leader[leader[place]]
            place = leader[place]
        return place

    for row in rows:
        first, *others = row
        for other in others:
            leader[find(other)] = find(first)
    places: dict[int, list[int]] = {}
    for place in range(width):
        places.setdefault(find(place), []).append(place)
    tied: dict[int, list[Row]] = {}
    for row in rows:
        tied.setdefault(find(next(iter(row))), []).append(row)
    blocks = []
    for key, members in places.items():
        index = {place: k for k, place in enumerate(members)}
        local = [{index[place]: entry for place, entry in row.items()} for row in tied.get(key, [])]
        blocks.append(_Block(tuple(members), local))
    return blocks
