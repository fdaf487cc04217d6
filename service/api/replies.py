"""Answers: jobs, solutions and sweeps as they are shown; JSON without NaN; streams; headers; refusals.

A refusal is an RFC 9457 problem document, with one code per cause. Conditional requests are those of
RFC 9110, 13, and RFC 9111: strong entity tags, and what caches may keep.
"""

import hashlib
import json
import re
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import cache
from http import HTTPStatus
from typing import Annotated

from fastapi import Path, Request, Response
from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from service.dynamics.numerics import NUMERICS
from service.jobs.records import Job, JobKind, JobState, SweepProgress, SweepRecord
from service.schemas.reading.documents import Annotation, Document, Fault, Part, instant_text
from service.schemas.replies.job import JobOut
from service.schemas.replies.response_model import ResponseModel
from service.schemas.replies.solution import AuditOut, ComparisonOut, SolutionOut
from service.schemas.replies.sweep import SweepOut, SweepStateOut
from service.storage.solutions.result_store import Audit
from service.storage.solutions.solution_store import Solution
from service.versions import version_of

MEDIA_TYPE = "application/problem+json"
URN = "urn:polhode:problem:"

TITLES: Mapping[str, str] = {
    "accuracy_not_met": "The accuracy cannot be met",
    "ambiguous_length": "The length of the body is ambiguous",
    "body_too_large": "The body is too large",
    "client_gone": "The client disconnected",
    "cross_origin": "Sent by a page of another origin",
    "idempotency_key_in_use": "The first request is still at work",
    "idempotency_key_reused": "The key was sent with another request",
    "in_use": "Something refers to it",
    "inadmissible_motion": "The motion does not keep q = 0",
    "inadmissible_potential": "The potential admits no such motions",
    "internal_error": "The service failed",
    "invalid_encoding": "The body is not in its Content-Encoding",
    "invalid_http": "The request is not HTTP",
    "invalid_json": "The body is not JSON",
    "invalid_problem": "The document is not a valid problem",
    "invalid_request": "The request is not valid",
    "invalid_sweep": "The document is not a valid sweep",
    "job_finished": "The job has finished",
    "key_expired": "The key has expired",
    "key_missing": "A key is needed",
    "key_revoked": "The key has been revoked",
    "key_unknown": "The key is unknown",
    "leaves_domain": "The motion leaves the potential's domain",
    "method_not_allowed": "Method not allowed",
    "no_enclosures": "The solution has no enclosures",
    "no_motion": "There is no such motion",
    "no_series": "The solution has no trajectory",
    "no_such_window": "There is no such window",
    "no_problem_accepted": "No problem was accepted",
    "not_acceptable": "The format is not offered",
    "not_finite": "The stored solution is damaged",
    "not_finished": "It has not finished",
    "not_found": "Not found",
    "not_ready": "Not ready",
    "motion_ended": "The motion ends before that time",
    "outside_horizon": "The time is outside the solution",
    "busy": "Too much is being read",
    "changed_meanwhile": "It has changed meanwhile",
    "invalid_patch": "The change is not valid",
    "passage_undecided": "The motion beyond a pole is undecided",
    "period_needed": "The motion has no period",
    "query_time_limit": "The query takes too long",
    "request_timeout": "The request came too slowly",
    "role_insufficient": "The key's role does not allow this",
    "flat_zero": "A zero of p² has no finite order",
    "standstill": "The motion has more than one continuation",
    "host_not_local": "The host name is not a loopback name",
    "separatrix_undecided": "A separatrix, or a very long period",
    "several_windows": "There are several motions",
    "essential_singularity": "p² behaves like no power of the distance next to a point",
    "signs_unsettled": "It is undecided where motions exist",
    "start_needed": "A start must be given",
    "start_outside_window": "The motion does not pass the start",
    "storage_limit": "Too much is stored",
    "too_many_streams": "Too many streams of events",
    "too_many_connections": "Too many connections",
    "too_many_queued_jobs": "Too many jobs",
    "too_many_requests": "Too many requests",
    "sweep_finished": "The sweep has finished",
    "undecided_motion": "The motion is undecided",
    "undecided_potential": "The potential is undecided",
    "unavailable": "The database cannot be reached",
    "undefined_potential": "The potential is undefined",
    "unsupported_content_encoding": "The Content-Encoding is not accepted",
    "unsupported_media_type": "Unsupported media type",
    "verdict_crashed": "The verdict could not be reached",
    "verdict_memory_limit": "The verdict takes too much memory",
    "verdict_time_limit": "The verdict takes too long",
    "verdicts_busy": "Too many requests wait for verdicts",
}
"""Titles by code; a domain error without a title here uses its code as the title."""


