"""Exact numbers: how they are read from text. Numbers stay exact as long as possible."""

import math
import re
from fractions import Fraction
from typing import Self

from service.dynamics.errors import InvalidNumberError

MAX_DIGITS = 400
"""Characters of a decimal's digits; more is refused before any arithmetic."""
MAX_EXPONENT = 400
"""Largest decimal exponent in absolute value: covers what a double can hold and its square root's inverse."""
MAX_INTEGER_DIGITS = MAX_DIGITS + MAX_EXPONENT + 1
"""Digits of an integer, alone or in a ratio: enough to write any accepted decimal as a ratio."""

_DECIMAL = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?\Z", re.ASCII)
_RATIONAL = re.compile(r"([+-]?\d+)(?:/(\d+))?\Z", re.ASCII)


class NumberBeyondDoubles(float):
    """A decimal whose nearest double is 0 or infinite, though the number itself is neither.

    As a float it is that double. :func:`exact_number` reads the text, so that a
    JSON number 1e-400 is treated like the string "1e-400", and never as 0.
    """

    __slots__ = ("text",)
    text: str

    def __new__(cls, text: str) -> Self:
        """Return the nearest double of the decimal ``text``, with the text."""
        number = super().__new__(cls, text)
        number.text = text
        return number


def is_zero_text(text: str) -> bool:
    """Whether a decimal is 0: no digit of it other than 0 comes before the exponent."""
    return not any(digit in "123456789" for digit in text.lower().partition("e")[0])


def exact_number(value: int | float | str | Fraction) -> Fraction:
    """Return the exact rational value of ``value``.

    A float means its shortest decimal (0.1 is 1/10); a string may hold a
    decimal (``"1e-12"``) or a ratio of integers (``"17/10"``).

    Raises
    ------
    InvalidNumberError
        Not finite, not a number, too many digits or too large an exponent.
    """
    # A text first: a check of Fraction, an abstract class's, takes a fifth of reading one.
    if not isinstance(value, str):
        if isinstance(value, Fraction):
            return value
        if isinstance(value, bool):
            raise InvalidNumberError(f'{value} is not a number; write a number or a string such as "17/10"')
        if isinstance(value, NumberBeyondDoubles):
            value = value.text
        elif isinstance(value, float):
            if not math.isfinite(value):
                raise InvalidNumberError(f"{value} is not finite; finite numbers are accepted")
            value = float.__repr__(value)  # numpy has its own repr for its doubles
    text = str(value).strip() if not isinstance(value, int) else _integer_text(value)
    if len(text) > 2 * MAX_INTEGER_DIGITS + 2:
        raise InvalidNumberError(f"a number of {len(text)} characters, more than any accepted number has")
    ratio = _RATIONAL.match(text)
    if ratio:
        return _ratio(ratio[1], ratio[2] or "1")
    if len(text) > MAX_DIGITS + 10:
        raise InvalidNumberError(
            f"a decimal of {len(text)} characters; at most {MAX_DIGITS} digits are accepted"
        )
    if not _DECIMAL.match(text):
        raise InvalidNumberError(f'{text[:40]!r} is not a number; accepted are 1.5, "1e-12" and "17/10"')
    mantissa, _, exponent = text.lower().partition("e")
    if exponent and abs(int(exponent)) > MAX_EXPONENT:
        raise InvalidNumberError(f"the exponent of {text[:40]!r} is beyond ±{MAX_EXPONENT}")
    whole, _, decimals = mantissa.partition(".")
    digits, shift = int(whole + decimals), int(exponent or 0) - len(decimals)
    return Fraction(digits * 10**shift) if shift >= 0 else Fraction(digits, 10**-shift)


def exact_text(value: Fraction) -> str:
    """Return ``value`` as text that :func:`exact_number` reads back: ``"3"`` or ``"17/10"``.

    Every number that ``exact_number`` returns is short enough to be read back.
    """
    return str(value)


def _ratio(numerator: str, denominator: str) -> Fraction:
    digits = max(len(numerator.lstrip("+-")), len(denominator))
    if digits > MAX_INTEGER_DIGITS:
        raise InvalidNumberError(f"an integer of {digits} digits; at most {MAX_INTEGER_DIGITS} are accepted")
    divisor = int(denominator)
    if divisor == 0:
        raise InvalidNumberError(f"{numerator[:40]}/{denominator[:40]} divides by zero")
    return Fraction(int(numerator), divisor)


def _integer_text(value: int) -> str:
    # Bits first: Python refuses to write integers of more than 4300 digits.
    if value.bit_length() > 4 * MAX_INTEGER_DIGITS:
        raise InvalidNumberError(
            f"an integer of {value.bit_length()} bits; at most {MAX_INTEGER_DIGITS} digits are accepted"
        )
    return str(value)
