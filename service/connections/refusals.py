"""What is sent to clients before there is an application to answer them, or instead of it."""

import json
from http import HTTPStatus

from service.api.errors import MEDIA_TYPE, ApiError

BUSY_SECONDS = 1
"""What clients are told to wait for a connection."""


def as_bytes(error: ApiError) -> bytes:
    """Return a whole answer of HTTP/1.1, after which the connection is closed."""
    content = json.dumps(error.document()).encode("ascii")
    headers = {
        "Content-Type": MEDIA_TYPE,
        "Content-Length": str(len(content)),
        "Connection": "close",
        **error.headers,
    }
    head = f"HTTP/1.1 {error.status} {HTTPStatus(error.status).phrase}\r\n"
    return (head + "".join(f"{k}: {v}\r\n" for k, v in headers.items()) + "\r\n").encode("ascii") + content


def too_many_connections() -> ApiError:
    """Return what a client is told for whom there is no connection."""
    return ApiError(
        HTTPStatus.SERVICE_UNAVAILABLE,
        "too_many_connections",
        "all connections are taken by requests that are being answered; try again later",
        headers={"Retry-After": str(BUSY_SECONDS)},
    )


def too_slow(seconds: float) -> ApiError:
    """Return what a client is told whose request was not complete in time."""
    return ApiError(
        HTTPStatus.REQUEST_TIMEOUT, "request_timeout", f"the request was not complete after {seconds:g} s"
    )


def malformed(status: int) -> ApiError:
    """Return what a client is told whose bytes are no request."""
    detail = {
        HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE: "the head of the request is too long",
        HTTPStatus.NOT_IMPLEMENTED: "of transfer codings, chunked is accepted",
    }.get(HTTPStatus(status), "what was sent is not HTTP/1.1")
    return ApiError(status, "invalid_http", detail)
