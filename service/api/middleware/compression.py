"""Encodes answers as the client accepts, where it pays."""

from collections.abc import Callable
from http import HTTPStatus

from anyio import to_thread
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.formats.codings import Encoder, encoded, encoder, preferred_coding
from service.api.replies.conditional import coded

LEAST_BYTES = 1024
"""Below, an answer fits into one packet anyway."""
PAYS = 0.9
"""An answer is encoded if this much of it, or less, is left."""
_SAMPLE_BYTES = 65536
"""What is tried first: of an answer that is larger, the rest is encoded only if this pays."""
_INLINE_BYTES = 65536
"""More is encoded in a thread, not on the event loop."""
_NEVER = (
    "text/event-stream",
    "application/vnd.apache.parquet",
    "application/x-npz",
    "application/zip",
    "image/png",
)
"""Events must not wait for others; the rest is encoded already, or hardly gets smaller."""


class Compression:
    """Chooses a coding by Accept-Encoding. Answers in a coding are other representations, with other tags."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and encode its answer."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        coding = preferred_coding(Headers(scope=scope).get("accept-encoding"))
        await self._app(scope, receive, _Answer(coding, send).send)


class _Answer:
    """One answer. Its start is held back until the first part of its body is there to be tried."""

    def __init__(self, coding: str | None, send: Send) -> None:
        self._coding, self._send = coding, send
        self._start: Message | None = None
        self._encoder: Encoder | None = None

    async def send(self, message: Message) -> None:
        """Send a message of the answer on, encoded."""
        if message["type"] == "http.response.start":
            MutableHeaders(scope=message).add_vary_header("Accept-Encoding")
            self._start = message
            return
        if self._start is not None:
            start, self._start = self._start, None
            message = await self._begin(start, message)
            await self._send(start)
        elif self._encoder is not None:
            message = await self._encoded(message, self._encoder)
        await self._send(message)

    async def _begin(self, start: Message, first: Message) -> Message:
        """Return the first part as it is sent, and complete the headers."""
        headers, body = MutableHeaders(scope=start), bytes(first.get("body", b""))
        is_whole = not first.get("more_body", False)
        if self._coding is None or not _may_pay(start["status"], headers, body, is_whole):
            return first
        sample = await _in_time(encoded, body[:_SAMPLE_BYTES], self._coding)
        # A stream may begin with little, a schema or a line of names, that tells nothing of the rest.
        if len(body) >= LEAST_BYTES and len(sample) > PAYS * min(len(body), _SAMPLE_BYTES):
            return first
        headers["Content-Encoding"] = self._coding
        if "etag" in headers:
            headers["ETag"] = coded(headers["etag"], self._coding)
        if is_whole:
            is_done = len(body) <= _SAMPLE_BYTES
            content = sample if is_done else await _in_time(encoded, body, self._coding)
            headers["Content-Length"] = str(len(content))
            return {**first, "body": content}
        del headers["Content-Length"]
        self._encoder = encoder(self._coding)
        return await self._encoded(first, self._encoder)

    async def _encoded(self, message: Message, encoder: Encoder) -> Message:
        body = message.get("body", b"")
        content = await _in_time(encoder.piece, body) if body else b""
        if not message.get("more_body", False):
            content += encoder.end()
        return {**message, "body": content}


async def _in_time(work: Callable[..., bytes], body: bytes, *further: str) -> bytes:
    """Return ``work`` of a body without keeping other requests from the event loop for long."""
    if len(body) <= _INLINE_BYTES:
        return work(body, *further)
    return await to_thread.run_sync(work, body, *further)


def _may_pay(status: int, headers: Headers, body: bytes, is_whole: bool) -> bool:
    if status < HTTPStatus.OK or "content-encoding" in headers:
        return False
    kind = headers.get("content-type", "").partition(";")[0]
    return kind not in _NEVER and (not is_whole or len(body) >= LEAST_BYTES)
