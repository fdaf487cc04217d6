"""Batches as bytes, for children elsewhere: a JSON document, and the bytes that it refers to by position.

Nothing here is pickled. What comes back is parsed: a peer can send wrong numbers, but no code.
"""

import json
import struct
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import CancelledError
from dataclasses import fields
from types import UnionType
from typing import BinaryIO, get_args

from service.jobs.kernels import NeedsKernelsError, Way
from service.jobs.records import ChunkOutcome, JobKind, JobResult, Outcome, Refused, Solved, StoredSolution
from service.sandbox import SandboxBrokenError, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.reading.documents import Part
from workers.process.pool import Call, ReturnedError

Message = tuple[Part, list[bytes]]
"""A document, and the bytes that belong to it."""

_HARMLESS = {("builtins", "bytes")}
"""The only class that may be named by what comes from the cluster: that of a result."""
UNTAKEN_SECONDS = 5.0
"""A batch that no child has begun by then is given back: something long is before it."""
_LENGTH = struct.Struct(">Q")
_RECORDS = {record.__name__: record for record in (JobResult, ChunkOutcome, Refused, Solved, StoredSolution)}
_OUTCOMES: Mapping[JobKind, tuple[type, ...]] = {
    JobKind.SOLVE: (Solved, Refused),
    JobKind.CHUNK: (ChunkOutcome,),
    JobKind.ATLAS: (JobResult, Refused),
    JobKind.STUDY: (JobResult, Refused),
}
_SOURCE: Mapping[str, type | UnionType] = {
    **dict.fromkeys(("host", "version", "processor", "libraries", "way"), str),
    **{"numerics": int, "threads": int | None},
}
_FAULTS = {
    fault.__name__: fault
    for fault in (
        ReturnedError, SandboxBrokenError, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
    )
}  # fmt: skip


class MessageError(ValueError):
    """A message came that this version does not send."""


class RemoteFaultError(Exception):
    """A computation raised elsewhere; the message has the class and the text of the fault."""


def refuse_pickles() -> None:
    """Have this process unpickle nothing but bytes, whichever way they come; this lasts until it ends."""

    def look(event: str, arguments: tuple[object, ...]) -> None:
        if event == "pickle.find_class" and arguments not in _HARMLESS:
            raise MessageError(f"a bridge unpickles nothing, and this names {arguments[0]}.{arguments[1]}")

    sys.addaudithook(look)


def faults_text(fault: BaseException) -> str:
    """Return the class and the text of a fault, wherever it was raised."""
    return str(fault) if isinstance(fault, RemoteFaultError) else f"{type(fault).__name__}: {fault}"


def pack(document: Mapping[str, object], blobs: Sequence[bytes] = ()) -> bytes:
    """Return a message as bytes."""
    head = json.dumps([document, [len(blob) for blob in blobs]]).encode()
    return b"".join([_LENGTH.pack(len(head)), head, *blobs])


def unpack(data: bytes) -> Message:
    """Read what :func:`pack` has made.

    Raises
    ------
    MessageError
        It is something else.
    """
    try:
        (length,) = _LENGTH.unpack_from(data)
        start = _LENGTH.size + length
        document, sizes = json.loads(data[_LENGTH.size : start])
        blobs = []
        for size in sizes:
            blobs.append(data[start : start + size])
            start += size
        if start != len(data) or not isinstance(document, dict):
            raise MessageError("a message has another length than it says, or is no object")
    except (struct.error, ValueError, TypeError) as fault:
        raise MessageError(f"not a message: {fault}") from fault
    return document, blobs


def write(stream: BinaryIO, data: bytes) -> None:
    """Write a message into a pipe."""
    stream.write(_LENGTH.pack(len(data)) + data)
    stream.flush()


def read(stream: BinaryIO) -> bytes | None:
    """Read a message from a pipe; None if the other end is closed."""
    head = stream.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        return None
    data = stream.read(_LENGTH.unpack(head)[0])
    return data if len(data) == _LENGTH.unpack(head)[0] else None


