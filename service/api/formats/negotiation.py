"""Chooses the answer's format by the parameter ``format`` or the Accept header (RFC 9110, 12.5.1)."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from http import HTTPStatus
from typing import Annotated

from fastapi import Header

from service.api.queries.format_names import FormatName
from service.api.replies.errors import ApiError

JSON, CSV, NPZ = "application/json", "text/csv", "application/x-npz"
NDJSON, ARROW = "application/x-ndjson", "application/vnd.apache.arrow.stream"
PARQUET = "application/vnd.apache.parquet"
MEDIA_TYPES: Mapping[FormatName, str] = {
    "json": JSON,
    "csv": CSV,
    "ndjson": NDJSON,
    "npz": NPZ,
    "arrow": ARROW,
    "parquet": PARQUET,
}
_LONGEST_KEPT = 256
"""Longer Accept headers are read each time, so that no client fills the memory."""
_ENDINGS = {name: name for name in MEDIA_TYPES} | {"arrow": "arrows"}

# Not in the schema: OpenAPI ignores a parameter named Accept, since each answer lists its media types.
Accept = Annotated[str | None, Header(include_in_schema=False)]
"""The type of an endpoint's parameter that receives the Accept header; None if there is none."""


def chosen(name: FormatName | None, accept: str | None) -> str:
    """Return the media type of a format that is asked for by name, or else by the Accept header."""
    return preferred(list(MEDIA_TYPES.values()), accept) if name is None else MEDIA_TYPES[name]


def named_file(stem: str, media_type: str) -> dict[str, str]:
    """Return the header by which clients name the file; JSON is still shown by browsers."""
    ending = next(_ENDINGS[name] for name, kind in MEDIA_TYPES.items() if kind == media_type)
    shown = "inline" if media_type == JSON else "attachment"
    return {"Content-Disposition": f'{shown}; filename="{stem}.{ending}"'}


def preferred(offered: Sequence[str], accept: str | None) -> str:
    """Return the media type that the client prefers; the first one without a header.

    Raises
    ------
    ApiError
        406 if it accepts none of them.
    """
    header = accept or "*/*"
    find = _best if len(header) <= _LONGEST_KEPT else _best.__wrapped__
    best = find(tuple(offered), header)
    if best is None:
        detail = f"accepted formats are {', '.join(offered)}"
        raise ApiError(HTTPStatus.NOT_ACCEPTABLE, "not_acceptable", detail)
    return best


@lru_cache(maxsize=256)  # clients send the same few again and again
def _best(offered: tuple[str, ...], accept: str) -> str | None:
    best, best_quality = None, 0.0
    for media_type in offered:
        quality = _quality(media_type, accept)
        if quality > best_quality:
            best, best_quality = media_type, quality
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
            found, quality = rank, weight_of(parameters)
    return quality


def weight_of(parameters: list[str]) -> float:
    """Return the quality value among the parameters of an entry; 1 without one, 0 if it cannot be read."""
    for parameter in parameters:
        name, _, value = parameter.partition("=")
        if name.strip() == "q":
            try:
                weight = float(value)
            except ValueError:
                return 0.0
            return weight if 0.0 <= weight <= 1.0 else 0.0
    return 1.0
