"""Kernels of matrices whose entries are polynomials in letters: for all values, and where there is more.

Elimination divides by pivots. Where a pivot may be 0, the values at which it is are a *stratum* of their own,
on which elimination goes on with what is left: so no value of the letters is missed. A condition is solved
for a letter that it is linear in; one that is linear in none stays, as a condition that is not resolved.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from flint import fmpz, fmpz_mat, fmpz_mpoly, fmpz_mpoly_ctx, nmod_mat, nmod_poly

Row = dict[int, fmpz_mpoly]
"""The entries of a row, or a column, that are not 0, by their places."""

PRIME = 2**61 - 1
"""A prime modulo which ranks are found first: a rank there is never above the true one."""


@dataclass(frozen=True, slots=True)
class Substitution:
    """A letter and the quotient that a condition says it is."""

    index: int
    numerator: fmpz_mpoly
    denominator: fmpz_mpoly

    def apply(self, entries: Row, *, is_even: bool = False) -> Row:
        """Return a row with the letter replaced, times a power of the denominator, an even one if asked."""
        index, top, parts = self.index, 0, dict[int, dict[int, fmpz_mpoly]]()
        for place, entry in entries.items():
            parts[place] = by_powers(entry, index)
            top = max(top, *parts[place])
        if not top:
            return entries
        top += top % 2 if is_even else 0
        numerators, denominators = _powers(self.numerator, top), _powers(self.denominator, top)
        found = {
            place: sum(
                (part * numerators[k] * denominators[top - k] for k, part in powers.items()),
                self.numerator.context().constant(0),
            )
            for place, powers in parts.items()
        }
        return {place: entry for place, entry in found.items() if entry}

    def apply_to(self, polynomial: fmpz_mpoly) -> fmpz_mpoly:
        """Return the polynomial with the letter replaced, times a power of the denominator."""
        return self.apply({0: polynomial}).get(0, polynomial.context().constant(0))


@dataclass(frozen=True, slots=True)
class Stratum:
    """Values of the letters at which ``conditions`` are 0, all solved for letters but ``unresolved``."""

    conditions: tuple[fmpz_mpoly, ...]
    substitutions: tuple[Substitution, ...]
    unresolved: fmpz_mpoly | None = None

    def apply(self, entries: Row) -> Row:
        """Return a row on the stratum, times what is not 0 there."""
        for each in self.substitutions:
            entries = each.apply(entries)
        return entries

    def apply_to(self, polynomial: fmpz_mpoly) -> fmpz_mpoly:
        """Return a polynomial on the stratum, times what is not 0 there."""
        return (
            self.apply({0: polynomial}).get(0, polynomial.context().constant(0)) if polynomial else polynomial
        )

    def equations(self) -> list[fmpz_mpoly]:
        """Return the conditions, each with the letters that are left and the one it is solved for."""
        found: list[fmpz_mpoly] = []
        for number, each in enumerate(self.substitutions):
            row = {0: each.denominator} | ({1: each.numerator} if each.numerator else {})
            for later in self.substitutions[number + 1 :]:
                row = later.apply(row)
            row = primitive(row)
            x = each.numerator.context().gens()[each.index]
            equation = row[0] * x - row.get(1, x.context().constant(0))
            found.append(-equation if int(equation.leading_coefficient()) < 0 else equation)
        return found if self.unresolved is None else [*found, self.unresolved]


EVERYWHERE = Stratum((), ())


@dataclass(frozen=True, slots=True)
class Letters:
    """The letters of a matrix: their ring, and which of them are positive."""

    ring: fmpz_mpoly_ctx
    positive: frozenset[int]

    def is_unit(self, polynomial: fmpz_mpoly) -> bool:
        """Whether the polynomial is nowhere 0: all its terms have one sign, and one of them is not 0."""
        return self.sign(polynomial) != 0

    def sign(self, polynomial: fmpz_mpoly) -> int:
        """Return the sign that the polynomial has everywhere by its terms; 0 where they do not show it."""
        signs, is_strict = set[bool](), False
        for exponents, coefficient in polynomial.terms():
            odd = any(k % 2 and i not in self.positive for i, k in enumerate(exponents))
            free = any(k and i not in self.positive for i, k in enumerate(exponents))
            if odd:
                return 0
            signs.add(int(coefficient) > 0)
            is_strict = is_strict or not free
        return (1 if signs.pop() else -1) if is_strict and len(signs) == 1 else 0

    def as_sum_of_squares(self, polynomial: fmpz_mpoly) -> list[fmpz_mpoly] | None:
        """Return terms of one sign, which are all 0 where the polynomial is; None if it has others."""
        signs = set[bool]()
        for exponents, coefficient in polynomial.terms():
            if any(k % 2 and i not in self.positive for i, k in enumerate(exponents)):
                return None
            signs.add(int(coefficient) > 0)
        if len(signs) > 1 or len(polynomial) < 2:
            return None
        return [self.ring.term(exp_vec=exponents) for exponents, _ in polynomial.terms()]

    def factors(self, polynomial: fmpz_mpoly) -> list[fmpz_mpoly]:
        """Return the different irreducible factors that may be 0."""
        if polynomial.is_constant():
            return []
        return [factor for factor, _ in polynomial.factor()[1] if not self.is_unit(factor)]


@dataclass(slots=True)
class _Work:
    """A matrix during elimination on one stratum."""

    letters: Letters
    stratum: Stratum
    rows: list[Row]
    pivots: list[tuple[int, Row]] = field(default_factory=list)
    nonzero: list[fmpz_mpoly] = field(default_factory=list)
    conditions: list[fmpz_mpoly] = field(default_factory=list)
    """To be applied before elimination goes on."""
    is_late: Callable[[], bool] = lambda: False
    positive: list[fmpz_mpoly] = field(default_factory=list)
    """Polynomials that are > 0, since letters that were replaced are."""
    is_generic: bool = False
    """Whether only almost all values matter: then every polynomial but 0 may be divided by."""

    def may_vanish(self, polynomial: fmpz_mpoly) -> list[fmpz_mpoly]:
        """Return the different irreducible factors that are not known to be nowhere 0."""
        if self.is_generic:
            return []
        known = self.nonzero
        return [f for f in self.letters.factors(polynomial) if not any(_equal(f, other) for other in known)]

    def but_with(self, **changes: object) -> "_Work":
        """Return a copy that can be worked on separately."""
        copies = {"rows": list(self.rows), "pivots": list(self.pivots), "nonzero": list(self.nonzero)}
        return replace(self, **{**copies, **changes})  # type: ignore[arg-type]


def kernel(
    rows: Sequence[Row], width: int, letters: Letters, is_late: Callable[[], bool] = lambda: False
) -> list[Row]:
    """Return a basis of the columns x with rows · x = 0, over the field of rational functions.

    Its entries are polynomials; it is one for all values of the letters but some.

    Raises
    ------
    TimeoutError
        It is late.
    """
    if not letters.ring.nvars():
        return _number_kernel(rows, width, letters.ring)
    made = [primitive(row) for row in rows if row]
    work = _Work(letters, EVERYWHERE, made, is_generic=True, is_late=is_late)
    _eliminate(work)
    return _solutions(work.pivots, width, letters.ring)


def special_strata(
    rows: Sequence[Row], letters: Letters, is_late: Callable[[], bool] = lambda: False
) -> Iterator[Stratum]:
    """Yield strata that have all values of the letters at which the rank may be less than it is elsewhere.

    Raises
    ------
    TimeoutError
        It is late, and there may be more.
    """
    first = _Work(letters, EVERYWHERE, [row for row in rows if row], is_late=is_late)
    waiting, generic = [first], -1
    while waiting:
        for settled in _settled(waiting.pop()):
            if isinstance(settled, Stratum):
                yield settled
                continue
            waiting += _eliminate(settled)
            if not settled.stratum.conditions:
                generic = len(settled.pivots)
            elif len(settled.pivots) < generic:
                yield settled.stratum


def _settled(work: _Work) -> Iterator["_Work | Stratum"]:
    """Yield the work with all its conditions applied, in as many cases as they have."""
    stack = [work]
    while stack:
        now = stack.pop()
        if not now.conditions:
            yield now
            continue
        condition, *later = now.conditions
        condition = now.stratum.apply_to(condition)
        if not condition:
            stack.append(now.but_with(conditions=later))
        for factor in now.may_vanish(condition) if condition else ():
            squares = now.letters.as_sum_of_squares(factor)
            if squares is not None:
                stack.append(now.but_with(conditions=[*squares, *later]))
                continue
            solved = _solved_for(factor, now.letters)
            if solved is None:
                known = now.stratum
                yield Stratum((*known.conditions, factor), known.substitutions, factor)
                continue
            if not now.letters.is_unit(solved.denominator):
                # Where the coefficient of the letter is 0, so is the rest.
                stack.append(now.but_with(conditions=[solved.denominator, solved.numerator, *later]))
            stack += _solved(now, factor, solved, later)


def _solved(work: _Work, factor: fmpz_mpoly, solved: Substitution, later: list[fmpz_mpoly]) -> list[_Work]:
    """Return the work with a letter replaced; nothing where what is not 0, or positive, would not be."""
    positive = [solved.numerator * solved.denominator] if solved.index in work.letters.positive else []
    for each in work.positive:
        positive += solved.apply({0: each}, is_even=True).values() or [each.context().constant(0)]
    nonzero = [*(solved.apply_to(each) for each in work.nonzero), solved.denominator, *positive]
    if not all(nonzero):
        return []
    if any(work.letters.is_unit(each) and int(each.leading_coefficient()) < 0 for each in positive):
        return []
    known: list[fmpz_mpoly] = []
    for each in nonzero:
        known += [f for f in work.letters.factors(each) if not any(_equal(f, other) for other in known)]
    stratum = work.stratum
    deeper = Stratum((*stratum.conditions, factor), (*stratum.substitutions, solved))
    rows = [row for row in map(solved.apply, work.rows) if row]
    pivots = [(column, solved.apply(row)) for column, row in work.pivots]
    return [_Work(work.letters, deeper, rows, pivots, known, later, work.is_late, positive)]


def _solved_for(factor: fmpz_mpoly, letters: Letters) -> Substitution | None:
    """Return a letter that a condition is linear in, its coefficient nowhere 0 if possible, or None."""
    best: Substitution | None = None
    degrees = [int(degree) for degree in factor.degrees()]
    for index in reversed(range(len(degrees))):
        if degrees[index] != 1:
            continue
        parts = by_powers(factor, index)
        found = Substitution(index, -parts.get(0, letters.ring.constant(0)), parts[1])
        if letters.is_unit(found.denominator):
            return found
        best = best or found
    return best


def _eliminate(work: _Work) -> list[_Work]:
    """Eliminate until no row is left; return what remains to be done where a pivot is 0."""
    branches: list[_Work] = []
    while work.rows:
        number, column, factors = _next_pivot(work)
        for factor in factors:
            branches.append(work.but_with(conditions=[factor]))
            work.nonzero.append(factor)
        pivot = primitive(work.rows.pop(number), work)
        work.pivots.append((column, pivot))
        changed: list[Row] = []
        for row in work.rows:
            if work.is_late():
                raise TimeoutError
            changed.append(_combined(row, pivot, column, work) if column in row else row)
        work.rows = [row for row in changed if row]
    return branches


def _next_pivot(work: _Work) -> tuple[int, int, list[fmpz_mpoly]]:
    """Return row and column of a pivot, one that is nowhere 0 if there is one, and its new factors."""
    counts: dict[int, int] = {}
    for row in work.rows:
        for column in row:
            counts[column] = counts.get(column, 0) + 1
    best: tuple[tuple[int, int], int, int] | None = None
    simplest: tuple[tuple[int, int, int], int, int] | None = None
    for number, row in enumerate(work.rows):
        for column, entry in row.items():
            fill = (len(row) - 1) * (counts[column] - 1)
            if work.is_generic or entry.is_constant() or work.letters.is_unit(entry):
                key = (fill + len(entry) - 1, fill)
                if best is None or key < best[0]:
                    best = (key, number, column)
            elif best is None:
                size = (len(entry), int(entry.total_degree()), fill)
                if simplest is None or size < simplest[0]:
                    simplest = (size, number, column)
    if best is not None:
        return best[1], best[2], []
    assert simplest is not None
    _, number, column = simplest
    return number, column, work.may_vanish(work.rows[number][column])


def _combined(row: Row, pivot: Row, column: int, allowed: _Work | None = None) -> Row:
    """Return the row with its entry in the column eliminated."""
    ours, theirs = row[column], pivot[column]
    common = ours.gcd(theirs)
    ours, theirs = ours / common, theirs / common
    result = {place: entry * theirs for place, entry in row.items() if place != column}
    for place, entry in pivot.items():
        if place != column:
            change = entry * ours
            result[place] = result[place] - change if place in result else -change
    return primitive({place: entry for place, entry in result.items() if entry}, allowed)


def primitive(row: Row, allowed: "_Work | None" = None) -> Row:
    """Return the row without the common factor of its entries, or without the part ``allowed``."""
    common: fmpz_mpoly | None = None
    for entry in sorted(row.values(), key=len):
        common = entry if common is None else common.gcd(entry)
        if common.is_one():
            return row
    if common is None:
        return row
    if allowed is not None:
        for factor in allowed.may_vanish(common):
            while True:
                quotient, rest = divmod(common, factor)
                if rest:
                    break
                common = quotient
    return {place: entry / common for place, entry in row.items()}


def _solutions(pivots: Sequence[tuple[int, Row]], width: int, ring: fmpz_mpoly_ctx) -> list[Row]:
    fixed = {column for column, _ in pivots}
    found: list[Row] = []
    for free in range(width):
        if free in fixed:
            continue
        vector: Row = {free: ring.constant(1)}
        for column, row in reversed(pivots):
            zero = ring.constant(0)
            total = sum((row[k] * vector[k] for k in row if k != column and k in vector), zero)
            if total:
                common = total.gcd(row[column])
                scale = row[column] / common
                vector = {place: entry * scale for place, entry in vector.items()}
                vector[column] = -(total / common)
        found.append(primitive(vector))
    return found


def _number_kernel(rows: Sequence[Row], width: int, ring: fmpz_mpoly_ctx) -> list[Row]:
    matrix = fmpz_mat(max(len(rows), 1), width)
    for number, row in enumerate(rows):
        for column, entry in row.items():
            matrix[number, column] = entry.leading_coefficient()
    vectors, dimension = matrix.nullspace()
    found: list[Row] = []
    for place in range(dimension):
        entries = {k: ring.constant(vectors[k, place]) for k in range(width) if vectors[k, place]}
        found.append(primitive(entries))
    return found


def echelon(vectors: Sequence[Row]) -> list[Row]:
    """Return a basis of the same space in which each vector has a last place of its own, in rising order.

    So the vectors whose last places are first span all that has nothing behind.
    """
    rest = [dict(vector) for vector in vectors]
    found: list[Row] = []
    while rest:
        column = max(max(vector) for vector in rest)
        place = min((k for k, vector in enumerate(rest) if column in vector), key=lambda k: len(rest[k]))
        pivot = rest.pop(place)
        found.append(pivot)
        rest = [_combined(each, pivot, column) if column in each else each for each in rest]
        rest = [each for each in rest if each]
    return found[::-1]


def rank_modulo(rows: Sequence[Mapping[int, int]], width: int, prime: int = PRIME) -> int:
    """Return the rank of numbers modulo a prime."""
    if not rows:
        return 0
    matrix = nmod_mat(len(rows), width, prime)
    for number, row in enumerate(rows):
        for column, entry in row.items():
            matrix[number, column] = entry % prime
    return int(matrix.rank())


def evaluated(polynomial: fmpz_mpoly, values: Sequence[int], prime: int = PRIME) -> int:
    """Return the value of a polynomial modulo a prime."""
    total = 0
    for exponents, coefficient in polynomial.terms():
        term = int(coefficient)
        for value, exponent in zip(values, exponents, strict=True):
            if exponent:
                term = term * pow(value, int(exponent), prime) % prime
        total += term
    return total % prime


def root_modulo(values: Sequence[int], prime: int = PRIME) -> int | None:
    """Return a root modulo a prime of the polynomial with these coefficients, if it has one."""
    polynomial = nmod_poly([value % prime for value in values], prime)
    for factor, _ in polynomial.factor()[1] if polynomial.degree() > 0 else ():
        if factor.degree() == 1:
            return -int(factor[0]) * pow(int(factor[1]), -1, prime) % prime
    return None


def random_numbers(prime: int = PRIME) -> Iterator[int]:
    """Yield numbers modulo the prime, always the same, as good as random (SplitMix64, Steele et al. 2014).

    They must not be tied by polynomials, as those of a linear congruential generator are.
    """
    state, words = 0, 1 << 64
    while True:
        state = (state + 0x9E3779B97F4A7C15) % words
        mixed = (state ^ state >> 30) * 0xBF58476D1CE4E5B9 % words
        mixed = (mixed ^ mixed >> 27) * 0x94D049BB133111EB % words
        yield (mixed ^ mixed >> 31) % prime


def _equal(left: fmpz_mpoly, right: fmpz_mpoly) -> bool:
    return bool(left == right or left == -right)


def by_powers(polynomial: fmpz_mpoly, index: int) -> dict[int, fmpz_mpoly]:
    """Return the coefficients of the powers of one generator, those that are not 0."""
    parts: dict[int, dict[tuple[int, ...], int | fmpz]] = {}
    for exponents, coefficient in polynomial.to_dict().items():
        rest = (*exponents[:index], 0, *exponents[index + 1 :])
        parts.setdefault(int(exponents[index]), {})[rest] = coefficient
    return {power: polynomial.context().from_dict(terms) for power, terms in parts.items()}


def coefficients(
    polynomial: fmpz_mpoly, ring: fmpz_mpoly_ctx, places: slice
) -> dict[tuple[int, ...], fmpz_mpoly]:
    """Return the coefficients, in ``ring``, of the monomials in the generators at ``places``, an end."""
    parts: dict[tuple[int, ...], dict[tuple[int, ...], int | fmpz]] = {}
    for exponents, coefficient in polynomial.to_dict().items():
        whole = tuple(int(each) for each in exponents)
        monomial = whole[places]
        letters = whole[len(monomial) :] if places.start is None else whole[: places.start]
        parts.setdefault(monomial, {})[letters] = coefficient
    return {monomial: ring.from_dict(terms) for monomial, terms in parts.items()}


def _powers(base: fmpz_mpoly, top: int) -> list[fmpz_mpoly]:
    found = [base.context().constant(1)]
    for _ in range(top):
        found.append(found[-1] * base)
    return found