def pack_calls(document: Mapping[str, object], kind: JobKind, calls: Sequence[Call]) -> bytes:
    """Return the calls of a batch; ``document`` says more of it."""
    blobs: list[bytes] = []
    written = [[told, [_written(each, blobs) for each in arguments]] for told, arguments in calls]
    return pack({**document, "kind": kind.value, "calls": written}, blobs)


def calls_in(message: Message) -> tuple[JobKind, list[Call]]:
    """Return the kind and the calls of a batch."""
    document, blobs = message
    found: list[Call] = [
        (told, [_read(each, blobs) for each in arguments]) for told, arguments in document["calls"]
    ]
    return JobKind(str(document["kind"])), found


def pack_outcomes(document: Mapping[str, object], outcomes: Sequence[Outcome | None]) -> bytes:
    """Return the outcomes of a batch."""
    blobs: list[bytes] = []
    return pack({**document, "outcomes": [_written(each, blobs) for each in outcomes]}, blobs)


def pack_fault(document: Mapping[str, object], fault: BaseException) -> bytes:
    """Return why a batch has no outcomes."""
    is_known = isinstance(fault, tuple(_FAULTS.values()))
    text = str(fault) if is_known else faults_text(fault)
    told: dict[str, object] = {"class": type(fault).__name__, "text": text}
    if isinstance(fault, NeedsKernelsError):
        told["refusal"] = fault.refusal
    if isinstance(fault, CancelledError):
        told = {"class": ReturnedError.__name__, "text": "the batch was stopped"}
    return pack({**document, "fault": told})


def outcomes_in(message: Message, kind: JobKind, number: int) -> list[Outcome | None]:
    """Return the outcomes of a batch of so many calls of a kind.

    Raises
    ------
    MessageError
        It has none of that kind, or too many.
    Exception
        The fault that it tells.
    """
    document, blobs = message
    if isinstance(fault := document.get("fault"), dict):
        raise _fault(fault)
    found = document.get("outcomes")
    if not isinstance(found, list) or not 0 < len(found) <= number:
        raise MessageError("the outcomes of a batch are not as many as its calls, or fewer")
    try:
        outcomes = [_read(each, blobs) for each in found]
    except (KeyError, IndexError, TypeError, ValueError) as wrong:
        raise MessageError(f"not an outcome: {wrong!r}") from wrong
    if not all(isinstance(each, _OUTCOMES[kind]) for each in outcomes if each is not None):
        raise MessageError(f"an outcome is not that of a {kind.value}")
    if number == 1 and outcomes == [None]:
        raise MessageError("a single call has neither an outcome nor a fault")
    return outcomes  # type: ignore[return-value]  # by the classes


def _fault(told: Mapping[str, object]) -> Exception:
    name, text = str(told.get("class")), str(told.get("text"))
    if name == NeedsKernelsError.__name__:
        refusal = told.get("refusal")
        return NeedsKernelsError(refusal if isinstance(refusal, dict) else None)
    return _FAULTS[name](text) if name in _FAULTS else RemoteFaultError(text)


def _written(value: object, blobs: list[bytes]) -> object:
    """Return text, None or a record as JSON; bytes of a record go to the blobs."""
    if type(value).__name__ not in _RECORDS:
        return value
    bare: dict[str, object] = {}
    places: dict[str, int] = {}
    for each in fields(_RECORDS[type(value).__name__]):
        part = getattr(value, each.name)
        if isinstance(part, bytes):
            places[each.name] = len(blobs)
            blobs.append(part)
        else:
            bare[each.name] = part
    return {"record": type(value).__name__, "fields": bare, "bytes": places}


def _read(written: object, blobs: Sequence[bytes]) -> object:
    if not isinstance(written, dict):
        return written
    parts = {**written["fields"], **{name: blobs[place] for name, place in written["bytes"].items()}}
    if written["record"] == ChunkOutcome.__name__:
        parts["bounds"] = {name: (low, high) for name, (low, high) in parts["bounds"].items()}
        _check_source(parts["source"])
    return _RECORDS[written["record"]](**parts)


