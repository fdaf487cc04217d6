"""Numbers with their errors, the conversion of every argument, and axes of sweeps."""

import math
import numbers
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import Any, Self  # Any: parts of an answer

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polhode.errors import PolhodeError, WrongArgumentError

Exact = int | float | str | Fraction | Decimal
"""A number of a problem. Text such as ``"17/10"`` is exact; a float means its shortest decimal."""


class Quantity(float):
    """A float that knows the bound of its absolute error.

    Attributes
    ----------
    error
        Bound of the absolute error of the float, in the same unit.
    digits
        All proven digits as a decimal, in the tier ``certified``; otherwise None.
    radius
        The proven radius about ``digits``, a decimal; otherwise None.
    """

    error: float
    digits: str | None
    radius: str | None

    @classmethod
    def read(cls, document: object) -> Self | None:
        """Return what a document has as ``{value, error}`` or ``{value, radius}``; None for none."""
        if not isinstance(document, Mapping):
            return None
        value, radius = document.get("value"), document.get("radius")
        number = cls(str(value))
        number.digits = number.radius = None
        if radius is None:
            number.error = float(str(document.get("error")))
            return number
        number.digits, number.radius = str(value), str(radius)
        # The float is a rounding of the digits.
        rounding = abs(Fraction(number.digits) - Fraction(float(number)))
        number.error = math.nextafter(float(Fraction(number.radius) + rounding), math.inf)
        return number

    def __repr__(self) -> str:
        return f"{float(self)!r} ± {self.error:.1e}"

    __str__ = __repr__


def items(value: object) -> list[Any]:
    """Return a list of an answer.

    Raises
    ------
    PolhodeError
        It is none: the answer is not as this version of the client knows it.
    """
    if not isinstance(value, list):
        raise PolhodeError(f"the answer of the service has {str(value)[:60]!r} in place of a list")
    return value


def fields(value: object) -> dict[str, Any]:
    """Return an object of an answer; raises as :func:`items` does."""
    if not isinstance(value, dict):
        raise PolhodeError(f"the answer of the service has {str(value)[:60]!r} in place of an object")
    return value


def written(value: object) -> object:
    """Return a value as JSON has it: exact numbers as text, arrays, series and tuples as lists.

    Raises
    ------
    WrongArgumentError
        It cannot be written into a document.
    """
    match value:
        case None | bool() | str():
            return value
        case float() | np.floating() if not np.isfinite(value):
            raise WrongArgumentError(f"{value} is not finite; a finite number is accepted")
        case float():
            return float(value)
        case np.floating() if value.dtype.itemsize > 8:
            return str(value)  # more digits than a float has
        case Decimal() if not value.is_finite():
            raise WrongArgumentError(f"{value} is not finite; a finite number is accepted")
        case Decimal():
            return str(value)
        case np.bool_() | np.floating():
            return value.item()
        case numbers.Integral():
            return int(value)
        case numbers.Rational():
            return str(Fraction(int(value.numerator), int(value.denominator)))
        case Mapping():
            return {str(name): written(each) for name, each in value.items()}
        case bytes() | bytearray() | memoryview() | np.generic():
            pass
        case Sequence() | range():
            return [written(each) for each in value]
        case _ if hasattr(value, "__array__"):
            # Arrays, series and columns of any library.
            found = np.asarray(value)
            if found.ndim:
                return [written(each) for each in found]
            return written(found[()])
    raise WrongArgumentError(
        f"{value!r} cannot be written as JSON; int, float, str, Fraction, Decimal, lists, arrays, dicts can"
    )


def whole(value: object, name: str) -> int:
    """Return a count, a seed or an index, of whatever type of integers.

    Raises
    ------
    WrongArgumentError
        It is no integer.
    """
    try:
        return operator.index(value)  # type: ignore[arg-type]  # reported below
    except TypeError:
        raise WrongArgumentError(f"{name} = {value!r}; an integer is accepted") from None


def doubles(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return finite numbers as an array of doubles, in the shape that they have.

    Raises
    ------
    WrongArgumentError
        One of them is none.
    """
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "iufO" or (given.dtype == object and None in given.ravel().tolist()):
            raise TypeError
        found: NDArray[np.float64] = given.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        raise WrongArgumentError(f"{name} = {value!r}; numbers, or an array of them, are accepted") from None
    if not np.isfinite(found).all():
        raise WrongArgumentError(
            f"{name} = {found[~np.isfinite(found)][0]} is not finite; finite ones are accepted"
        )
    return found


@dataclass(frozen=True, slots=True)
class Span:
    """Values between two ends, as a section of a sweep's document."""

    section: Mapping[str, object]


def linspace(first: Exact, last: Exact, count: int) -> Span:
    """Return ``count`` equidistant values, both ends included."""
    return _span("linspace", first, last, count)


def logspace(first: Exact, last: Exact, count: int) -> Span:
    """Return ``count`` values with equal ratios from ``first`` > 0 to ``last`` > 0, both ends included."""
    return _span("logspace", first, last, count)


def uniform(first: Exact, last: Exact, count: int, *, seed: int) -> Span:
    """Return ``count`` random values; the same seed brings the same ones."""
    return Span({**_span("uniform", first, last, count).section, "seed": whole(seed, "seed")})


def axis_section(values: object) -> Mapping[str, object]:
    """Return the section for the values of an axis: a span, or a list, range or array of numbers.

    Raises
    ------
    WrongArgumentError
        It is neither.
    """
    if isinstance(values, Span):
        return values.section
    listed = written(values)
    if not isinstance(listed, list):
        raise WrongArgumentError(
            f"{values!r} is no axis; a list, an array, or linspace(lo, hi, n) is accepted"
        )
    return {"values": listed}


def _span(kind: str, first: Exact, last: Exact, count: int) -> Span:
    return Span({kind: [written(first), written(last), whole(count, "count")]})
