"""From exceptions to problem documents."""

import logging
from http import HTTPStatus

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from sqlalchemy.exc import OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from starlette.exceptions import HTTPException

from service.api.errors import ApiError, invalid_request
from service.dynamics.errors import DynamicsError
from service.jobs.errors import JobFinishedError, JobNotFoundError, SolutionNotFoundError
from service.sandbox import SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.faults import Fault, InvalidProblemError

_log = logging.getLogger(__name__)

RETRY_SECONDS = 5
"""What clients are told to wait if the database cannot be reached."""

_CODES = {
    HTTPStatus.NOT_FOUND: "not_found",
    HTTPStatus.METHOD_NOT_ALLOWED: "method_not_allowed",
}


def install(app: FastAPI) -> None:
    """Make every error of ``app`` a problem document."""
    app.add_exception_handler(ApiError, _respond)
    app.add_exception_handler(InvalidProblemError, _respond)
    app.add_exception_handler(DynamicsError, _respond)
    app.add_exception_handler(RequestValidationError, _respond)
    app.add_exception_handler(HTTPException, _respond)
    for cause in (JobNotFoundError, SolutionNotFoundError, JobFinishedError):
        app.add_exception_handler(cause, _respond)
    for limit in (SandboxTimeoutError, SandboxMemoryError, SandboxCrashError):
        app.add_exception_handler(limit, _respond)
    app.add_exception_handler(OperationalError, _respond)
    app.add_exception_handler(PoolTimeoutError, _respond)
    app.add_exception_handler(Exception, _respond)


def _respond(request: Request, error: Exception) -> Response:
    refusal = refusal_of(error)
    if refusal.status >= HTTPStatus.INTERNAL_SERVER_ERROR:
        trace = None if isinstance(error, ApiError) else error
        _log.error("%s %s: %s", request.method, request.url.path, refusal.code, exc_info=trace)
    return refusal.response()


def refusal_of(error: Exception) -> ApiError:
    """Return what a client is told about ``error``; nothing about the inside of the service."""
    unprocessable = HTTPStatus.UNPROCESSABLE_ENTITY
    match error:
        case ApiError():
            return error
        case InvalidProblemError():
            return ApiError(unprocessable, "invalid_problem", str(error), faults=error.faults)
        case DynamicsError():
            faults = [Fault(error.pointer, error.code, error.message)] if error.pointer else []
            return ApiError(unprocessable, error.code, error.message, faults=faults)
        case RequestValidationError():
            return invalid_request(_query_faults(error))
        case HTTPException():
            return _of_http(error)
        case JobNotFoundError() | SolutionNotFoundError():
            return ApiError(HTTPStatus.NOT_FOUND, "not_found", str(error))
        case JobFinishedError():
            return ApiError(HTTPStatus.CONFLICT, "job_finished", str(error))
        case SandboxTimeoutError():
            detail = "no verdict within the time limit; a simpler formula may have one"
            return ApiError(unprocessable, "verdict_time_limit", detail)
        case SandboxMemoryError():
            detail = "no verdict within the memory limit; a simpler formula may have one"
            return ApiError(unprocessable, "verdict_memory_limit", detail)
        case SandboxCrashError():
            detail = "the computation of the verdict crashed; a simpler formula may have one"
            return ApiError(unprocessable, "verdict_crashed", detail)
        case OperationalError() | PoolTimeoutError():
            detail = "the database cannot be reached at the moment; try again later"
            headers = {"Retry-After": str(RETRY_SECONDS)}
            return ApiError(HTTPStatus.SERVICE_UNAVAILABLE, "unavailable", detail, headers=headers)
    return ApiError(
        HTTPStatus.INTERNAL_SERVER_ERROR,
        "internal_error",
        "the service failed; its log says why. Nothing is wrong with the request as far as is known",
    )


def _of_http(error: HTTPException) -> ApiError:
    status = HTTPStatus(error.status_code)
    code = _CODES.get(status, status.name.lower())
    detail = {"not_found": "there is nothing at this path; /docs lists what there is"}.get(code, error.detail)
    return ApiError(status, code, detail, headers=error.headers)


def _query_faults(error: RequestValidationError) -> list[Fault]:
    faults = []
    for entry in error.errors():
        place, *names = entry["loc"]
        pointer = ("?" if place == "query" else f"{place} ") + ".".join(map(str, names))
        code, message = entry["type"], entry["msg"]
        if code == "extra_forbidden":
            code, message = "unknown_parameter", "there is no such parameter here"
        elif code == "missing":
            code, message = "missing_parameter", "this parameter is needed"
        else:
            code = "invalid_value"
        faults.append(Fault(pointer, code, message))
    return faults
