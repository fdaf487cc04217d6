"""Errors of problems, formulas and classical motions that cannot be stated or solved, one class per cause.

Every error carries a stable ``code`` for programs, a sentence with the numbers
for people, and ``pointer``: the place of the fault in the problem document
(a JSON pointer below the problem, empty if it is the whole).
"""

from typing import ClassVar, Self


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


class FormulaError(DynamicsError):
    """A text that is not a formula of the grammar, or one that cannot be used here.

    ``position`` is the offset in the text (from 0) of the first character at
    fault, or None for a tree that was not read from a text; the message counts
    characters from 1.
    """

    code: ClassVar[str] = "formula"

    def __init__(self, reason: str, *, position: int | None = None, pointer: str = "") -> None:
        super().__init__(
            reason if position is None else f"character {position + 1}: {reason}", pointer=pointer
        )
        self.reason = reason
        self.position = position

    def at(self, *, position: int | None = None, pointer: str = "") -> Self:
        """Return the same error with the place added; what is known already is kept."""
        place = position if self.position is None else self.position
        return type(self)(self.reason, position=place, pointer=self.pointer or pointer)


class FormulaLimitError(FormulaError):
    """A formula larger than the limits; it is refused before the work."""


class UnknownNameError(FormulaError):
    """A name that is neither a variable, a parameter, a moment nor a function."""


class UndefinedConstantError(FormulaError):
    """A part without variables that has no value, such as 1/0."""


class CaseConditionError(DynamicsError):
    """The moments do not satisfy the condition of the case."""

    code = "case_condition"


class CaseMomentsError(DynamicsError):
    """Moments were left out that the case does not fix."""

    code = "case_moments"


class CaseCentreError(DynamicsError):
    """The centre of the potential is not where the case needs it."""

    code = "case_centre"


class CaseNotRealError(DynamicsError):
    """The case has no real motion for this body or these parameters."""

    code = "case_not_real"


class CaseParameterError(DynamicsError):
    """A parameter is missing, or is none of this case."""

    code = "case_parameter"


class NearSeparatrixError(DynamicsError):
    """The motion is too close to a separatrix for its quadrature."""

    code = "near_separatrix"
