"""Evaluates exact constants inside a formula, and bounds their size before computing."""

from fractions import Fraction
from math import isqrt

from service.dynamics.formula.errors import FormulaLimitError, UndefinedConstantError
from service.dynamics.formula.limits import MAX_BITS, MAX_EXPONENT
from service.dynamics.formula.tree import BinaryOperator, FunctionName


def fold_binary(
    operator: BinaryOperator, left: Fraction | None, right: Fraction | None, *, formally: bool = True
) -> Fraction | None:
    """Return the exact value of ``left operator right``, or None if it is not a rational constant.

    An operand that is not constant is None. The formal rules 0·x = 0, 0/x = 0,
    x^0 = 1 and 1^x = 1 are used: a parameter that is zero takes its term away,
    also where the rest of the term is infinite. Not so if ``formally`` is false.

    Raises
    ------
    UndefinedConstantError
        A division by zero.
    FormulaLimitError
        The value, or the exponent, is larger than the limits.
    """
    if operator == "^" and right is not None:
        require_exponent(right)
    if operator == "/" and right == 0:
        raise UndefinedConstantError("a division by zero")
    if left is None or right is None:
        return _fold_formally(operator, left, right) if formally else None
    if operator == "+":
        return _bounded(left + right)
    if operator == "-":
        return _bounded(left - right)
    if operator == "*":
        return _bounded(left * right)
    if operator == "/":
        return _bounded(left / right)
    return fold_power(left, right)


def _fold_formally(
    operator: BinaryOperator, left: Fraction | None, right: Fraction | None
) -> Fraction | None:
    is_zero = left is not None and not left
    if (operator == "*" and (is_zero or (right is not None and not right))) or (operator == "/" and is_zero):
        return Fraction(0)
    if operator == "^" and (left == 1 or right == 0):
        return Fraction(1)
    return None


def fold_power(base: Fraction, exponent: Fraction) -> Fraction | None:
    """Return ``base^exponent`` if it is rational and plainly so, else None; raises as fold_binary."""
    if base == 0 and exponent < 0:
        raise UndefinedConstantError("a division by zero: 0 to a negative power")
    if base < 0 and exponent.denominator != 1:
        raise UndefinedConstantError(f"the power {exponent} of the negative number {_short(base)}")
    if exponent.denominator == 2:
        root = _square_root(base)
        if root is None:
            return None
        base, exponent = root, exponent * 2
    if exponent.denominator != 1:
        return base if base in (0, 1) else None
    bits = max(base.numerator.bit_length(), base.denominator.bit_length())
    # |±1| has one bit and never grows, hence the subtraction.
    if (bits - 1) * abs(exponent.numerator) > MAX_BITS:
        raise FormulaLimitError(f"the power {_short(base)}^{exponent} has more than {MAX_BITS} bits")
    return _bounded(base**exponent.numerator)


def fold_call(function: FunctionName, argument: Fraction) -> Fraction | None:
    """Return the exact value of a function where it is rational and plainly so; raises as fold_binary."""
    if function == "abs":
        return abs(argument)
    if function == "sqrt":
        return fold_power(argument, Fraction(1, 2))
    if function == "log" and argument <= 0:
        raise UndefinedConstantError(f"the logarithm of {_short(argument)}")
    return None


def require_exponent(exponent: Fraction) -> None:
    """Raise FormulaLimitError if a constant exponent is too large."""
    if abs(exponent.numerator) > MAX_EXPONENT * exponent.denominator:
        raise FormulaLimitError(f"the exponent {_short(exponent)} is beyond ±{MAX_EXPONENT}")


def _square_root(value: Fraction) -> Fraction | None:
    root = Fraction(isqrt(value.numerator), isqrt(value.denominator))
    return root if root * root == value else None


def _bounded(value: Fraction) -> Fraction:
    if max(value.numerator.bit_length(), value.denominator.bit_length()) > MAX_BITS:
        raise FormulaLimitError(f"a constant of more than {MAX_BITS} bits")
    return value


def _short(value: Fraction) -> str:
    text = str(value)
    return text if len(text) <= 40 else f"{text[:40]}…"