class ApiError(Exception):
    """The refusal of a request."""

    def __init__(
        self,
        status: int,
        code: str,
        detail: str,
        *,
        faults: Sequence[Fault] = (),
        extras: Part | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(detail)
        self.status, self.code, self.detail = status, code, detail
        self.faults, self.extras, self.headers = tuple(faults), dict(extras or {}), dict(headers or {})

    def document(self) -> Part:
        """Return the problem document."""
        document: dict[str, object] = {
            "type": URN + self.code,
            "title": TITLES.get(self.code, self.code.replace("_", " ").capitalize()),
            "status": self.status,
            "detail": self.detail,
        }
        if self.faults:
            document["errors"] = [_fault_document(fault) for fault in self.faults]
        document.update(self.extras)
        return document

    def response(self, request_id: str | None = None) -> Response:
        """Return the answer; its request id finds the request in the log."""
        document = self.document() if request_id is None else {**self.document(), "request_id": request_id}
        # Escaped to ASCII: half of a surrogate pair from a client cannot be encoded in UTF-8.
        content = json.dumps(document, allow_nan=False)
        return Response(content, status_code=self.status, media_type=MEDIA_TYPE, headers=self.headers)


def _fault_document(fault: Fault) -> Part:
    document: dict[str, object] = {"pointer": fault.pointer, "code": fault.code, "message": fault.message}
    if fault.position is not None:
        document["position"] = fault.position
    return document


def invalid_request(faults: Sequence[Fault]) -> ApiError:
    """Return the refusal of query parameters or headers."""
    detail = "; ".join(f"{fault.pointer}: {fault.message}" for fault in faults)
    return ApiError(HTTPStatus.UNPROCESSABLE_ENTITY, "invalid_request", detail, faults=faults)


IMMUTABLE = "private, immutable, max-age=31536000"
"""Cache-Control of an answer that never changes: caches need not ask again for a year."""
REVALIDATE = "no-cache"
"""Cache-Control of an answer that may change: caches keep it, and ask each time whether it has changed."""
NO_STORE = "no-store"
"""Cache-Control of errors, and of answers that differ each time."""

VOLATILE = ("/livez", "/readyz", "/metrics", "/v1/status")
"""Paths whose answers are different each time: nobody should keep them, and they have no tags."""

REPRESENTATION = 1
"""Grows whenever the same resource is written differently and the version of the package stays."""
CODINGS = ("gzip", "zstd")
"""Content codings of answers; each makes another representation, whose tag ends in its name."""
_TAG_BYTES = 16
_TAGS = re.compile(r'\s*(?:W/)?("[\x21\x23-\x7e\x80-\xff]*")\s*(?:,|\Z)')
_CODED = re.compile(rf"-(?:{'|'.join(CODINGS)})\"\Z")


def tag_of_resource(request: Request, media_type: str, *identity: object) -> str:
    """Return the tag of an answer by what it is, known before the answer is made.

    Parameters
    ----------
    request
        Its path and query say what is asked for; the order of different parameters does not matter.
    identity
        What the stored resource is, and the version of everything in it that can change.
    """
    query = sorted(request.query_params.multi_items(), key=lambda pair: pair[0])
    return tag_of_content(repr((_ours(), request.scope["path"], query, media_type, identity)).encode())


def tag_of_content(content: bytes) -> str:
    """Return the tag of an answer by its bytes."""
    return f'"{hashlib.blake2b(content, digest_size=_TAG_BYTES).hexdigest()}"'


def coded(tag: str, coding: str) -> str:
    """Return the tag of the same answer in a content coding: other bytes need another strong tag."""
    return f'{tag[:-1]}-{coding}"'


def matching_tag(header: str | None, tag: str) -> str | None:
    """Return the tag of an If-None-Match header that names the current answer, in any coding; else None.

    ``*`` names no tag: it matches whatever turns out to be there.
    """
    return next((each for each in _tags(header or "") if _CODED.sub('"', each) == tag), None)


def is_current(header: str | None, tag: str) -> bool:
    """Tell whether If-Match lets a change of what has this tag happen; without the header anything does.

    RFC 9110, 13.1.1: weak tags never match. A tag of any coding names the same state.
    """
    if header is None or header.strip() == "*":
        return True
    strong = (each[1] for each in _TAGS.finditer(header) if not each[0].lstrip().startswith("W/"))
    return any(_CODED.sub('"', each) == tag for each in strong)


def validators(tag: str, cache_control: str) -> Mapping[str, str]:
    """Return the headers by which a client can ask again."""
    return {"ETag": tag, "Cache-Control": cache_control}


def _tags(header: str) -> Iterator[str]:
    """Yield the tags of a list; weak ones too, since If-None-Match compares weakly."""
    position = 0
    while found := _TAGS.match(header, position):
        yield found[1]
        position = found.end()


@cache
def _ours() -> tuple[object, ...]:
    return version_of("polhode"), REPRESENTATION, NUMERICS


JSON = "application/json"


def json_response(
    model: ResponseModel, *, status: int = HTTPStatus.OK, headers: Mapping[str, str] | None = None
) -> Response:
    """Return a model as JSON.

    Pydantic's and orjson's writers are not used: both silently turn NaN into null, and
    orjson refuses integers beyond 64 bits, which problems may hold.
    """
    return Response(json_content(model), status_code=status, media_type=JSON, headers=headers)


def json_content(model: ResponseModel) -> bytes:
    """Return the bytes of a model as JSON."""
    return json.dumps(model.model_dump(by_alias=True), allow_nan=False, default=_instant).encode()


def _instant(value: object) -> str:
    if isinstance(value, datetime):
        return instant_text(value)
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def refusals(*statuses: int) -> dict[int | str, dict[str, object]]:
    """Return the OpenAPI entries of refusals: these statuses, and 422, which any request can have."""
    schema = {"$ref": "#/components/schemas/ProblemDetailsOut"}
    return {
        status: {
            "description": HTTPStatus(status).phrase,
            "content": {MEDIA_TYPE: {"schema": schema}},
        }
        for status in sorted({*statuses, HTTPStatus.UNPROCESSABLE_ENTITY.value})
    }


JobId = Annotated[str, Path(description="Id of a job.")]
SolutionId = Annotated[str, Path(description="Id of a solution.")]
SweepId = Annotated[str, Path(description="Id of a sweep.")]
AtlasId = Annotated[str, Path(description="Id of an atlas, which is that of its job.")]
AuditId = Annotated[str, Path(description="Id of an audit, which is that of its job.")]


REQUEST_ID = "X-Request-ID"


@cache
def server_name() -> str:
    """Return the value of the Server header."""
    return f"polhode/{version_of('polhode')}"


Compute = Callable[[Callable[[], bytes | None]], Awaitable[bytes | None]]

PART_BYTES = 32768
"""No more is given to a connection at a time; then it is waited until its client has read most of it."""


class PiecedAnswer(StreamingResponse):
    """An answer whose pieces are computed one by one, each when the last one has left.

    Parameters
    ----------
    pieces
        Computes them.
    held
        Bytes that it keeps in memory until it has been sent, about.
    """

    def __init__(
        self, pieces: Iterator[bytes], *, held: int, media_type: str, headers: Mapping[str, str]
    ) -> None:
        super().__init__(_parts(self), media_type=media_type, headers=headers)
        self.held = held
        self.compute: Compute = _at_once
        """Makes the pieces. Where reads have slots, one that waits for its turn is put here."""
        self._pieces: Iterator[bytes] | None = pieces

    def next_piece(self) -> bytes | None:
        """Compute the next piece; None at the end."""
        return None if self._pieces is None else next(self._pieces, None)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send all pieces, as long as the client is there."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            # What they are made of may be large, and is referred to in a circle.
            self._pieces = None


async def _at_once(work: Callable[[], bytes | None]) -> bytes | None:
    return work()


async def _parts(answer: PiecedAnswer) -> AsyncIterator[bytes]:
    while (piece := await answer.compute(answer.next_piece)) is not None:
        for start in range(0, len(piece), PART_BYTES):
            yield piece[start : start + PART_BYTES]


def size_of(answer: Response) -> int:
    """Return the bytes that an answer keeps in memory until it has been sent, about."""
    return answer.held if isinstance(answer, PiecedAnswer) else len(answer.body)


_ADDED_LATER: Document = {
    "asymptotes": None,
    "precession": None,
    "warnings": [],
    "errors": None,
    "error_kind": None,
    "known_cases": [],
}
"""Fields that solutions stored by the first version lack."""


def job_out(job: Job) -> JobOut:
    """Return a job as it is shown."""
    return JobOut(
        id=job.id,
        state=job.state.value,
        priority=job.priority,
        attempt=job.attempt,
        progress=job.progress,
        error=None if job.error is None else dict(job.error),
        reused=job.reused,
        solution=job.solution_id,
        atlas=job.id if job.kind is JobKind.ATLAS and job.state is JobState.SUCCEEDED else None,
        result=None if job.result is None else dict(job.result),
        problem=dict(job.problem),
        labels=dict(job.annotation.labels),
        note=job.annotation.note,
        created_at=job.created_at,
        started_at=job.started_at,
        finished_at=job.finished_at,
    )


def solution_out(solution: Solution) -> SolutionOut:
    """Return a solution as it is shown."""
    document = {
        **_ADDED_LATER,
        **solution.summary,
        "id": solution.id,
        "job": solution.job_id,
        "problem": solution.problem,
        **_annotation(solution.annotation),
        "created_at": solution.created_at,
    }
    return SolutionOut.model_validate(document)


def audit_out(audit: Audit) -> AuditOut:
    """Return an audit as it is shown."""
    job, comparison = audit.job, audit.comparison
    verdict = "failed" if job.state is JobState.FAILED else comparison and comparison["verdict"]
    document = {
        "id": job.id,
        "solution": audit.solution_id,
        "state": job.state.value,
        "verdict": verdict,
        "found": job.solution_id,
        "comparison": comparison and {name: comparison[name] for name in ComparisonOut.model_fields},
        "error": job.error,
        "problem": job.problem,
        "created_at": job.created_at,
        "finished_at": job.finished_at,
    }
    return AuditOut.model_validate(document)


def sweep_out(record: SweepRecord) -> SweepOut:
    """Return a sweep as it is shown, with its document."""
    own = {"document": dict(record.document), "provenances": list(map(dict, record.provenances))}
    return SweepOut.model_validate({**_state(record), **own})


def sweep_state_out(record: SweepProgress) -> SweepStateOut:
    """Return a sweep as lists show it."""
    return SweepStateOut.model_validate(_state(record))


def _state(record: SweepProgress) -> Document:
    return {
        "id": record.id,
        "state": record.state.value,
        "points": record.points,
        "done": record.done,
        "refused": record.refused,
        "progress": record.done / record.points,
        "point_seconds": record.point_seconds,
        "way": record.way,
        "remaining_seconds": record.remaining_seconds,
        "priority": record.priority,
        **_annotation(record.annotation),
        "created_at": record.created_at,
        "started_at": record.started_at,
        "finished_at": record.finished_at,
    }


def _annotation(annotation: Annotation) -> Document:
    return {"labels": dict(annotation.labels), "note": annotation.note}
