"""Shared resources of the endpoints (stores, children, settings), made once, and the bodies of requests.

Every fault in a body is answered by our own problem document.

Documents are parsed in threads of their own. Parsing is pure Python: more threads do not
speed it up, they only take the interpreter from the event loop. A document of a megabyte
may take a second, so large ones are parsed one at a time, and small ones do not wait for
them.
"""

import asyncio
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from email.message import Message
from http import HTTPStatus
from typing import Annotated, Any, Generic, TypeVar, TypeVarTuple

from anyio import CapacityLimiter, to_thread
from fastapi import Depends, Request

from service.api.events.watcher import EventWatcher
from service.api.formats.negotiation import ACCEPTED, IDENTITY, CodingError, decoded
from service.api.heavy_reads import HeavyReads
from service.api.keys.access import KeyRing
from service.api.keys.idempotency import IdempotencyGuard
from service.api.keys.limits import LimitGuard
from service.api.prometheus import Metrics
from service.api.replies import ApiError
from service.api.verdicts.examiner import Examiner
from service.api.verdicts.verdict_queue import VerdictQueue
from service.cache import Cache
from service.jobs.kernels import ClusterState, Kernels
from service.local.wakeup import WakeUpSocket
from service.local.workers import WorkerStanding
from service.sandbox import Sandbox
from service.schemas.reading.documents import InvalidJsonError, parse_json
from service.settings import Settings
from service.storage.database.cached_reads import CachedReads
from service.storage.database.database import Database
from service.storage.jobs.job_store import JobStore
from service.storage.solutions.result_store import AuditStore, ResultStore
from service.storage.solutions.solution_store import SolutionStore
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.upkeep.presence import ServicePresence, WorkersState

Checks = tuple[dict[str, str], WorkersState, Kernels | None, ClusterState | None]
"""The faults of the parts, the workers, the kernels that they lack, the cluster on which they compute."""

T = TypeVar("T")
Arguments = TypeVarTuple("Arguments")

LARGE_BYTES = 50_000
"""Larger documents are read one after the other."""
_SMALL_AT_ONCE = 4


class ReadingThreads:
    """The threads in which documents are read, off the event loop."""

    def __init__(self) -> None:
        self._small, self._large = CapacityLimiter(_SMALL_AT_ONCE), CapacityLimiter(1)

    async def run(self, size: int, function: Callable[[*Arguments], T], *arguments: *Arguments) -> T:
        """Return ``function(*arguments)``, which reads a document of ``size`` bytes."""
        limiter = self._large if size > LARGE_BYTES else self._small
        return await to_thread.run_sync(function, *arguments, limiter=limiter)


class SharedAnswer(Generic[T]):
    """Makes something for all that ask for it, never twice at the same time: it costs as much for many.

    Parameters
    ----------
    threads
        Of its own, so that it is made although all others are busy.
    """

    def __init__(self, make: Callable[[], T], threads: CapacityLimiter) -> None:
        self._make, self._threads = make, threads
        self._making: asyncio.Task[T] | None = None

    async def get(self) -> T:
        """Return what is being made, or is made now."""
        if self._making is None:
            self._making = asyncio.create_task(to_thread.run_sync(self._make, limiter=self._threads))
            self._making.add_done_callback(self._forget)
        # Whoever asked first may leave: the others still wait for it.
        return await asyncio.shield(self._making)

    def _forget(self, made: asyncio.Task[T]) -> None:
        self._making = None
        if not made.cancelled():
            made.exception()  # whoever waits is told; if nobody does, it is no fault


@dataclass(frozen=True, slots=True)
class Resources:
    """Stores, the queue of the children that compute verdicts, and the wake-up of local workers."""

    settings: Settings
    database: Database
    jobs: JobStore
    solutions: SolutionStore
    audits: AuditStore
    results: ResultStore
    """Atlases, and answers of studies."""
    sweeps: SweepStore
    sandbox: Sandbox
    verdicts: VerdictQueue
    examiner: Examiner
    reading: ReadingThreads
    heavy: HeavyReads
    """Places for answers that compute or build much."""
    wake_up: WakeUpSocket
    events: EventWatcher
    metrics: Metrics
    keys: KeyRing
    limits: LimitGuard
    idempotency: IdempotencyGuard
    answers: Cache[str, bytes]
    """Bytes of answers that were written before, by their entity tags: one names exactly one content."""
    reads: CachedReads
    presence: ServicePresence
    """Keeps the presence row of this service, and knows whether the database can be written to."""
    waiting: threading.BoundedSemaphore
    """Limits the number of clients that wait for their job, since each one polls the database."""
    metrics_text: SharedAnswer[bytes]
    """The answer of /metrics."""
    checks: SharedAnswer[Checks]
    """The facts that /readyz answers with."""
    local_worker: Callable[[], WorkerStanding] | None
    """Returns the status of the worker process beside this service, if there is one."""


async def _resources(request: Request) -> Resources:
    resources: Resources = request.app.state.resources
    return resources


Inside = Annotated[Resources, Depends(_resources)]
"""The type of an endpoint's parameter that receives the resources."""


