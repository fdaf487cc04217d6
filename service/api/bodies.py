"""Reads request bodies, so that every fault in them is answered by our own problem document."""

import asyncio
from collections.abc import Mapping, Sequence
from email.message import Message
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import Depends, Request

from service.api.dependencies import Inside, Resources
from service.api.formats.negotiation import ACCEPTED, IDENTITY, CodingError, decoded
from service.api.replies.errors import ApiError
from service.schemas.reading.documents import InvalidJsonError, parse_json

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
