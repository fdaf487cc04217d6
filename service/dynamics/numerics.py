"""The version of numerics, names of what computes a motion, and errors compared with limits.

NaN compares false with everything, and the builtin ``max`` keeps or drops it by its place: written
out, ``error > limit`` lets NaN pass, and so does ``max(errors)``.
"""

from collections.abc import Iterable
from decimal import Context, Decimal
from math import inf, isfinite, isnan, nan, nextafter
from typing import Literal

NUMERICS = 13
"""Grows whenever a computed digit may change: solutions of another number are not reused."""
SolvedBy = Literal["quadrature", "integration"]
Tier = Literal["draft", "standard", "high", "certified"]
"""Grades of accuracy, see :mod:`service.dynamics.accuracy`."""
NO_CROSS_CHECK = "no_cross_check"
"""Code of the warning that the second method could not follow the motion, so that nothing was compared."""
_EXACT_CONTEXT = Context(prec=30)
"""Digits of the difference of two decimals, which is taken exactly and then rounded."""
ErrorKind = Literal["theorem", "estimate", "difference"]
"""The way in which the bound of an error is known: ``theorem``: proved, by balls that contain every value;
``estimate``: counted or modelled, rounding by rounding and term by term, but not proved; ``difference``:
independent computations were compared, and what they differ by was enlarged."""


def is_within(error: float, limit: float) -> bool:
    """Tell whether ``error`` is finite and at most ``limit``; a NaN limit allows nothing."""
    return isfinite(error) and error <= limit


def largest(errors: Iterable[float], default: float = 0.0) -> float:
    """Return the largest of ``errors``, NaN if one of them is; ``default`` if there are none."""
    found = list(errors)
    return nan if any(isnan(error) for error in found) else max(found, default=default)


def printed_error(value: float, error: float) -> float:
    """Return the bound of the error of the decimal that ``value`` is written as, ``error`` being its own.

    A double is written as the shortest decimal that reads back to it, up to half a unit of the double's last
    place away from it.
    """
    if not (isfinite(value) and isfinite(error)):
        return error
    apart = _EXACT_CONTEXT.subtract(Decimal(repr(value)), Decimal(value))
    return nextafter(error + abs(float(apart)), inf) if apart else error
