"""The kinds of values that facts have."""

from enum import StrEnum


class Kind(StrEnum):
    """The kinds of values of facts, which decide what they may be compared with."""

    NUMBER = "number"
    INSTANT = "instant"
    WORD = "word"
    """One of a closed list."""
    TEXT = "text"
    IDENTIFIER = "id"
    TRUTH = "truth"

    @property
    def has_order(self) -> bool:
        """Whether < and > mean something."""
        return self in (Kind.NUMBER, Kind.INSTANT)
