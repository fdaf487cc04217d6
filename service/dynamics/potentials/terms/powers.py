"""Sums with exact coefficients: of monomials, and of powers of |g1| and |g3| with rational exponents.

The families' lists of coefficients are checked here too.
"""

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from math import comb
from typing import TypeVar

from flint import fmpq

from service.dynamics.errors import DynamicsError
from service.dynamics.formula.printer import exact_tree
from service.dynamics.formula.tree import VARIABLES, Binary, Call, Negation, Number, Symbol, Tree

MAX_TERMS = 20
"""Length of each list. The degree grows with the index, and with it the cancellation near the poles."""

Coefficients = Sequence[Fraction]
Ratio = TypeVar("Ratio", Fraction, fmpq)
"""Exact numbers of either library."""


class SeriesTooLongError(DynamicsError):
    """A list of coefficients longer than MAX_TERMS."""

    code = "too_many_terms"

    def __init__(self, name: str, count: int) -> None:
        super().__init__(
            f"{count} coefficients; at most {MAX_TERMS} are accepted", pointer=f"/potential/{name}"
        )


Exponents = tuple[int, int, int]
"""Exponents of g1, g2, g3."""


def monomial_sum(coefficients: Mapping[Exponents, Fraction]) -> Tree:
    """Return the tree of the sum, without zero terms; the Number 0 if nothing is left."""
    total: Tree | None = None
    for exponents, coefficient in coefficients.items():
        if coefficient == 0:
            continue
        term = _monomial(abs(coefficient), exponents)
        if total is None:
            total = term if coefficient > 0 else _negated(term)
        else:
            total = Binary("+" if coefficient > 0 else "-", total, term)
    return Number(Fraction(0)) if total is None else total


def _negated(term: Tree) -> Tree:
    # -x*y reads as (-x)*y: the sign goes to the leftmost factor, so that no parentheses are printed.
    if isinstance(term, Binary) and term.operator in "*/":
        return Binary(term.operator, _negated(term.left), term.right)
    return Negation(term)


def _monomial(coefficient: Fraction, exponents: Exponents) -> Tree:
    """Return coefficient · powers / powers, for a positive coefficient."""
    numerator: Tree | None = None if coefficient == 1 else exact_tree(coefficient)
    denominator: Tree | None = None
    for name, exponent in zip(VARIABLES, exponents, strict=True):
        if exponent:
            factor: Tree = Symbol(name)
            if abs(exponent) > 1:
                factor = Binary("^", factor, Number(Fraction(abs(exponent))))
            if exponent > 0:
                numerator = factor if numerator is None else Binary("*", numerator, factor)
            else:
                denominator = factor if denominator is None else Binary("*", denominator, factor)
    if numerator is None:
        numerator = Number(Fraction(1))
    return numerator if denominator is None else Binary("/", numerator, denominator)


PowerSum = Mapping[tuple[Fraction, Fraction], Fraction]
"""Coefficients by the exponents of |g1| and |g3|."""


def about_one(a: Ratio | int, b: Ratio | int, c: Ratio | int, count: int, one: Ratio) -> list[Ratio]:
    """Return the ``count`` coefficients of 2F1(a, b; c; 1 + z), which ends, in powers of z; ``one`` is 1."""
    series = [one]
    for j in range(count - 1):
        series.append(series[-1] * (a + j) * (b + j) / ((c + j) * (j + 1)))
    return [sum((comb(j, k) * series[j] for j in range(k + 1, count)), start=series[k]) for k in range(count)]


def exchanged(terms: PowerSum) -> dict[tuple[Fraction, Fraction], Fraction]:
    """Return the sum with |g1| and |g3| exchanged."""
    return {(third, first): factor for (first, third), factor in terms.items()}


def power_terms(terms: PowerSum) -> list[Tree]:
    """Return the terms that are not zero as trees."""
    return [_term(factor, exponents) for exponents, factor in terms.items() if factor]


def scaled(coefficient: Fraction, factors: Sequence[Tree], divisors: Sequence[Tree] = ()) -> Tree:
    """Return coefficient · factors / divisors; a coefficient 1 is not written."""
    if abs(coefficient) != 1 or not factors:
        first, rest = exact_tree(coefficient), factors
    else:
        first, rest = factors[0] if coefficient > 0 else Negation(factors[0]), factors[1:]
    for factor in rest:
        first = Binary("*", first, factor)
    for divisor in divisors:
        first = Binary("/", first, divisor)
    return first


def total(terms: Iterable[Tree]) -> Tree:
    """Return the sum of the terms, the Number 0 if there are none."""
    result: Tree | None = None
    for term in terms:
        if result is None:
            result = term
        elif (positive := _opposite(term)) is not None:
            result = Binary("-", result, positive)
        else:
            result = Binary("+", result, term)
    return Number(Fraction(0)) if result is None else result


def _opposite(term: Tree) -> Tree | None:
    """Return the term without the minus sign it begins with, None if it begins with none."""
    if isinstance(term, Negation):
        return term.operand
    if isinstance(term, Binary) and term.operator in "*/":
        left = _opposite(term.left)
        return None if left is None else Binary(term.operator, left, term.right)
    return None


def _term(coefficient: Fraction, exponents: tuple[Fraction, Fraction]) -> Tree:
    powers = {name: exponent for name, exponent in zip(("g1", "g3"), exponents, strict=True) if exponent}
    factors = [_power(name, exponent) for name, exponent in powers.items() if exponent > 0]
    divisors = [_power(name, -exponent) for name, exponent in powers.items() if exponent < 0]
    return scaled(coefficient, factors, divisors)


def _power(name: str, exponent: Fraction) -> Tree:
    # An even power is the same on the axis and on its absolute value.
    base: Tree = Symbol(name) if exponent % 2 == 0 else Call("abs", Symbol(name))
    return base if exponent == 1 else Binary("^", base, exact_tree(exponent))
