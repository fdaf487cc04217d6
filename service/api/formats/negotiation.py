"""Chooses the answer's format by the Accept header (RFC 9110, 12.5.1)."""

from collections.abc import Sequence
from http import HTTPStatus
from typing import Annotated

from fastapi import Header

from service.api.replies.errors import ApiError

# Not in the schema: OpenAPI ignores a parameter named Accept, since each answer lists its media types.
Accept = Annotated[str | None, Header(include_in_schema=False)]
"""The type of an endpoint's parameter that receives the Accept header; None if there is none."""


def preferred(offered: Sequence[str], accept: str | None) -> str:
    """Return the media type that the client prefers; the first one without a header.

    Raises
    ------
    ApiError
        406 if it accepts none of them.
    """
    best, best_quality = None, 0.0
    for media_type in offered:
        quality = _quality(media_type, accept or "*/*")
        if quality > best_quality:
            best, best_quality = media_type, quality
    if best is None:
        detail = f"accepted formats are {', '.join(offered)}"
        raise ApiError(HTTPStatus.NOT_ACCEPTABLE, "not_acceptable", detail)
    return best


def _quality(media_type: str, accept: str) -> float:
    """Return the quality value of a media type, by the most specific matching entry."""
    kind = media_type.partition("/")[0]
    ranks = {"*/*": 1, f"{kind}/*": 2, media_type: 3}
    found, quality = 0, 0.0
    for entry in accept.split(","):
        name, *parameters = (part.strip().lower() for part in entry.split(";"))
        rank = ranks.get(name, 0)
        if rank > found:
            found, quality = rank, _weight(parameters)
    return quality


def _weight(parameters: list[str]) -> float:
    for parameter in parameters:
        name, _, value = parameter.partition("=")
        if name.strip() == "q":
            try:
                weight = float(value)
            except ValueError:
                return 0.0
            return weight if 0.0 <= weight <= 1.0 else 0.0
    return 1.0
