"""Lists of problems, however long: cut into requests, waited for as they end, and found again."""

import hashlib
import json
import os
import time
import uuid
from collections.abc import AsyncIterator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Generic

from polhode.documents.problems import Document, Given, problem, read
from polhode.documents.quantities import fields, items
from polhode.drawing import table_html
from polhode.errors import (
    FailedError,
    MissingError,
    PolhodeError,
    RefusedError,
    SomeFailedError,
    UnfinishedError,
    WrongArgumentError,
    refused,
)
from polhode.listings import IDS, by_id
from polhode.motions import Motion
from polhode.transport.carriers import CarrierT, LoopCarrier, ThreadCarrier
from polhode.transport.exchange import FINAL, ask_json
from polhode.transport.terms import Operation, Pause, Progress, Terms, Together, operation

MOST = 1000
"""Problems in one request, as many as the service takes."""
_MOST_BYTES, _MOST_FIELDS = 900_000, 50_000
"""The service takes 1 000 000 bytes and 60 000 fields."""
_AT_ONCE = 2
"""Requests on their way."""
_DIVISIBLE = (400, 413, 422)
"""Statuses of a whole list of which a part may be accepted: one problem can make all of it unreadable."""
_BUSY = (429, 503)
_FIRST_PAUSE, _LONGEST_PAUSE = 0.05, 1.0


@dataclass(frozen=True, slots=True)
class Submitted:
    """The outcome of submitting one problem of a list.

    Parameters
    ----------
    index
        Its place in the list, from 0.
    job
        The job as the service describes it; None if the problem was refused.
    error
        Why it was refused; None if it was not.
    """

    index: int
    job: Document | None
    error: PolhodeError | None

    @property
    def id(self) -> str | None:
        """Id of the job, if there is one."""
        return None if self.job is None else str(self.job["id"])


def submitted(
    carrier: ThreadCarrier, problems: Iterable[Given | PolhodeError], *, again: bool = False
) -> Iterator[Submitted]:
    """Submit problems in requests of up to 1000, two at a time, and yield what comes of each, in their order.

    A refused problem does not stop the others. A busy service, and one whose limit of queued jobs is reached,
    is waited for. Each request has an Idempotency-Key made of its problems and of their place in the list:
    whoever submits a list again within a day gets the jobs that there are.

    Parameters
    ----------
    problems
        Documents or files, which are taken as they are needed; an error in the place of one is yielded there.
    again
        Submit all of them anew.

    Raises
    ------
    PolhodeError
        Nothing can be submitted, for example without a key. What was submitted before has been yielded.
    """
    salt = uuid.uuid4().hex if again else ""
    for pieces in _pairs(problems):
        found: dict[int, Submitted] = {}
        fault = None
        try:
            carrier.run(_sent_together(carrier.terms, pieces, salt, found))
        except PolhodeError as raised:
            fault = raised
        yield from (found[index] for index in sorted(found))
        if fault is not None:
            raise fault


def submit_list(
    carrier: CarrierT, problems: Iterable[Given | PolhodeError], *, again: bool = False
) -> "Operation[JobList[CarrierT]]":
    """Submit problems as :func:`submitted` does, and return their jobs."""
    salt = uuid.uuid4().hex if again else ""
    total = len(problems) if isinstance(problems, Sequence) else None
    found: dict[int, Submitted] = {}
    for pieces in _pairs(problems):
        yield from _sent_together(carrier.terms, pieces, salt, found)
        _report(carrier.terms, "problems submitted", len(found), total or len(found) + 1)
    if total is None:
        _report(carrier.terms, "problems submitted", len(found), len(found))
    outcomes = [found[index] for index in sorted(found)]
    errors = {each.index: each.error for each in outcomes if each.error is not None}
    return JobList(carrier, [each.id for each in outcomes], errors)


