"""Answers in JSON without NaN, or made while they are sent; their headers, path parameters and refusals."""

import json
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from datetime import datetime
from functools import cache
from http import HTTPStatus
from typing import Annotated

from fastapi import Path, Response
from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from service.api.replies.errors import MEDIA_TYPE
from service.schemas.reading.documents import instant_text
from service.schemas.replies.response_model import ResponseModel
from service.versions import version_of

JSON = "application/json"


def json_response(
    model: ResponseModel, *, status: int = HTTPStatus.OK, headers: Mapping[str, str] | None = None
) -> Response:
    """Return a model as JSON.

    Pydantic's and orjson's writers are not used: both silently turn NaN into null, and
    orjson refuses integers beyond 64 bits, which problems may hold.
    """
    return Response(json_content(model), status_code=status, media_type=JSON, headers=headers)


def json_content(model: ResponseModel) -> bytes:
    """Return the bytes of a model as JSON."""
    return json.dumps(model.model_dump(by_alias=True), allow_nan=False, default=_instant).encode()


def _instant(value: object) -> str:
    if isinstance(value, datetime):
        return instant_text(value)
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def refusals(*statuses: int) -> dict[int | str, dict[str, object]]:
    """Return the OpenAPI entries of refusals: these statuses, and 422, which any request can have."""
    schema = {"$ref": "#/components/schemas/ProblemDetailsOut"}
    return {
        status: {
            "description": HTTPStatus(status).phrase,
            "content": {MEDIA_TYPE: {"schema": schema}},
        }
        for status in sorted({*statuses, HTTPStatus.UNPROCESSABLE_ENTITY.value})
    }


JobId = Annotated[str, Path(description="Id of a job.")]
SolutionId = Annotated[str, Path(description="Id of a solution.")]
SweepId = Annotated[str, Path(description="Id of a sweep.")]
AtlasId = Annotated[str, Path(description="Id of an atlas, which is that of its job.")]
AuditId = Annotated[str, Path(description="Id of an audit, which is that of its job.")]


REQUEST_ID = "X-Request-ID"


@cache
def server_name() -> str:
    """Return the value of the Server header."""
    return f"polhode/{version_of('polhode')}"


Compute = Callable[[Callable[[], bytes | None]], Awaitable[bytes | None]]

PART_BYTES = 32768
"""No more is given to a connection at a time; then it is waited until its client has read most of it."""


class PiecedAnswer(StreamingResponse):
    """An answer whose pieces are computed one by one, each when the last one has left.

    Parameters
    ----------
    pieces
        Computes them.
    held
        Bytes that it keeps in memory until it has been sent, about.
    """

    def __init__(
        self, pieces: Iterator[bytes], *, held: int, media_type: str, headers: Mapping[str, str]
    ) -> None:
        super().__init__(_parts(self), media_type=media_type, headers=headers)
        self.held = held
        self.compute: Compute = _at_once
        """Makes the pieces. Where reads have slots, one that waits for its turn is put here."""
        self._pieces: Iterator[bytes] | None = pieces

    def next_piece(self) -> bytes | None:
        """Compute the next piece; None at the end."""
        return None if self._pieces is None else next(self._pieces, None)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send all pieces, as long as the client is there."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            # What they are made of may be large, and is referred to in a circle.
            self._pieces = None


async def _at_once(work: Callable[[], bytes | None]) -> bytes | None:
    return work()


async def _parts(answer: PiecedAnswer) -> AsyncIterator[bytes]:
    while (piece := await answer.compute(answer.next_piece)) is not None:
        for start in range(0, len(piece), PART_BYTES):
            yield piece[start : start + PART_BYTES]


def size_of(answer: Response) -> int:
    """Return the bytes that an answer keeps in memory until it has been sent, about."""
    return answer.held if isinstance(answer, PiecedAnswer) else len(answer.body)
