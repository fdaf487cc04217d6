"""Gives every request an id, times, counts and logs it; converts exceptions to problem documents."""

import logging
import re
import time
from http import HTTPStatus

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from sqlalchemy.exc import SQLAlchemyError
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.dependencies import Resources
from service.api.replies import REQUEST_ID, ApiError, invalid_request, server_name
from service.dashboard.routes import show_missing, wants_page
from service.dynamics.errors import DynamicsError
from service.jobs.records import (
    AuditNotFoundError,
    InUseError,
    JobFinishedError,
    JobNotFoundError,
    ResultNotFoundError,
    SolutionNotFoundError,
    StillAtWorkError,
    SweepFinishedError,
    SweepNotFoundError,
)
from service.logs import Complaints, about, place_of
from service.sandbox import SandboxCrashError, SandboxError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.reading.documents import Fault, InvalidProblemError
from service.schemas.sweep.reading import InvalidSweepError
from service.storage.database.availability import is_away
from service.storage.database.database import SearchTimeError
from service.storage.database.rows import new_id

logger = logging.getLogger(__name__)

RATE = "rate"
"""In the state of a request: the headers that tell of the limit of requests."""
ECHO = "Polhode-Echo"
"""Header that is returned as it was sent. Ids do not tell whose an answer is: proxies set them."""

_SANE_ID = re.compile(r"[A-Za-z0-9._:-]{1,128}")
_ABSOLUTE = re.compile(r"https?://(?P<authority>[^/?#@\s]+)", re.ASCII | re.IGNORECASE)
_METHODS = frozenset({"GET", "POST", "PUT", "PATCH", "DELETE", "HEAD", "OPTIONS"})
_QUIET = ("/livez", "/readyz", "/metrics")
"""Polled often by machines, so logged less."""


class Observation:
    """Our outermost middleware."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and record the answer."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        _read_absolute_form(scope)
        sent = Headers(scope=scope)
        request_id = _id_of(sent)
        scope.setdefault("state", {})["request_id"] = request_id
        if _SANE_ID.fullmatch(echo := sent.get(ECHO, "")):
            scope["state"][ECHO] = {ECHO: echo}
        status = 500  # an unhandled error: an outer layer makes the answer
        began = time.perf_counter()

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message).update(standing_headers(scope))
            await send(message)

        with about(request_id=request_id):
            try:
                await self._app(scope, receive, send_with_id)
            finally:
                _observe(scope, status, time.perf_counter() - began)


def _read_absolute_form(scope: Scope) -> None:
    """Read a target such as ``http://host/v1/jobs``, whose authority replaces Host (RFC 9112, 3.2.2)."""
    found = _ABSOLUTE.match(scope["path"])
    if found is None:
        return
    scope["path"] = scope["path"][found.end() :] or "/"
    raw = scope.get("raw_path") or b""
    scope["raw_path"] = raw[found.end() :] or b"/"
    headers = [(name, value) for name, value in scope["headers"] if name != b"host"]
    scope["headers"] = [*headers, (b"host", found["authority"].encode())]


def standing_headers(scope: Scope) -> dict[str, str]:
    """Return the headers of every answer: who answers to which request, and what the rate limit leaves."""
    state = scope.get("state", {})
    request_id = state.get("request_id")
    named = {} if request_id is None else {REQUEST_ID: request_id}
    return {"Server": server_name(), **named, **state.get(ECHO, {}), **state.get(RATE, {})}


def id_of(request: Request) -> str | None:
    """Return the id of the request, if it has one yet."""
    found = request.scope.get("state", {}).get("request_id")
    return found if isinstance(found, str) else None


def _id_of(headers: Headers) -> str:
    sent = headers.get(REQUEST_ID, "")
    return sent if _SANE_ID.fullmatch(sent) else new_id()


def _observe(scope: Scope, status: int, seconds: float) -> None:
    method = scope["method"] if scope["method"] in _METHODS else "other"
    # The route's template, not the path: otherwise every id or unknown path would be a metric of its own.
    route = getattr(scope.get("route"), "path", "none")
    resources: Resources = scope["app"].state.resources
    resources.metrics.observe(method, route, status, seconds)
    level = logging.DEBUG if scope["path"] in _QUIET else logging.INFO
    fields = {"method": method, "path": scope["path"], "status": status, "seconds": round(seconds, 6)}
    logger.log(level, "request", extra={"fields": fields})


_log = logging.getLogger(__name__)

CLIENT_GONE = 499
"""Status, in logs and metrics, of requests whose client disconnected."""
RETRY_SECONDS = 5
"""Retry-After if the database cannot be reached."""

_UNAVAILABLE = "unavailable"
_OVERLOAD = ("verdicts_busy", "busy")
"""Refusals that are not logged: no defect of this service, often many at once, and counted by status."""
_NOWHERE = ("not_found", "key_missing")
"""Codes of the refusal of a path that does not exist; without a key nobody learns that it does not."""
_CODES = {
    HTTPStatus.NOT_FOUND: "not_found",
    HTTPStatus.METHOD_NOT_ALLOWED: "method_not_allowed",
}


