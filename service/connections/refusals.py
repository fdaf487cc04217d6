"""Raw HTTP answers sent before or instead of the application's."""

import json
from http import HTTPStatus

from service.api.replies.errors import MEDIA_TYPE, ApiError
from service.api.replies.identity import REQUEST_ID, server_name
from service.storage.database.ids import new_id

BUSY_SECONDS = 1
"""Retry-After for clients that found no free connection."""


def as_bytes(error: ApiError) -> bytes:
    """Return a complete HTTP/1.1 answer that closes the connection."""
    request_id = new_id()
    content = json.dumps({**error.document(), "request_id": request_id}).encode("ascii")
    headers = {
        "Server": server_name(),
        REQUEST_ID: request_id,
        "Content-Type": MEDIA_TYPE,
        "Content-Length": str(len(content)),
        "Connection": "close",
        **error.headers,
    }
    head = f"HTTP/1.1 {error.status} {HTTPStatus(error.status).phrase}\r\n"
    return (head + "".join(f"{k}: {v}\r\n" for k, v in headers.items()) + "\r\n").encode("ascii") + content


def too_many_connections() -> ApiError:
    """Return the answer to a client when all connections are taken."""
    return ApiError(
        HTTPStatus.SERVICE_UNAVAILABLE,
        "too_many_connections",
        "all connections are taken by requests that are being answered; try again later",
        headers={"Retry-After": str(BUSY_SECONDS)},
    )


def too_slow(seconds: float) -> ApiError:
    """Return the answer to a request that was not complete in time."""
    return ApiError(
        HTTPStatus.REQUEST_TIMEOUT, "request_timeout", f"the request was not complete after {seconds:g} s"
    )


def malformed(status: int) -> ApiError:
    """Return the answer to bytes that are not an HTTP request."""
    detail = {
        HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE: "the head of the request is too long",
        HTTPStatus.NOT_IMPLEMENTED: "the only accepted transfer coding is chunked",
    }.get(HTTPStatus(status), "what was sent is not HTTP/1.1")
    return ApiError(status, "invalid_http", detail)