def _check_source(source: object) -> None:
    """Raise unless it is what a worker of this version says of itself: it is stored, and shown."""
    if source is None:
        return
    if not isinstance(source, dict) or source.keys() != _SOURCE.keys() or len(str(source["host"])) > 255:
        raise ValueError("not the source of a chunk")
    if not all(isinstance(source[name], kind) for name, kind in _SOURCE.items()) or len(str(source)) > 4000:
        raise ValueError("the source of a chunk has other or longer values")
    if source["way"] not in get_args(Way):
        raise ValueError("the source of a chunk has no way")


class RemoteBatch:
    """Calls that were sent to a worker of the cluster."""

    def __init__(
        self, key: str, kind: JobKind, number: int, stop: Callable[["RemoteBatch"], None],
        release: Callable[["RemoteBatch"], None],
    ) -> None:  # fmt: skip
        self.key = key
        self._kind, self._number = kind, number
        self._ask_to_stop, self._release = stop, release
        self._sent_at = time.monotonic()
        self._began_at = self._ended_at = 0.0
        self._begun, self._at_most, self._share = 0, number, 0.0
        self._is_asked = False
        self._outcomes: list[Outcome | None] = []
        self.fault: BaseException | None = None
        """Why it has no outcomes."""

    @property
    def begun(self) -> int:
        """Number of calls begun, as far as its worker has told."""
        return self._begun

    @property
    def share(self) -> float:
        """Share of a single call that is done, as its worker told last."""
        return self._share

    @property
    def has_ended(self) -> bool:
        """Nothing more comes of it."""
        return self._ended_at > 0.0

    @property
    def began_at(self) -> float:
        """When a child began it; now, if none is known to have."""
        return self._began_at or time.monotonic()

    @property
    def ended_at(self) -> float:
        """When it ended."""
        return self._ended_at or time.monotonic()

    @property
    def is_taken(self) -> bool:
        """A child is known to have begun it."""
        return self._began_at > 0.0

    @property
    def is_stuck(self) -> bool:
        """No child has begun it in time."""
        waits = not self.has_ended and self._begun == 0
        return waits and time.monotonic() > self._sent_at + UNTAKEN_SECONDS

    def stop(self) -> int:
        """Ask its worker; until that has replied, all of its calls may have begun."""
        if not self._is_asked:
            self._is_asked = True
            self._ask_to_stop(self)
        return self._at_most

    def kill(self) -> None:
        """Release the task: Dask forgets it, or its worker kills the computation."""
        self.end(CancelledError())

    def outcomes(self) -> list[Outcome | None]:
        """Return the outcomes of the first calls."""
        if self.fault is not None:
            raise self.fault
        return self._outcomes

    def hear(self, begun: int | None, stopped: int | None, share: float) -> None:
        """Note what its worker says of it."""
        if begun:
            self._began_at = self._began_at or time.monotonic()
            self._begun = begun
        if stopped is not None:
            self._at_most = stopped
        if self._share < share < 1.0:
            self._share = share

    def reply(self, data: bytes) -> None:
        """Note its outcomes, or why it has none."""
        try:
            message = unpack(data)
            begun, seconds = message[0]["begun"], message[0]["seconds"]
            if not isinstance(begun, int) or not isinstance(seconds, float):
                raise MessageError("a reply does not say what was begun, or for how long")
            self._begun, self._began_at = begun, time.monotonic() - seconds
            self._outcomes = outcomes_in(message, self._kind, self._number)
        except Exception as fault:
            self.end(fault)
        else:
            self.end(None)

    def end(self, fault: BaseException | None) -> None:
        """Note that nothing more comes of it; a second end changes nothing."""
        if not self.has_ended:
            self.fault, self._ended_at = fault, time.monotonic()
            self._release(self)