@dataclass(slots=True)
class _Piece:
    """Neighbours in a list that fit into one request."""

    problems: list[tuple[int, Document]] = field(default_factory=list)
    wrong: list[Submitted] = field(default_factory=list)
    """Results for those that cannot be sent at all."""


def _pairs(problems: Iterable[Given | PolhodeError]) -> Iterator[list[_Piece]]:
    pieces = _pieces(problems)
    while pair := list(islice(pieces, _AT_ONCE)):
        yield pair


def _pieces(problems: Iterable[Given | PolhodeError]) -> Iterator[_Piece]:
    piece, size, count = _Piece(), 0, 0
    for index, given in enumerate(problems):
        try:
            if isinstance(given, PolhodeError):
                raise given
            document = problem(given)
        except PolhodeError as fault:
            piece.wrong.append(Submitted(index, None, fault))
            continue
        own_size, own_count = len(json.dumps(document)) + 2, _fields_in(document)
        is_full = (
            len(piece.problems) >= MOST or size + own_size > _MOST_BYTES or count + own_count > _MOST_FIELDS
        )
        if piece.problems and is_full:
            yield piece
            piece, size, count = _Piece(), 0, 0
        piece.problems.append((index, document))
        size, count = size + own_size, count + own_count
    if piece.problems or piece.wrong:
        yield piece


def _fields_in(document: object) -> int:
    if isinstance(document, Mapping):
        return len(document) + sum(map(_fields_in, document.values()))
    return sum(map(_fields_in, document)) if isinstance(document, list) else 0


def _sent_together(
    terms: Terms, pieces: Sequence[_Piece], salt: str, found: dict[int, Submitted]
) -> Operation[None]:
    found |= {each.index: each for piece in pieces for each in piece.wrong}
    yield Together([_sent(terms, piece.problems, salt, found) for piece in pieces if piece.problems])


def _sent(
    terms: Terms, problems: Sequence[tuple[int, Document]], salt: str, found: dict[int, Submitted]
) -> Operation[None]:
    """Submit a piece, and put what comes of each problem into ``found``."""
    began, tries = time.monotonic(), 0
    while problems:
        documents = [document for _, document in problems]
        place = json.dumps([problems[0][0], tries, salt, documents])
        headers = {"Idempotency-Key": hashlib.sha256(place.encode()).hexdigest()}
        try:
            answer = yield from ask_json(terms, "POST", "/v1/jobs", documents, headers=headers, waits=True)
        except RefusedError as fault:
            # A list of which nothing was accepted is refused as a whole, with the same items.
            answer = dict(fault.document)
            if "items" not in answer:
                yield from _divided(terms, problems, salt, found, fault)
                return
        busy = []
        is_late = time.monotonic() - began > terms.patience
        for (index, document), item in zip(problems, items(answer["items"]), strict=True):
            if item["status"] in _BUSY and not is_late:
                busy.append((index, document))
            elif item["job"] is not None:
                found[index] = Submitted(index, fields(item["job"]), None)
            else:
                found[index] = Submitted(index, None, refused(item["status"], item["problem"]))
        if len(busy) < len(problems):
            began = time.monotonic()  # a list that gets on is waited for, however long it takes
        problems, tries = busy, tries + 1
        if busy:
            yield Pause(_LONGEST_PAUSE)


def _divided(
    terms: Terms,
    problems: Sequence[tuple[int, Document]],
    salt: str,
    found: dict[int, Submitted],
    fault: RefusedError,
) -> Operation[None]:
    """Submit the halves of a piece that was refused as a whole: the other half may be accepted."""
    # Else so many jobs are refused for now: even an empty queue would not take those that exceed the limit.
    is_too_long = fault.status in _DIVISIBLE or fault.document.get("exceeds_limit") is True
    if len(problems) > 1 and is_too_long:
        middle = len(problems) // 2
        for half in (problems[:middle], problems[middle:]):
            yield from _sent(terms, half, salt, found)
    elif fault.status in _DIVISIBLE:
        ((index, _),) = problems
        found[index] = Submitted(index, None, fault)
    else:
        raise fault


