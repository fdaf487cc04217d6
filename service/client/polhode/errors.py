"""The errors that a call of the client can end with."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self


class PolhodeError(Exception):
    """Any of the errors below."""


class WrongArgumentError(PolhodeError, ValueError):
    """An argument cannot become a part of a request; the message says what would have been accepted."""


class UnreachableError(PolhodeError, ConnectionError):
    """The service did not answer for longer than the client's patience."""


class UnfinishedError(PolhodeError, TimeoutError):
    """A job or a sweep was not finished within the time that the caller wanted to wait; it goes on."""


@dataclass(frozen=True, slots=True)
class ReportedFault:
    """One fault of a request: where it is, what it is, and what would have been accepted."""

    pointer: str
    """JSON pointer into what was sent; ``?name`` for a parameter of a query."""
    code: str
    message: str


class RefusedError(PolhodeError):
    """The service refused a request.

    Parameters
    ----------
    status
        Of the HTTP answer.
    document
        The whole answer, such as the ``counterexample`` of an inadmissible potential.
    """

    def __init__(self, status: int, document: Mapping[str, object]) -> None:
        self.status, self.document = status, document
        self.code = str(document.get("type", "")).rpartition(":")[2] or f"http_{status}"
        self.detail = str(document.get("detail") or document.get("title") or f"HTTP status {status}")
        self.faults = tuple(_faults(document.get("errors")))
        # With faults the detail only repeats them.
        first = self.detail if not self.faults else str(document.get("title") or self.detail)
        lines = [
            f"{self.code}: {first}",
            *(f"  {f.pointer or '/'}: {f.message}{_hint(f)}" for f in self.faults),
        ]
        super().__init__("\n".join(lines))

    def __reduce__(self) -> tuple[type[Self], tuple[int, Mapping[str, object]]]:
        return type(self), (self.status, self.document)

    @property
    def pointer(self) -> str | None:
        """JSON pointer to the first fault; None if it is not about one part of the document."""
        return self.faults[0].pointer if self.faults else None


class MissingError(RefusedError, LookupError):
    """There is no such job, solution, sweep or path."""


class FailedError(PolhodeError):
    """A job failed or was cancelled.

    Parameters
    ----------
    job
        The job as the service shows it.
    """

    def __init__(self, job: Mapping[str, object]) -> None:
        error = job.get("error")
        document: Mapping[str, object] = error if isinstance(error, Mapping) else {}
        self.job, self.document = job, document
        self.code = str(document.get("code") or job.get("state"))
        self.detail = str(document.get("detail") or f"job {job.get('id')} is {job.get('state')}")
        pointer = document.get("pointer")
        self.pointer = None if pointer is None else str(pointer)
        super().__init__(f"{self.code}: {self.detail}" + (f" ({self.pointer})" if self.pointer else ""))

    def __reduce__(self) -> tuple[type[Self], tuple[Mapping[str, object]]]:
        return type(self), (self.job,)


class SomeFailedError(PolhodeError):
    """Some problems of a list were refused or failed.

    Parameters
    ----------
    errors
        Why, by the index in the list.
    motions
        Those of the others, by the index in the list.
    """

    def __init__(self, errors: Mapping[int, PolhodeError], motions: Mapping[int, object]) -> None:
        self.errors, self.motions = errors, motions
        first = min(errors)
        super().__init__(
            f"{len(errors)} of {len(errors) + len(motions)} problems; number {first}: {errors[first]}"
        )

    def __reduce__(self) -> tuple[type[Self], tuple[Mapping[int, PolhodeError], Mapping[int, object]]]:
        return type(self), (self.errors, self.motions)


def refused(status: int, document: object) -> RefusedError:
    """Return the error for an answer that is none of success."""
    problem = document if isinstance(document, Mapping) else {"detail": str(document)[:500]}
    return (MissingError if status == 404 else RefusedError)(status, problem)


_UNKNOWN = re.compile(r"'([A-Za-z_]\w*)' is not known here")


def _hint(fault: ReportedFault) -> str:
    """Return what a caller of the client can do about a fault, beside what the service accepts."""
    if fault.code == "formula" and (found := _UNKNOWN.search(fault.message)):
        return f"; is {found[1]} a parameter? {found[1]}=1 would be its value"
    return ""


def _faults(errors: object) -> Sequence[ReportedFault]:
    if not isinstance(errors, list):
        return ()
    named = [error for error in errors if isinstance(error, Mapping)]
    return [
        ReportedFault(*(str(error.get(name, "")) for name in ("pointer", "code", "message")))
        for error in named
    ]
