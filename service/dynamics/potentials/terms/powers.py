"""Sums of powers of |g1| and |g3| with exact coefficients and any rational exponents."""

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction

from service.dynamics.formula.printer import exact_tree
from service.dynamics.formula.tree import Binary, Call, Negation, Number, Symbol, Tree
from service.dynamics.term_sums import added_up, scaled_terms

PowerSum = Mapping[tuple[Fraction, Fraction], Fraction]
"""Coefficients by the exponents of |g1| and |g3|."""


def exchanged(terms: PowerSum) -> dict[tuple[Fraction, Fraction], Fraction]:
    """Return the sum with |g1| and |g3| exchanged."""
    return {(third, first): factor for (first, third), factor in terms.items()}


def weighted_sum(parts: Iterable[tuple[Fraction, PowerSum]]) -> dict[tuple[Fraction, Fraction], Fraction]:
    """Return Σ weight · sum, with equal powers added."""
    return added_up(term for weight, terms in parts for term in scaled_terms(terms, weight))


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