class JobList(Generic[CarrierT]):
    """The jobs of a list of problems, each known by its place in the list.

    Attributes
    ----------
    ids
        Ids of the jobs; None where the problem was refused.
    errors
        Why problems were refused, by their place.
    """

    def __init__(
        self, carrier: CarrierT, ids: Sequence[str | None], errors: Mapping[int, PolhodeError]
    ) -> None:
        self.carrier, self.ids, self.errors = carrier, list(ids), dict(errors)

    @operation
    def wait(self, *, seconds: float | None = None) -> Operation[list[Motion[CarrierT]]]:
        """Return the motions, in the order of the list, once all jobs have ended.

        Raises
        ------
        SomeFailedError
            Not all have a motion; it has those that there are, and the errors of the others.
        UnfinishedError
            It took longer than ``seconds``; the jobs go on.
        """
        return (yield from motions_of(self, seconds))

    def as_completed(self) -> "Endings[CarrierT]":
        """Return an iterator over pairs of a place and its motion, or its error, as the jobs end."""
        return Endings(self)

    @operation
    def states(self) -> Operation[dict[str, int]]:
        """Return how many jobs are in each state now."""
        counts: dict[str, int] = {}
        jobs = yield from by_id(self.carrier.terms, "/v1/jobs", list(_places(self)))
        for job_id, places in _places(self).items():
            state = str(jobs[job_id]["state"]) if job_id in jobs else "missing"
            counts[state] = counts.get(state, 0) + len(places)
        return counts | ({"refused": len(self.errors)} if self.errors else {})

    def save(self, file: str | os.PathLike[str]) -> Path:
        """Write the list to a file of JSON, with which ``client.stored_list`` finds it again."""
        errors = {
            str(index): {"status": each.status, "document": dict(each.document)}
            if isinstance(each, RefusedError)
            else {"message": str(each)}
            for index, each in self.errors.items()
        }
        path = Path(file)
        path.write_text(json.dumps({"url": self.carrier.terms.url, "ids": self.ids, "errors": errors}))
        return path

    def __len__(self) -> int:
        return len(self.ids)

    def __repr__(self) -> str:
        return f"<list of {len(self)} problems, {len(self.errors)} refused>"

    def _repr_html_(self) -> str:
        facts = {f"number {index}": error for index, error in islice(self.errors.items(), 20)}
        return table_html(repr(self).strip("<>"), facts)


def stored_list(carrier: CarrierT, given: Sequence[str | None] | str | os.PathLike[str]) -> JobList[CarrierT]:
    """Return a list that was submitted before, by its file or by the ids of its jobs."""
    if not isinstance(given, str | os.PathLike):
        return JobList(carrier, given, {})
    document = read(given)
    if "ids" not in document:
        raise WrongArgumentError(
            f"{os.fspath(given)} has no list; a file that save() has written is accepted"
        )
    errors: dict[int, PolhodeError] = {}
    for index, each in fields(document["errors"]).items():
        known = fields(each)
        errors[int(index)] = (
            refused(known["status"], known["document"])
            if "status" in known
            else PolhodeError(known["message"])
        )
    return JobList(carrier, items(document["ids"]), errors)


def motions_of(listed: JobList[CarrierT], seconds: float | None = None) -> Operation[list[Motion[CarrierT]]]:
    """Return the motions of a list once all its jobs have ended; raises as :meth:`JobList.wait` does."""
    deadline = None if seconds is None else time.monotonic() + seconds
    waiting, errors = _Waiting(listed), dict(listed.errors)
    motions: dict[int, Motion[CarrierT]] = {}
    while waiting.places:
        for index, outcome in (yield from waiting.some_ended(deadline)):
            if isinstance(outcome, PolhodeError):
                errors[index] = outcome
            else:
                motions[index] = outcome
    if errors:
        raise SomeFailedError(errors, motions)
    return [motions[index] for index in sorted(motions)]