MAX_BODY_BYTES = 1_000_000
_DISCARDED_BYTES = 16 * MAX_BODY_BYTES
JSON, UTF_8 = "application/json", "utf-8"
MERGE_PATCH = "application/merge-patch+json"
"""The media type of a change of a JSON document (RFC 7396); plain JSON means the same here."""


async def _read_body(request: Request, inside: Inside) -> bytes:
    """Return the body, which must be declared as JSON in UTF-8; never buffer or decode beyond the limit."""
    return await _read(request, inside, "Accept", JSON)


async def _read_body_if_any(request: Request, inside: Inside) -> bytes:
    """Return the body in the same way; empty if the request has none (RFC 9112, 6.3)."""
    headers = request.headers
    if headers.get("content-length", "0") == "0" and "transfer-encoding" not in headers:
        return b""
    return await _read(request, inside, "Accept", JSON)


async def _read_patch(request: Request, inside: Inside) -> bytes:
    """Return a change in the same way, which may be declared as a merge patch, too."""
    # RFC 5789, 2.2: Accept-Patch in the refusal says what would be accepted.
    return await _read(request, inside, "Accept-Patch", MERGE_PATCH, JSON)


async def _read(request: Request, inside: Resources, asking: str, *accepted: str) -> bytes:
    _require(accepted, request.headers.get("content-type", ""), asking)
    coding = _coding_of(request.headers.getlist("content-encoding"))
    length = request.headers.get("content-length", "0")
    if length.isdecimal() and int(length[:20]) > MAX_BODY_BYTES:
        # What is sent of it is of no use. To close the connection would reset it, so that whoever is still
        # sending, or a proxy, may not get the answer; so not much is read and thrown away.
        is_discarded = int(length[:20]) <= _DISCARDED_BYTES and "expect" not in request.headers
        raise _too_large("", {} if is_discarded else {"Connection": "close"})
    content, seconds = bytearray(), inside.settings.body_seconds
    try:
        async with asyncio.timeout(seconds):
            async for chunk in request.stream():
                content += chunk
                if len(content) > MAX_BODY_BYTES:
                    raise _too_large("")
    except TimeoutError as fault:
        detail = f"the body was not complete after {seconds:g} s"
        headers = {"Connection": "close"}
        raise ApiError(HTTPStatus.REQUEST_TIMEOUT, "request_timeout", detail, headers=headers) from fault
    return bytes(content) if coding is None else _plain(bytes(content), coding)


def _plain(content: bytes, coding: str) -> bytes:
    try:
        plain = decoded(content, coding, MAX_BODY_BYTES)
    except CodingError as fault:
        raise ApiError(HTTPStatus.BAD_REQUEST, "invalid_encoding", str(fault)) from fault
    if plain is None:
        raise _too_large(" after decompression")
    return plain


def _too_large(when: str, headers: Mapping[str, str] | None = None) -> ApiError:
    detail = f"at most {MAX_BODY_BYTES} bytes are accepted{when}"
    return ApiError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "body_too_large", detail, headers=headers)


def _require(accepted: Sequence[str], header: str, asking: str) -> None:
    """Refuse a Content-Type that is none of ``accepted``, or another charset than UTF-8."""
    message = Message()
    message["Content-Type"] = header or "none"
    media_type, charset = message.get_content_type(), message.get_content_charset(UTF_8)
    if media_type in accepted and charset in (UTF_8, "utf8"):
        return
    said = f"the Content-Type is {header[:100]}" if header else "the Content-Type is missing"
    raise ApiError(
        HTTPStatus.UNSUPPORTED_MEDIA_TYPE,
        "unsupported_media_type",
        f"{said}; {' or '.join(accepted)} in {UTF_8} is accepted",
        headers={asking: ", ".join(accepted)},
    )


def _coding_of(headers: Sequence[str]) -> str | None:
    """Return the coding of a body, None if it has none; refuse others, and several.

    RFC 9110, 12.5.3: Accept-Encoding in the refusal says what would be accepted.
    """
    codings = [coding.strip().lower() for header in headers for coding in header.split(",")]
    given = [coding for coding in codings if coding not in ("", IDENTITY)]
    if not given:
        return None
    if len(given) == 1 and given[0] in ACCEPTED:
        return given[0]
    accepted = ", ".join(ACCEPTED)
    raise ApiError(
        HTTPStatus.UNSUPPORTED_MEDIA_TYPE,
        "unsupported_content_encoding",
        f"the Content-Encoding is {', '.join(given)[:40]}; accepted is one of {accepted}, or none",
        headers={"Accept-Encoding": accepted},
    )


Body = Annotated[bytes, Depends(_read_body)]
"""The type of an endpoint's parameter that receives the raw body."""
BodyIfAny = Annotated[bytes, Depends(_read_body_if_any)]
"""The same of an endpoint that needs none."""
Patch = Annotated[bytes, Depends(_read_patch)]
"""The same of an endpoint of PATCH."""


def read_json(content: bytes) -> Any:  # noqa: ANN401 (what a client sent: who reads it checks it)
    """Parse a body as JSON.

    Raises
    ------
    ApiError
        400, with the place of the first syntax error.
    """
    try:
        document: Any = parse_json(content)
    except InvalidJsonError as error:
        raise ApiError(HTTPStatus.BAD_REQUEST, "invalid_json", str(error)) from error
    return document
