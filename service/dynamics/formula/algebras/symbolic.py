"""Converts formulas to SymPy expressions from numbers, symbols and operators; parses no text."""

from collections.abc import Callable, Sequence
from fractions import Fraction

import sympy

from service.dynamics.formula.algebra import OperatorAlgebra
from service.dynamics.formula.tape import Tape

_FUNCTIONS: dict[str, Callable[[sympy.Expr], sympy.Expr]] = {
    "exp": sympy.exp,
    "log": sympy.log,
    "sin": sympy.sin,
    "cos": sympy.cos,
    "tan": sympy.tan,
    "abs": sympy.Abs,
    "sign": sympy.sign,
}


class SymbolicAlgebra(OperatorAlgebra[sympy.Expr]):
    """SymPy expressions with exact rational constants."""

    def constant(self, value: Fraction) -> sympy.Expr:
        """Return the rational number."""
        return sympy.Rational(value.numerator, value.denominator)

    def pi(self) -> sympy.Expr:
        """Return π."""
        return sympy.pi

    def divide(self, left: sympy.Expr, right: sympy.Expr) -> sympy.Expr:
        """Return left / right."""
        return left / right

    def power(self, base: sympy.Expr, exponent: Fraction) -> sympy.Expr:
        """Return base^exponent, SymPy's principal branch."""
        return base ** self.constant(exponent)

    def general_power(self, base: sympy.Expr, exponent: sympy.Expr) -> sympy.Expr:
        """Return base^exponent, SymPy's principal branch."""
        return base**exponent

    def call(self, name: str, argument: sympy.Expr) -> sympy.Expr:
        """Return the function of the expression."""
        return _FUNCTIONS[name](argument)


def real_symbols(names: Sequence[str]) -> tuple[sympy.Symbol, ...]:
    """Return one real symbol per name."""
    return tuple(sympy.Symbol(name, real=True) for name in names)


def sympy_expression(tape: Tape, symbols: Sequence[sympy.Symbol] | None = None) -> sympy.Expr:
    """Return the formula as a SymPy expression in ``symbols`` (default: real, named as the variables)."""
    return tape.evaluate(SymbolicAlgebra(), real_symbols(tape.variables) if symbols is None else symbols)
