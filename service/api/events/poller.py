"""Reads the changes in the database for all streams of this process, in one thread, as events.

Events and comments are text/event-stream (WHATWG HTML, 9.2); their ids
are positions in the order of changes.
"""

import json
import math
import struct
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from service.jobs.records import Job, SweepNotFoundError, SweepRecord
from service.storage.jobs.rows import ChangeReader, Followable, LastChange
from service.storage.sweeps.sweep_store import SweepStore

MEDIA_TYPE = "text/event-stream"
RETRY_MILLISECONDS = 2000
"""How long a client waits before it connects again."""
OPENING = f": polhode\nretry: {RETRY_MILLISECONDS}\n\n".encode("ascii")
"""Sent at once, so that a client knows that it is connected."""
HEARTBEAT = b": still here\n\n"
END = "end"
STATUS = "status"


@dataclass(frozen=True, slots=True)
class Event:
    """One event."""

    name: str
    at: float
    """Position in the order of changes, by the database's clock."""
    data: bytes
    """A JSON document in one line."""
    is_final: bool = False
    """Nothing follows about this job or sweep."""
    subject_id: str = ""
    """The job or sweep that it is about."""

    @property
    def id(self) -> str:
        """The event's id."""
        return id_of_position(self.at)

    def text(self) -> bytes:
        """Return it as it is sent."""
        head = f"event: {self.name}\nid: {self.id}\ndata: ".encode("ascii")
        return head + self.data + b"\n\n"


def end_of(reason: str, at: float) -> Event:
    """Return the last event of a stream."""
    return Event(END, at, json.dumps({"reason": reason}).encode("ascii"), is_final=True)


def id_of_position(at: float) -> str:
    """Return the id of events at an instant: good for every API process, and after a restart."""
    return struct.pack(">d", at).hex()


def position_of_id(text: str | None) -> float | None:
    """Return the instant of an id; None if it is none of ours, as of an id that was never sent."""
    try:
        (at,) = struct.unpack(">d", bytes.fromhex(text or ""))
    except (ValueError, struct.error):
        return None
    return float(at) if math.isfinite(at) and at >= 0.0 else None


Subject = tuple[Followable, str]
"""A job or a sweep by its id."""
Position = tuple[float, str | None]
"""In the order of changes: an instant, and an id among what changed at that instant."""

MOST_AT_ONCE = 500
"""Events made by one poll; beyond, streams read the changes in pages, each as fast as its client."""
STATUS_SECONDS = 1.0
"""Time between two reads of the status at least."""
STATUS_SHARE = 20.0
"""A status that took a second to read is read every so many seconds."""


@dataclass(frozen=True, slots=True)
class Documents:
    """Functions that write the answers to GET: an event has the very same bytes."""

    job: Callable[[Job], bytes]
    sweep: Callable[[SweepRecord], bytes]
    status: Callable[[], tuple[bytes, object]]
    """The document, and what must change for it to be sent again: not its instants and ages."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The changes in the installation that one poll of the database found."""

    events: tuple[Event, ...]
    is_complete: bool
    """False if there is more than was made."""
    status: Event
    """As it was read last, whether or not it is new."""


class ChangePoller:
    """Reads what has changed since the last poll.

    One thread polls; any thread may ask for pages.
    """

    def __init__(self, changes: ChangeReader, sweeps: SweepStore, documents: Documents) -> None:
        self._changes, self._sweeps, self._documents = changes, sweeps, documents
        self._position: float | None = None
        self._seen: dict[Subject, float] = {}
        """Changes of late that were reported: a later poll finds them again."""
        self._status: Event | None = None
        self._substance: object = None
        self._status_due = 0.0

    def poll_subjects(self, known: Mapping[Subject, float | None]) -> dict[Subject, Event | None]:
        """Return what has another last change than is ``known``; None for what is gone."""
        found: dict[Subject, Event | None] = {}
        for kind in Followable:
            ids = [subject[1] for subject in known if subject[0] is kind]
            if not ids:
                continue
            now = self._changes.of(kind, ids)
            found.update({(kind, each): None for each in ids if each not in now})
            changed = [LastChange(at, each, kind) for each, at in now.items() if known[kind, each] != at]
            found.update(self._events_of(changed))
        return found

    def poll(self) -> Snapshot:
        """Return what is new since the last poll; of a first poll nothing but the status."""
        is_first = self._position is None
        now, changes = self._changes.since(float("inf") if self._position is None else self._position)
        new = [] if is_first else [each for each in changes if self._seen.get(_subject(each)) != each.at]
        is_complete = len(new) <= MOST_AT_ONCE
        found = self._events_of(new) if is_complete else {}
        self._position = now
        self._seen = {_subject(each): each.at for each in changes}
        # What has changed once more since, is reported as it is now.
        self._seen |= {subject: each.at for subject, each in found.items()}
        events = sorted(found.values(), key=lambda each: each.at)
        status = self._status
        if status is None or time.monotonic() >= self._status_due:
            status, is_new = self._poll_status(now)
            events += [status] if is_new else []
        return Snapshot(tuple(events), is_complete, status)

    def forget(self) -> None:
        """Begin anew with the next poll, since nobody has been listening."""
        self._position, self._status, self._substance, self._seen = None, None, None, {}

    def page(self, after: Position, limit: int) -> tuple[list[Event], Position | None]:
        """Return the next events after an instant and an id, and where to go on; None at the end."""
        changes = self._changes.page(after, limit)
        found = self._events_of(changes)
        events = [found[_subject(each)] for each in changes if _subject(each) in found]
        return events, (changes[-1].at, changes[-1].id) if len(changes) == limit else None

    def now(self) -> float:
        """Return the time of the database's clock."""
        return self._changes.now()

    def _events_of(self, changes: Iterable[LastChange]) -> dict[Subject, Event]:
        """Return the present state of what changed, with its last change as it is read now."""
        found: dict[Subject, Event] = {}
        given = list(changes)
        jobs = [each.id for each in given if each.kind is Followable.JOB]
        for at, job in self._changes.jobs(jobs):
            data = self._documents.job(job)
            found[Followable.JOB, job.id] = Event(Followable.JOB, at, data, job.is_finished, job.id)
        for each in given:
            if each.kind is not Followable.SWEEP:
                continue
            try:
                sweep = self._sweeps.get(each.id)
            except SweepNotFoundError:  # deleted meanwhile
                continue
            is_final = sweep.finished_at is not None
            event = Event(Followable.SWEEP, each.at, self._documents.sweep(sweep), is_final, sweep.id)
            found[Followable.SWEEP, each.id] = event
        return found

    def _poll_status(self, at: float) -> tuple[Event, bool]:
        """Return the status, and whether anything in it is new."""
        began = time.monotonic()
        document, substance = self._documents.status()
        ended = time.monotonic()
        self._status_due = ended + max(STATUS_SECONDS, STATUS_SHARE * (ended - began))
        is_new = substance != self._substance
        self._status, self._substance = Event(STATUS, at, document), substance
        return self._status, is_new


def _subject(change: LastChange) -> Subject:
    return change.kind, change.id
