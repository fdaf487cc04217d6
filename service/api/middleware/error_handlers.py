"""Converts exceptions to problem documents."""

import logging
from http import HTTPStatus

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from sqlalchemy.exc import SQLAlchemyError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from service.api.middleware.observing import id_of, standing_headers
from service.api.replies import ApiError, invalid_request
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
