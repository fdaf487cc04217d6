"""Exact sums of terms: a coefficient for each key, such as the exponents of a monomial.

What the keys mean, what their products are and how large a sum may grow is known to those who use it.
"""

from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import TypeVar

Key = TypeVar("Key")

_ZERO = Fraction(0)


def added_up(terms: Iterable[tuple[Key, Fraction]]) -> dict[Key, Fraction]:
    """Return the sum of the terms in the order in which their keys first come; it may have zeros."""
    total: dict[Key, Fraction] = {}
    for key, coefficient in terms:
        total[key] = total.get(key, _ZERO) + coefficient
    return total


def without_zeros(total: Mapping[Key, Fraction]) -> dict[Key, Fraction]:
    """Return the terms that are not zero."""
    return {key: coefficient for key, coefficient in total.items() if coefficient}


def scaled_terms(total: Mapping[Key, Fraction], factor: Fraction) -> Iterable[tuple[Key, Fraction]]:
    """Return the terms of factor · total."""
    return ((key, factor * coefficient) for key, coefficient in total.items())
