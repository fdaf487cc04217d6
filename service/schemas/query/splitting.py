"""Splits a text at its commas outside quotation marks and parentheses, and keeps the places of its parts."""

from collections.abc import Iterator
from dataclasses import dataclass

from service.schemas.reading.faults import Fault

QUOTE = '"'


@dataclass(frozen=True, slots=True)
class Excerpt:
    """Some of the text of a parameter."""

    text: str
    start: int
    """Where it begins in the parameter, from 0."""

    def stripped(self) -> "Excerpt":
        """Return the part without spaces around it."""
        left = self.text.lstrip()
        return Excerpt(left.rstrip(), self.start + len(self.text) - len(left))

    def after(self, count: int) -> "Excerpt":
        """Return what follows the first ``count`` characters, without spaces around it."""
        return Excerpt(self.text[count:], self.start + count).stripped()


class QueryError(Exception):
    """A fault of a query."""

    def __init__(self, parameter: str, code: str, message: str, position: int) -> None:
        super().__init__(message)
        self.fault = Fault(f"?{parameter}", code, f"at character {position + 1}: {message}", position)


def split(part: Excerpt) -> Iterator[Excerpt]:
    """Yield the parts between commas that are in no quotation and no parenthesis."""
    depth, is_quoted, begin = 0, False, 0
    for place, character in enumerate(part.text):
        if character == QUOTE:
            is_quoted = not is_quoted
        elif is_quoted:
            continue
        elif character == "(":
            depth += 1
        elif character == ")":
            depth = max(0, depth - 1)
        elif character == "," and not depth:
            yield Excerpt(part.text[begin:place], part.start + begin).stripped()
            begin = place + 1
    yield Excerpt(part.text[begin:], part.start + begin).stripped()


def unquoted(part: Excerpt) -> tuple[str, bool]:
    """Return a text without the quotation marks around it, and whether there were any; raises ValueError.

    Inside them a doubled mark stands for one, as in CSV.
    """
    if not part.text.startswith(QUOTE):
        if QUOTE in part.text:
            raise ValueError
        return part.text, False
    inside = part.text[1:-1]
    if len(part.text) < 2 or not part.text.endswith(QUOTE) or QUOTE in inside.replace(2 * QUOTE, ""):
        raise ValueError
    return inside.replace(2 * QUOTE, QUOTE), True
