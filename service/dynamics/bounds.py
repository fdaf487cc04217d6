"""Compares errors with limits so that NaN and infinity never pass.

NaN compares false with everything, and the builtin ``max`` keeps or drops it by its place: written
out, ``error > limit`` lets NaN pass, and so does ``max(errors)``.
"""

from collections.abc import Iterable
from math import isfinite, isnan, nan


def is_within(error: float, limit: float) -> bool:
    """Tell whether ``error`` is finite and at most ``limit``; a NaN limit allows nothing."""
    return isfinite(error) and error <= limit


def largest(errors: Iterable[float], default: float = 0.0) -> float:
    """Return the largest of ``errors``, NaN if one of them is; ``default`` if there are none."""
    found = list(errors)
    return nan if any(isnan(error) for error in found) else max(found, default=default)
