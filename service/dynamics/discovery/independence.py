"""Functional independence of an integral from the classical ones, and its name.

It is proved by a state with an enclosed minor of the gradients that is not 0, and refuted by a relation: a
linear one between products of the integrals. Which of these it may be between is told by points modulo a
prime: products that have no relation there have none.

Gradients that are independent there are independent. Those that are dependent at a random point are so
everywhere, but for a chance of some 10^-17.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations, islice
from math import prod

from flint import Ordering, arb_mat, ctx, fmpz_mpoly, fmpz_mpoly_ctx, nmod_mat, nmod_mpoly_ctx

from service.dynamics.discovery.closure import Closure, areas_polynomial, balls_of, point_modulo, states
from service.dynamics.discovery.functions import ORDER, FunctionQuestion, Functions, Quotient, gradient_balls
from service.dynamics.discovery.known import candidates
from service.dynamics.discovery.setting import STATE, IntegralJudgement
from service.dynamics.discovery.strata import (
    PRIME,
    Row,
    Stratum,
    Substitution,
    by_powers,
    evaluated,
    kernel,
    random_numbers,
    rank_modulo,
    root_modulo,
)
from service.dynamics.verdict.exact_ring.generators import NoProofError
from service.dynamics.verdict.refutations import DecimalBall, decimal_ball

PRIMES = (PRIME, 2**61 - 31, 2**61 - 45, 2**61 - 229, 2**61 - 259, 2**61 - 283, 2**61 - 339)
"""Primes modulo one of which a condition that is solved for no letter may have a root."""
ROOT_TRIALS = 8
"""Random values of the letters at which it is looked for."""


@dataclass(frozen=True, slots=True)
class ModularPoint:
    """A random point of the sphere, on the level asked about, modulo a prime, with values of the letters."""

    prime: int
    letters: list[int]
    """In the order of their ring."""
    state: list[int]
    """m1, m2, m3, g1, g2, g3."""
    omega: list[int]
    moments: list[int]
    slopes: list[int]
    """The gradient of V."""
    values: list[int]
    """The values of all generators of the field."""

    @classmethod
    def on(cls, field: Functions, stratum: Stratum, *, has_zero_areas: bool) -> "ModularPoint | None":
        """Return the point; None if the unresolved condition has no root where it was looked for."""
        for prime in PRIMES:
            numbers = random_numbers(prime)
            letters = [next(numbers) for _ in field.letters.ring.gens()]
            if stratum.unresolved is None or _solve(stratum.unresolved, letters, numbers, prime):
                break
        else:
            return None
        for each in reversed(stratum.substitutions):
            below = evaluated(each.denominator, letters, prime)
            letters[each.index] = evaluated(each.numerator, letters, prime) * pow(below, -1, prime) % prime
        u, v, *m = islice(numbers, 5)
        scale = pow(1 + u * u + v * v, -1, prime)
        gamma = [2 * u * scale % prime, 2 * v * scale % prime, (1 - u * u - v * v) * scale % prime]
        if has_zero_areas:
            m[2] = -(m[0] * gamma[0] + m[1] * gamma[1]) * pow(gamma[2], -1, prime) % prime
        blank, setting = [0] * field.first_letter + letters, field.setting
        moments = [_modular(each, blank, prime) or 0 for each in field.moments()]
        omega = [each * pow(moment, -1, prime) % prime for each, moment in zip(m, moments, strict=True)]
        values = list(blank)
        for name, value in zip(STATE, (*omega, *gamma), strict=True):
            values[field.atoms + ORDER.index(name)] = value
        potential = field.gradient(setting.tape(setting.potential))
        slopes = [_modular(each, values, prime) or 0 for each in potential[3:]]
        return cls(prime, letters, [*m, *gamma], omega, moments, slopes, values)

    def classical(self) -> list[dict[int, int]]:
        """Return the gradients of |γ|², of the areas and of the energy."""
        m, gamma = self.state[:3], self.state[3:]
        return [
            dict(enumerate([0, 0, 0, *gamma])),
            dict(enumerate([*gamma, *m])),
            dict(enumerate([*self.omega, *self.slopes])),
        ]

    def rank(self, gradients: Sequence[Mapping[int, int]]) -> int:
        """Return how many of the gradients are independent."""
        return rank_modulo(gradients, 6, self.prime)

    def gradient(self, monomials: Sequence[tuple[int, ...]], vector: Mapping[int, int]) -> dict[int, int]:
        """Return the gradient of a combination of monomials."""
        total = dict.fromkeys(range(6), 0)
        for place, value in vector.items():
            monomial = monomials[place]
            for k, exponent in enumerate(monomial):
                if exponent:
                    term = value * exponent
                    for j, (base, power) in enumerate(zip(self.state, monomial, strict=True)):
                        term = term * pow(base, power - (j == k), self.prime) % self.prime
                    total[k] += term
        return total

    def gradient_of(self, slopes: Sequence[Quotient]) -> dict[int, int] | None:
        """Return a gradient along p, q, r, g1, g2, g3 as one along the momenta; None if it has no value."""
        found: dict[int, int] = {}
        for k, each in enumerate(slopes):
            value = _modular(each, self.values, self.prime)
            if value is None:
                return None
            found[k] = value * pow(self.moments[k], -1, self.prime) if k < 3 else value
        return found


def _solve(condition: fmpz_mpoly, letters: list[int], numbers: Iterator[int], prime: int) -> bool:
    """Change the letters until the condition is 0 modulo the prime; return whether that succeeded."""
    degrees = [int(degree) for degree in condition.degrees()]
    index = min((k for k, degree in enumerate(degrees) if degree), key=lambda k: degrees[k])
    parts = by_powers(condition, index)
    for _ in range(ROOT_TRIALS):
        letters[:] = [next(numbers) for _ in letters]
        values = [evaluated(parts[k], letters, prime) if k in parts else 0 for k in range(degrees[index] + 1)]
        root = root_modulo(values, prime)
        if root is not None:
            letters[index] = root
            return True
    return False


def _modular(quotient: Quotient, values: Sequence[int], prime: int) -> int | None:
    below = evaluated(quotient.denominator, values, prime)
    return evaluated(quotient.numerator, values, prime) * pow(below, -1, prime) % prime if below else None


MINOR_BITS = 128
"""Precision at which minors are enclosed."""
MAX_PRODUCTS = 600
"""Products of integrals among which a dependence is looked for."""
POINT_TRIALS = 8
"""Points modulo a prime that are tried for each product."""
_ONE = Fraction(1)


def with_independence(
    question: FunctionQuestion, closure: Closure, judgement: IntegralJudgement
) -> IntegralJudgement:
    """Return the judgement on an integral with its independence and its name, where they are found."""
    # What is too large for either question leaves it open, and the integral one all the same.
    with suppress(NoProofError, TimeoutError):
        minor = _minor(question, closure)
        if minor is not None:
            judgement = replace(judgement, independent=True, minor=minor)
            return replace(judgement, name=_name_of(question, closure))
        products = _Products.of(question, closure)
        found = None if products is None else products.dependence()
        if found is not None:
            return replace(judgement, independent=False, dependence=found[0], name=found[1])
    return judgement


def _minor(question: FunctionQuestion, closure: Closure) -> DecimalBall | None:
    """Return an enclosed minor, without 0, of the derivatives of the relations, of H, I3 and I; or None."""
    field = question.field
    setting = field.setting
    others = [setting.energy, *(() if _has_zero_areas(field, closure) else (setting.areas,))]
    tapes = [*(setting.tape(each) for each in others), question.tape]
    count = len(closure.relations) + len(tapes)
    places = [field.atoms + ORDER.index(name) for name in STATE]
    with ctx.workprec(MINOR_BITS):
        for state in states(field, closure):
            values = balls_of(state)
            inputs = [values[name] for name in (*STATE, *setting.letters)]
            rows = [
                [field.enclosed(each.polynomial.derivative(place), values) for place in places]
                for each in closure.relations
            ]
            rows += [list(gradient_balls(tape, inputs)) for tape in tapes]
            for chosen in combinations(range(len(STATE)), count):
                determinant = arb_mat([[row[column] for column in chosen] for row in rows]).det()
                enclosed = decimal_ball(determinant) if determinant.is_finite() else None
                if enclosed is not None and enclosed.excludes_zero:
                    return enclosed
            if question.is_late():
                break
    return None


def _has_zero_areas(field: Functions, closure: Closure) -> bool:
    return not field.reduced(areas_polynomial(field), closure.relations)


Powers = tuple[int, int, int, int]
"""Exponents of I, H, I3 and of another function."""


@dataclass(frozen=True, slots=True)
class _Products:
    """Products of integrals as polynomials, reduced by the same relations with one common factor."""

    field: Functions
    closure: Closure
    is_late: Callable[[], bool]
    bases: tuple[Quotient, Quotient, Quotient | None]
    """I, H, and I3 where that is not 0."""
    degree: int
    """The degree of I in the velocities, or 1."""

    @classmethod
    def of(cls, question: FunctionQuestion, closure: Closure) -> "_Products | None":
        """Return them; None where a relation is not solved for a variable without roots."""
        field = question.field
        setting = field.setting
        if not all(each.degree == 1 or each.is_monic for each in closure.relations):
            return None
        I3 = None if _has_zero_areas(field, closure) else field.value(setting.tape(setting.areas))
        H, function = field.value(setting.tape(setting.energy)), field.value(question.tape)
        degree = max(field.omega_degree(function), 1)
        return cls(field, closure, question.is_late, (function, H, I3), degree)

    def dependence(self) -> tuple[str, str | None] | None:
        """Return a polynomial in I, H and I3 that is 0, and the name of I if it is one of them; or None."""
        letters = self.field.letters.ring
        whole = fmpz_mpoly_ctx.get([*letters.names(), "I", "H", "I3"], Ordering.lex)
        padding = (0,) * letters.nvars()
        for highest in (1, 2):
            for row in self._relations(self._powers(highest)):
                total = whole.constant(0)
                for powers, entry in row.items():
                    lifted = entry.compose(*whole.gens()[:-3], ctx=whole)
                    total += lifted * whole.term(exp_vec=(*padding, *powers[:3]))
                others = [powers[1:3] for powers in row if any(powers[1:3])]
                is_linear = highest == 1 and len(others) <= 1
                named: dict[tuple[tuple[int, ...], ...], str] = {
                    (): "geometric",
                    ((1, 0),): "energy",
                    ((0, 1),): "areas",
                }
                return str(total), named.get(tuple(others)) if is_linear else None
        return None

    def names(self, other: Quotient) -> bool:
        """Whether I is a multiple of another function plus a polynomial in H and I3."""
        pair: list[Powers] = [(1, 0, 0, 0), (0, 0, 0, 1)]
        rows = self._relations([*pair, *self._powers(0)], other)
        return any(all(powers in row for powers in pair) for row in rows)

    def _powers(self, highest: int) -> list[Powers]:
        """Return the exponents of products with I^k, k ≤ ``highest``, up to a degree in the velocities."""
        degree, _, has_areas = self.degree * max(highest, 1), *self.bases[1:]
        found = [
            (k, i, j, 0)
            for k in range(highest + 1)
            for i in range((degree - k * self.degree) // 2 + 1)
            for j in range(degree - k * self.degree - 2 * i + 1 if has_areas is not None else 1)
        ]
        if len(found) > MAX_PRODUCTS:
            raise NoProofError("more products than a dependence is looked for among")
        return found

    def _relations(
        self, products: Sequence[Powers], other: Quotient | None = None
    ) -> list[dict[Powers, fmpz_mpoly]]:
        """Return the linear relations between products, with coefficients in the letters."""
        field, bases = self.field, (*self.bases, other)
        products, values = self._tied(products, bases), list[Quotient]()
        for powers in products:
            if self.is_late():
                raise TimeoutError
            value = field.constant(_ONE)
            for power, factor in zip(powers, bases, strict=True):
                if power and factor is not None:
                    value = field.multiply(value, field.power(factor, Fraction(power)))
            values.append(value)
        common = field.ring.constant(1)
        for each in values:
            common = common * each.denominator / common.gcd(each.denominator)
        entries: Row = {
            k: each.numerator * (common / each.denominator) for k, each in enumerate(values) if each.numerator
        }
        for relation in sorted(self.closure.relations, key=lambda each: each.index):
            if relation.is_monic:
                entries = {k: entry % relation.polynomial for k, entry in entries.items()}
            else:
                x = field.ring.gens()[relation.index]
                tail = relation.initial * x - relation.polynomial
                entries = Substitution(relation.index, tail, relation.initial).apply(entries)
        letters, rows = field.letters, dict[tuple[int, ...], Row]()
        for column, entry in entries.items():
            for place, coefficient in field.split(entry).items():
                rows.setdefault(place, {})[column] = coefficient
        found = kernel(list(rows.values()), len(values), letters, self.is_late)
        return [{products[k]: entry for k, entry in row.items()} for row in found]

    def _tied(self, products: Sequence[Powers], bases: Sequence[Quotient | None]) -> Sequence[Powers]:
        """Return the products that relations may be between: others have none at points modulo a prime."""
        field = self.field
        if field.atoms:
            return products
        modular, numbers = nmod_mpoly_ctx.get(field.ring.names(), modulus=PRIME), random_numbers(PRIME)
        letters = [next(numbers) for _ in field.letters.ring.gens()]
        one = field.constant(_ONE)
        parts = [
            modular.from_dict(part.to_dict())
            for base in bases
            for part in ((base or one).numerator, (base or one).denominator)
        ]
        rows: list[list[int]] = []
        for _ in range(POINT_TRIALS * len(products)):
            if self.is_late():
                raise TimeoutError
            at = point_modulo(field, self.closure, letters, numbers)
            above_below = [] if at is None else [int(part(*at)) for part in parts]
            if at is None or not all(above_below[1::2]):
                continue
            pairs = zip(above_below[::2], above_below[1::2], strict=True)
            values = [above * pow(below, -1, PRIME) for above, below in pairs]
            rows.append(
                [
                    prod(pow(value, k, PRIME) for value, k in zip(values, powers, strict=True) if k) % PRIME
                    for powers in products
                ]
            )
            if len(rows) > len(products):
                matrix = nmod_mat(len(rows), len(products), [x for row in rows for x in row], PRIME)
                vectors, dimension = matrix.nullspace()
                return [
                    p for k, p in enumerate(products) if any(int(vectors[k, n]) for n in range(dimension))
                ]
        return products


def _name_of(question: FunctionQuestion, closure: Closure) -> str | None:
    field, products = question.field, _Products.of(question, closure)
    if products is None:
        return None
    rates = field.rates()
    for each in candidates(field):
        rate = field.along(field.quotient_gradient(each.value), rates)
        if not field.reduced(rate.numerator, closure.relations) and products.names(each.value):
            return each.name
    return None