class Endings(Generic[CarrierT]):
    """The places of a list with their motions or errors, in the order in which the jobs end."""

    def __init__(self, listed: JobList[CarrierT]) -> None:
        self.listed = listed

    def __iter__(
        self: "Endings[ThreadCarrier]",
    ) -> "Iterator[tuple[int, Motion[ThreadCarrier] | PolhodeError]]":
        yield from self.listed.errors.items()
        waiting = _Waiting(self.listed)
        while waiting.places:
            yield from self.listed.carrier.run(waiting.some_ended(None))

    async def __aiter__(
        self: "Endings[LoopCarrier]",
    ) -> "AsyncIterator[tuple[int, Motion[LoopCarrier] | PolhodeError]]":
        for refusal in self.listed.errors.items():
            yield refusal
        waiting = _Waiting(self.listed)
        while waiting.places:
            for each in await self.listed.carrier.run_soon(waiting.some_ended(None)):
                yield each


def _places(listed: JobList[CarrierT]) -> dict[str, list[int]]:
    """Return the places of each job: equal problems may have one."""
    found: dict[str, list[int]] = {}
    for index, job_id in enumerate(listed.ids):
        if job_id is not None:
            found.setdefault(job_id, []).append(index)
    return found


class _Waiting(Generic[CarrierT]):
    """The jobs of a list that have not ended, when last asked."""

    def __init__(self, listed: JobList[CarrierT]) -> None:
        self._carrier = listed.carrier
        self.places = _places(listed)
        self._total, self._next = len(self.places), 0

    def some_ended(
        self, deadline: float | None
    ) -> Operation[list[tuple[int, Motion[CarrierT] | PolhodeError]]]:
        """Return those that have ended since, at least one of them."""
        pause, terms = _FIRST_PAUSE, self._carrier.terms
        while True:
            asked = self._window()
            jobs = yield from by_id(terms, "/v1/jobs", asked)
            ended = [each for each in asked if each not in jobs or jobs[each].get("state") in FINAL]
            if ended:
                break
            if deadline is not None and time.monotonic() >= deadline:
                raise UnfinishedError(f"{len(self.places)} of {self._total} jobs have not ended; they go on")
            yield Pause(pause)
            pause = min(1.3 * pause, _LONGEST_PAUSE)
        succeeded = {
            each: str(jobs[each]["solution"])
            for each in ended
            if each in jobs and jobs[each].get("state") == "succeeded"
        }
        found = yield from by_id(terms, "/v1/solutions", list(dict.fromkeys(succeeded.values())))
        outcomes: list[tuple[int, Motion[CarrierT] | PolhodeError]] = []
        for job_id in ended:
            outcome: Motion[CarrierT] | PolhodeError
            if succeeded.get(job_id) in found:
                outcome = Motion(self._carrier, found[succeeded[job_id]])
            elif job_id in jobs and job_id not in succeeded:
                outcome = FailedError(jobs[job_id])
            else:
                outcome = MissingError(404, {"detail": f"job {job_id}, or its solution, was deleted"})
            outcomes += [(index, outcome) for index in self.places.pop(job_id)]
        _report(terms, "jobs", self._total - len(self.places), self._total)
        return outcomes

    def _window(self) -> list[str]:
        """Return the jobs to ask for: the first ones, which end first, and some of the others in turn."""
        open_ids = list(self.places)
        half = IDS // 2
        if len(open_ids) <= IDS:
            return open_ids
        self._next = half if not half <= self._next < len(open_ids) else self._next
        asked = open_ids[:half] + open_ids[self._next : self._next + half]
        self._next += half
        return asked


def _report(terms: Terms, what: str, done: int, total: int) -> None:
    if terms.progress is not None and total:
        terms.progress(Progress(what, done, total, None, done >= total))
