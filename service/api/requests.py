"""Bodies, read by ourselves: what is wrong with them is told as a problem document."""

import asyncio
from collections.abc import Sequence
from email.message import Message
from http import HTTPStatus
from typing import Annotated

from fastapi import Depends, Request

from service.api.errors import ApiError
from service.api.resources import Inside
from service.schemas.strict_json import InvalidJsonError, parse_json

MAX_BODY_BYTES = 1_000_000
JSON, UTF_8, IDENTITY = "application/json", "utf-8", "identity"


async def _read_body(request: Request, inside: Inside) -> bytes:
    """Return the body, which must be said to be plain JSON in UTF-8 and is never held beyond the limit."""
    _require_json(request.headers.get("content-type", ""))
    _require_identity(request.headers.getlist("content-encoding"))
    content, seconds = bytearray(), inside.settings.body_seconds
    try:
        async with asyncio.timeout(seconds):
            async for chunk in request.stream():
                content += chunk
                if len(content) > MAX_BODY_BYTES:
                    detail = f"at most {MAX_BODY_BYTES} bytes are accepted"
                    raise ApiError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "body_too_large", detail)
    except TimeoutError as fault:
        detail = f"the body was not complete after {seconds:g} s"
        headers = {"Connection": "close"}
        raise ApiError(HTTPStatus.REQUEST_TIMEOUT, "request_timeout", detail, headers=headers) from fault
    return bytes(content)


def _require_json(header: str) -> None:
    """Refuse a Content-Type that is not JSON, or JSON in another charset than the one it has."""
    message = Message()
    message["Content-Type"] = header or "none"
    media_type, charset = message.get_content_type(), message.get_content_charset(UTF_8)
    if media_type == JSON and charset in (UTF_8, "utf8"):
        return
    said = f"the body is said to be {header[:100]}" if header else "the Content-Type is missing"
    raise ApiError(
        HTTPStatus.UNSUPPORTED_MEDIA_TYPE,
        "unsupported_media_type",
        f"{said}; {JSON} in {UTF_8} is accepted",
        headers={"Accept": JSON},
    )


def _require_identity(headers: Sequence[str]) -> None:
    """Refuse a body that is compressed (RFC 9110, 12.5.3: Accept-Encoding says what would be accepted)."""
    codings = [coding.strip().lower() for header in headers for coding in header.split(",")]
    unknown = [coding for coding in codings if coding not in ("", IDENTITY)]
    if unknown:
        raise ApiError(
            HTTPStatus.UNSUPPORTED_MEDIA_TYPE,
            "unsupported_content_encoding",
            f"the body is said to be encoded by {unknown[0][:40]}; bodies are accepted as they are",
            headers={"Accept-Encoding": IDENTITY},
        )


Body = Annotated[bytes, Depends(_read_body)]
"""The type of an endpoint's parameter that receives the raw body."""


def read_json(content: bytes) -> object:
    """Return the document in a body.

    Raises
    ------
    ApiError
        400, with the place where it stops being JSON.
    """
    try:
        return parse_json(content)
    except InvalidJsonError as error:
        raise ApiError(HTTPStatus.BAD_REQUEST, "invalid_json", str(error)) from error