def install(app: FastAPI) -> None:
    """Make every error of ``app`` a problem document."""
    app.state.complaints = Complaints(_log)
    app.add_exception_handler(ApiError, respond)
    app.add_exception_handler(InvalidProblemError, respond)
    app.add_exception_handler(DynamicsError, respond)
    app.add_exception_handler(RequestValidationError, respond)
    app.add_exception_handler(HTTPException, respond)
    for cause in (
        JobNotFoundError,
        ResultNotFoundError,
        AuditNotFoundError,
        SolutionNotFoundError,
        SweepNotFoundError,
        JobFinishedError,
        SweepFinishedError,
        StillAtWorkError,
        InUseError,
        SearchTimeError,
        SandboxError,
    ):
        app.add_exception_handler(cause, respond)
    app.add_exception_handler(SQLAlchemyError, respond)
    app.add_exception_handler(ClientDisconnect, respond)
    app.add_exception_handler(Exception, respond)


async def respond(request: Request, error: Exception) -> Response:
    """Return the problem document of an error, and log it if it points to a defect.

    Runs on the event loop, so that it works although all threads are busy.
    """
    refusal = refusal_of(error)
    request_id = id_of(request)
    if refusal.code == _UNAVAILABLE:
        # All requests of an outage have the same reason, and clients send each again and again.
        request.app.state.complaints.tell(f"{_UNAVAILABLE}: {type(error).__name__}", error)
    elif refusal.status >= HTTPStatus.INTERNAL_SERVER_ERROR and refusal.code not in _OVERLOAD:
        trace = None if isinstance(error, ApiError) else error
        kind = refusal.code if trace is None else place_of(trace)
        said = f"{request.method} {request.url.path}: {refusal.code}"
        # Unexpected errors are answered outside of the request's own context.
        with about(request_id=request_id):
            request.app.state.complaints.tell(said, trace, kind=kind, level=logging.ERROR)
    if refusal.code in _NOWHERE and wants_page(request):
        response = show_missing(request.url.path, refusal.status, refusal.headers or {})
    else:
        response = refusal.response(request_id)
    response.headers.update(standing_headers(request.scope))
    return response


def refusal_of(error: Exception) -> ApiError:
    """Return what the answer says about ``error``, without internal details."""
    unprocessable = HTTPStatus.UNPROCESSABLE_ENTITY
    match error:
        case ApiError():
            return error
        case InvalidSweepError():
            return ApiError(unprocessable, "invalid_sweep", str(error), faults=error.faults)
        case InvalidProblemError():
            return ApiError(unprocessable, "invalid_problem", str(error), faults=error.faults)
        case DynamicsError():
            faults = [Fault(error.pointer, error.code, error.message)] if error.pointer else []
            return ApiError(unprocessable, error.code, error.message, faults=faults)
        case RequestValidationError():
            return invalid_request(_query_faults(error))
        case HTTPException():
            return _of_http(error)
        case ClientDisconnect():
            return ApiError(CLIENT_GONE, "client_gone", "the client disconnected; this answer is not read")
        case (
            JobNotFoundError()
            | SolutionNotFoundError()
            | SweepNotFoundError()
            | AuditNotFoundError()
            | ResultNotFoundError()
        ):
            return ApiError(HTTPStatus.NOT_FOUND, "not_found", str(error))
        case JobFinishedError():
            return ApiError(HTTPStatus.CONFLICT, "job_finished", str(error))
        case StillAtWorkError():
            return ApiError(HTTPStatus.CONFLICT, "not_finished", str(error))
        case InUseError():
            extras = {"referrers": list(error.referrers)}
            return ApiError(HTTPStatus.CONFLICT, "in_use", str(error), extras=extras)
        case SweepFinishedError():
            return ApiError(HTTPStatus.CONFLICT, "sweep_finished", str(error))
        case SandboxTimeoutError():
            detail = "no verdict within the time limit; a simpler formula may get one"
            return ApiError(unprocessable, "verdict_time_limit", detail)
        case SandboxMemoryError():
            detail = "no verdict within the memory limit; a simpler formula may get one"
            return ApiError(unprocessable, "verdict_memory_limit", detail)
        case SandboxCrashError():
            detail = "the computation of the verdict crashed twice; a simpler formula may get one"
            return ApiError(unprocessable, "verdict_crashed", detail)
        case SearchTimeError():
            detail = f"{error}; ?estimate=true shows which part of the query takes long"
            return ApiError(unprocessable, "query_time_limit", detail)
        case Exception() if is_away(error):
            detail = "the database cannot be reached at the moment; try again later"
            headers = {"Retry-After": str(RETRY_SECONDS)}
            return ApiError(HTTPStatus.SERVICE_UNAVAILABLE, _UNAVAILABLE, detail, headers=headers)
    return ApiError(
        HTTPStatus.INTERNAL_SERVER_ERROR,
        "internal_error",
        "the service failed; its log has the reason. No fault is known in the request",
    )


def _of_http(error: HTTPException) -> ApiError:
    status = HTTPStatus(error.status_code)
    code = _CODES.get(status, status.name.lower())
    detail = {"not_found": "there is nothing at this path; /docs lists the paths"}.get(code, error.detail)
    return ApiError(status, code, detail, headers=error.headers)


def _query_faults(error: RequestValidationError) -> list[Fault]:
    faults = []
    for entry in error.errors():
        part, *names = entry["loc"]
        pointer = ("?" if part == "query" else f"{part} ") + ".".join(map(str, names))
        code, message = entry["type"], entry["msg"]
        if code == "extra_forbidden":
            code, message = "unknown_parameter", "this endpoint has no such parameter"
        elif code == "missing":
            code, message = "missing_parameter", "this parameter is needed"
        else:
            code = "invalid_value"
        faults.append(Fault(pointer, code, message))
    return faults
