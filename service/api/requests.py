"""Bodies, read by ourselves: what is wrong with them is told as a problem document."""

from http import HTTPStatus
from typing import Annotated

from fastapi import Depends, Request

from service.api.errors import ApiError
from service.schemas.strict_json import InvalidJsonError, parse_json

MAX_BODY_BYTES = 1_000_000
JSON = "application/json"


async def _read_body(request: Request) -> bytes:
    """Return the body, which must be said to be JSON and is never held beyond the limit."""
    media_type = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if media_type != JSON:
        said = f"the body is said to be {media_type}" if media_type else "the Content-Type is missing"
        detail = f"{said}; {JSON} is accepted"
        raise ApiError(
            HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "unsupported_media_type", detail, headers={"Accept": JSON}
        )
    content = bytearray()
    async for chunk in request.stream():
        content += chunk
        if len(content) > MAX_BODY_BYTES:
            detail = f"at most {MAX_BODY_BYTES} bytes are accepted"
            raise ApiError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "body_too_large", detail)
    return bytes(content)


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
