"""The refusal of a request: an RFC 9457 problem document, with one code per cause."""

import json
from collections.abc import Mapping, Sequence
from http import HTTPStatus

from fastapi import Response

from service.schemas.reading.documents import Fault, Part

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
