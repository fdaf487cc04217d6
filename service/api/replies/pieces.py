"""Answers that are made while they are sent, a piece at a time."""

from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping

from fastapi.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send

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
        """Makes the pieces. Where reads have places, one that waits for its turn is put here."""
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
