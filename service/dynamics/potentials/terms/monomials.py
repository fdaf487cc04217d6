"""Sums of monomials in g1, g2, g3 with exact coefficients and any integer exponents."""

from collections.abc import Mapping
from fractions import Fraction

from service.dynamics.formula.printer import exact_tree
from service.dynamics.formula.tree import VARIABLES, Binary, Negation, Number, Symbol, Tree

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
