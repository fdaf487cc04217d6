"""The faults of a document, each with its place, code and message."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from service.dynamics.errors import DynamicsError

MAX_FAULTS = 200
"""Most faults listed: of 100 000 wrong numbers only the first are."""
_TOLD_IN_SENTENCE = 10


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault of a document."""

    pointer: str
    """JSON pointer (RFC 6901) into the document; empty for the whole."""
    code: str
    """Stable code for programs."""
    message: str
    """Sentence for people; says what would have been accepted."""
    position: int | None = None
    """For a query, the character, from 0, at which the fault was found."""


class InvalidProblemError(Exception):
    """A document that is not a valid problem; ``faults`` lists every fault."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        told = [f"{fault.pointer or '/'}: {fault.message}" for fault in faults[:_TOLD_IN_SENTENCE]]
        if len(faults) > _TOLD_IN_SENTENCE:
            told.append(f"and {len(faults) - _TOLD_IN_SENTENCE} more")
        super().__init__("; ".join(told))
        self.faults = tuple(faults)


def first_of(faults: Sequence[Fault], most: int = MAX_FAULTS) -> list[Fault]:
    """Return the first of very many faults, and a last one that tells of the others."""
    if len(faults) <= most:
        return list(faults)
    return [*faults[:most], Fault("", "more_faults", f"there are more faults; the first {most} are listed")]


def pointer_to(parts: Iterable[str | int]) -> str:
    """Return the JSON pointer of a path."""
    return "".join(f"/{str(part).replace('~', '~0').replace('/', '~1')}" for part in parts)


def fault_of(error: DynamicsError, *, pointer: str = "") -> Fault:
    """Convert a domain error to a fault; ``pointer`` is used if the error has none."""
    return Fault(error.pointer or pointer, error.code, error.message)
