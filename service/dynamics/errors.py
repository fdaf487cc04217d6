"""Errors of a problem that cannot be stated or solved, one class per cause.

Every error carries a stable ``code`` for programs, a sentence with the numbers
for people, and ``pointer``: the place of the fault in the problem document
(a JSON pointer below the problem, empty if it is the whole).
"""

from typing import ClassVar


class DynamicsError(Exception):
    """A problem that cannot be stated or solved as requested."""

    code: ClassVar[str] = "dynamics"

    def __init__(self, message: str, *, pointer: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.pointer = pointer


class BudgetTooSmallError(DynamicsError):
    """No tier is expected to end within the budget."""

    code = "budget_too_small"


class InvalidNumberError(DynamicsError):
    """A number that is not finite, not a number, or larger than the limits."""

    code = "invalid_number"


class ImpossibleInertiaError(DynamicsError):
    """Principal moments that are not positive."""

    code = "invalid_inertia"


class UnphysicalInertiaError(DynamicsError):
    """Positive moments that break a triangle inequality: no body has them."""

    code = "unphysical_inertia"


class EqualMomentsError(DynamicsError):
    """A = C, where the compatibility equation loses its meaning."""

    code = "equal_moments"


class ExtremeMomentsError(DynamicsError):
    """A and C differ by more than planar motions are computed for."""

    code = "extreme_moments"


class MissingMomentError(DynamicsError):
    """The moment B is needed and was left out."""

    code = "missing_moment"
