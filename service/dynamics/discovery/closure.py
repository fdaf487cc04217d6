"""Relations between the variables of the state, with all that follow from them along motions.

A motion that keeps f = 0 keeps f' = 0, f'' = 0, ... too. The closure of relations under the equations of
motion is found as a triangular set (Ritt 1932, Wu 1978): one polynomial for each of some variables, whose
leading coefficients, the *initials*, are in lesser ones. What is reduced to 0 by it is 0 wherever the
relations hold for all times and no initial is 0.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product as pairs_of
from math import isqrt

from flint import arb, fmpz_mpoly

from service.dynamics.discovery.functions import ORDER, Functions, Quotient, SolvedRelation
from service.dynamics.discovery.setting import STATE, EmptyRelationsError
from service.dynamics.discovery.strata import by_powers, evaluated, root_modulo
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.formula.parameters import MOMENTS
from service.dynamics.verdict.exact_ring.generators import NoProofError
from service.dynamics.verdict.sphere.boxes import sphere_points

MAX_ROUNDS = 8
"""Derivatives that are taken of relations."""
MAX_RELATIONS = 40
"""Polynomials on the way to a triangular set."""

Number = Fraction | arb
State = Mapping[str, Number]
"""Numbers of p, ..., g3 and of the letters, exact or enclosed."""


@dataclass(frozen=True, slots=True)
class Closure:
    """A triangular set, and the factors of its initials that are not 0 on the motions it is about."""

    relations: tuple[SolvedRelation, ...]
    exceptions: tuple[fmpz_mpoly, ...] = ()


def on_sphere(field: Functions) -> Closure:
    """Return |γ| = 1."""
    return Closure((field.sphere,))


def on_zero_areas(field: Functions) -> Closure:
    """Return |γ| = 1 and I3 = 0, which are kept by all motions; its initial C g3 is 0 on no part of them."""
    return Closure((field.sphere, field.relation(areas_polynomial(field))))


def areas_polynomial(field: Functions) -> fmpz_mpoly:
    """Return I3, times the denominators of the moments."""
    setting = field.setting
    return field.value(setting.tape(setting.areas)).numerator


def closure_of(
    field: Functions,
    polynomials: Sequence[fmpz_mpoly],
    rates: Sequence[Quotient],
    is_late: Callable[[], bool],
) -> Closure:
    """Return the closure of relations, and of |γ| = 1, under the equations of motion.

    Raises
    ------
    EmptyRelationsError
        No motion keeps them, for almost all values of the letters, or they are not closed after a while.
    NoProofError
        They are too large.
    """
    known = [field.sphere.polynomial, *polynomials]
    for _ in range(MAX_ROUNDS):
        found = _triangular(field, known, is_late)
        added: list[fmpz_mpoly] = []
        for each in found:
            rate = field.along(field.polynomial_gradient(each.polynomial), rates)
            rest = essential(field, field.reduced(rate.numerator, found))
            if rest:
                added.append(rest)
        if not added:
            return _closed(field, found)
        known = [*(each.polynomial for each in found), *added]
    raise EmptyRelationsError(
        f"after {MAX_ROUNDS} derivatives the relations still imply further ones", pointer="/relations"
    )


def triangular_set(
    field: Functions, polynomials: Sequence[fmpz_mpoly], is_late: Callable[[], bool]
) -> Closure:
    """Return the triangular set of polynomials alone, without what they imply along motions."""
    return _closed(field, _triangular(field, polynomials, is_late))


def _closed(field: Functions, found: Sequence[SolvedRelation]) -> Closure:
    initials = [each.initial for each in found if each.polynomial != field.sphere.polynomial]
    return Closure(tuple(found), tuple(_variable_factors(field, initials)))


def _triangular(
    field: Functions, polynomials: Sequence[fmpz_mpoly], is_late: Callable[[], bool]
) -> list[SolvedRelation]:
    # p² = 0 is p = 0: with the square-free part all that is 0 on the motions is reduced to 0.
    waiting = [essential(field, each) for each in polynomials if each]
    while True:
        if is_late() or len(waiting) > MAX_RELATIONS:
            raise NoProofError("the relations imply too many others")
        relations = sorted((_relation(field, each) for each in waiting), key=_rank)
        basic: list[SolvedRelation] = []
        for each in relations:
            if all(int(each.polynomial.degrees()[low.index]) < low.degree for low in basic):
                basic.append(each)
        chosen = [each.polynomial for each in basic]
        rests = [
            essential(field, field.reduced(each.polynomial, basic)) for each in relations if each not in basic
        ]
        rests = [rest for rest in rests if rest]
        if not rests:
            return basic
        waiting = [*chosen, *rests]


def _relation(field: Functions, polynomial: fmpz_mpoly) -> SolvedRelation:
    degrees = [int(degree) for degree in polynomial.degrees()]
    if any(degrees[: field.atoms]):
        raise NoProofError("the relations imply others that are no polynomials")
    if not any(degrees[: field.first_letter]):
        text = field.text(polynomial)
        where = "" if polynomial.is_constant() else f" unless {text} = 0"
        raise EmptyRelationsError(f"no motion keeps the relations{where}", pointer="/relations")
    return field.relation(polynomial)


def _rank(relation: SolvedRelation) -> tuple[int, int, int]:
    # Lesser variables have greater indices.
    return (-relation.index, relation.degree, len(relation.polynomial))


def essential(field: Functions, polynomial: fmpz_mpoly) -> fmpz_mpoly:
    """Return the product of the different factors that have variables in them: letters are any numbers."""
    if not polynomial or polynomial.is_constant():
        return polynomial
    found = _variable_factors(field, [polynomial])
    if not found:
        return polynomial
    product = found[0]
    for factor in found[1:]:
        product *= factor
    return product


def _variable_factors(field: Functions, polynomials: Sequence[fmpz_mpoly]) -> list[fmpz_mpoly]:
    found: list[fmpz_mpoly] = []
    for polynomial in polynomials:
        for factor, _ in polynomial.factor()[1]:
            is_variable = any(int(degree) for degree in factor.degrees()[: field.first_letter])
            if is_variable and not any(factor == other for other in found):
                found.append(factor)
    return found


# --- states ---------------------------------------------------------------------------------

_LETTERS = tuple(Fraction(n) for n in ("5/4", "7/3", "6/5", "9/7", "11/8", "13/9", "3/2", "8/5", "12/7"))
_VALUES = tuple(Fraction(n) for n in ("1/2", "-2/3", "3/4", "5/3", "-1/3", "4/5", "-3/2", "1/5"))
MAX_STATES = 48


def states(field: Functions, closure: Closure) -> Iterator[State]:
    """Yield states on which the relations hold, with numbers for the letters, exact where roots are.

    None where the roots of a relation of a degree above 2 would have to be found.
    """
    by_name = {field.ring.names()[each.index]: each for each in closure.relations}
    on_sphere_only = [name for name in by_name if name in ("g1", "g2", "g3")] == ["g3"] and (
        by_name["g3"].polynomial == field.sphere.polynomial
    )
    for number, (gamma, shift) in enumerate(pairs_of(sphere_points(), range(2))):
        if number == MAX_STATES:
            return
        values: dict[str, Number] = {}
        for k, name in enumerate(field.setting.letters):
            value = _LETTERS[k % len(_LETTERS)] + k // len(_LETTERS)
            values[name] = value if name in MOMENTS or not number >> k % 4 & 1 else -value
        for place, name in enumerate(reversed(ORDER)):
            relation = by_name.get(name)
            if name.startswith("g") and (on_sphere_only or relation is None):
                values[name] = gamma[STATE.index(name) - 3]
            elif relation is None:
                values[name] = _VALUES[(number + 3 * place + shift) % len(_VALUES)]
            else:
                root = _root(field, relation, values, number % 2 == 0)
                if root is None:
                    break
                values[name] = root
        else:
            yield values


def _root(field: Functions, relation: SolvedRelation, values: State, is_first: bool) -> Number | None:
    """Return a root of a relation of degree 1 or 2 for its variable, None if there is none that is known."""
    if relation.degree > 2:
        return None
    powers = by_powers(relation.polynomial, relation.index)
    exact = [exact_value(field, powers.get(k), values) for k in range(3)]
    if None not in exact:
        c, b, a = (each or Fraction(0) for each in exact)
        if relation.degree == 1:
            return -c / b if b else None
        square = b * b - 4 * a * c
        if not a or square < 0:
            return None
        above, below = isqrt(square.numerator), isqrt(square.denominator)
        if above**2 == square.numerator and below**2 == square.denominator:
            root = Fraction(above, below)
            return (root - b if is_first else -root - b) / (2 * a)
    low, middle, high = (
        field.enclosed(powers[k], balls_of(values)) if k in powers else arb(0) for k in range(3)
    )
    if relation.degree == 1:
        return None if middle.contains(0) else -low / middle
    radicand = middle * middle - 4 * high * low
    if high.contains(0) or not radicand > 0:
        return None
    return (radicand.sqrt() - middle if is_first else -radicand.sqrt() - middle) / (2 * high)


def balls_of(values: State) -> dict[str, arb]:
    """Return the numbers as balls, at the current precision."""
    return {name: value if isinstance(value, arb) else ball(value) for name, value in values.items()}


def exact_value(field: Functions, polynomial: fmpz_mpoly | None, values: State) -> Fraction | None:
    """Return the value of a polynomial at exact numbers, None if one of them is not."""
    total = Fraction(0)
    for exponents, coefficient in () if polynomial is None else polynomial.terms():
        term = Fraction(int(coefficient))
        for name, exponent in zip(field.ring.names(), exponents, strict=True):
            if exponent:
                value = values.get(name)  # none of π
                if not isinstance(value, Fraction):
                    return None
                term *= value ** int(exponent)
        total += term
    return total


def point_modulo(
    field: Functions, closure: Closure, letters: Sequence[int], numbers: Iterator[int]
) -> list[int] | None:
    """Return values of all generators on a closure modulo a prime; None if a relation has no root there."""
    values = [*(next(numbers) for _ in range(field.first_letter)), *letters]
    # Lesser variables have greater indices.
    for each in sorted(closure.relations, key=lambda each: -each.index):
        parts = by_powers(each.polynomial, each.index)
        root = root_modulo([evaluated(parts[k], values) if k in parts else 0 for k in range(each.degree + 1)])
        if root is None:
            return None
        values[each.index] = root
    return values
