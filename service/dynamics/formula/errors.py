"""Errors of formulas, each with its position in the text."""

from typing import ClassVar, Self

from service.dynamics.errors import DynamicsError


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
