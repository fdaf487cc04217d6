"""The Accept header (RFC 9110, 12.5.1): which of our formats a client likes best."""

from collections.abc import Sequence
from http import HTTPStatus
from typing import Annotated

from fastapi import Header

from service.api.errors import ApiError

# Not declared: OpenAPI says to ignore a parameter of this name, since each answer lists its media types.
Accept = Annotated[str | None, Header(include_in_schema=False)]
"""The type of an endpoint's parameter that receives what the client accepts; None if it does not say."""


def preferred(offered: Sequence[str], accept: str | None) -> str:
    """Return the media type that the client likes best; the first if it says nothing.

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
        detail = f"formats are {', '.join(offered)}"
        raise ApiError(HTTPStatus.NOT_ACCEPTABLE, "not_acceptable", detail)
    return best


def _quality(media_type: str, accept: str) -> float:
    """Return how much a client likes a media type: the most special entry counts."""
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
