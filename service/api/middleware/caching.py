"""Gives answers to GET an entity tag, or 304 if the client has them; answers HEAD as GET; encodes answers.

They are encoded as the client accepts, where it pays.
"""

from collections.abc import Callable
from http import HTTPStatus

from anyio import CapacityLimiter, to_thread
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.formats.negotiation import Encoder, encoded, encoder, preferred_coding
from service.api.replies import (
    NO_STORE,
    PART_BYTES,
    REVALIDATE,
    VOLATILE,
    coded,
    matching_tag,
    tag_of_content,
)
from service.cache import Cache

_STATE = "is_head"


class HeadLikeGet:
    """Lets the endpoint of GET answer HEAD, and leaves the body out."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on as GET."""
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self._app(scope, receive, send)
            return

        async def send_head(message: Message) -> None:
            if message["type"] == "http.response.body":
                message = {**message, "body": b""}
            await send(message)

        scope.setdefault("state", {})[_STATE] = True
        inner = {**scope, "method": "GET"}
        try:
            await self._app(inner, receive, send_head)
        finally:
            scope["route"] = inner.get("route")  # which the log and the metrics name


def is_head(request: Request) -> bool:
    """Tell whether only the head of the answer is sent, so that a stream need not be made."""
    return bool(request.scope.get("state", {}).get(_STATE))


_OF_CONTENT = ("content-length", "content-type", "content-encoding", "content-disposition")
"""Headers that describe a body, which 304 does not have (RFC 9110, 15.4.5)."""


class Caching:
    """Adds ETag and Cache-Control where an endpoint has not set them.

    The tags of answers for which arrays are read are set before (:mod:`service.api.tagged`), and most 304
    are answered there. All others are small: their tag is that of their bytes.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and complete the answer."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        await self._app(scope, receive, _TaggedSending(scope, send).send)


class _TaggedSending:
    """One answer. Its start is held back until the first part of its body."""

    def __init__(self, scope: Scope, send: Send) -> None:
        self._is_get, self._path = scope["method"] == "GET", scope["path"]
        self._asked = Headers(scope=scope).get("if-none-match")
        self._send = send
        self._start: Message | None = None
        self._is_over = False

    async def send(self, message: Message) -> None:
        """Send a message of the answer on, completed."""
        if message["type"] == "http.response.start":
            self._start = message
            return
        if self._start is not None:
            start, self._start = self._start, None
            if self._is_known(start, message):
                self._is_over = True
                await self._send(start)
                await self._send({"type": "http.response.body", "body": b""})
                return
            await self._send(start)
        if not self._is_over:
            await self._send(message)

    def _is_known(self, start: Message, first: Message) -> bool:
        """Complete the headers; turn the answer into 304 if the client has it."""
        headers = MutableHeaders(scope=start)
        if start["status"] >= HTTPStatus.BAD_REQUEST or self._path in VOLATILE:
            headers.setdefault("Cache-Control", NO_STORE)
            return False
        if not self._is_get or start["status"] != HTTPStatus.OK:
            return False
        headers.setdefault("Cache-Control", REVALIDATE)
        if "etag" not in headers:
            if first.get("more_body", False):
                return False
            headers["ETag"] = tag_of_content(first.get("body", b""))
        tag = headers["etag"]
        known = tag if (self._asked or "").strip() == "*" else matching_tag(self._asked, tag)
        if known is None:
            return False
        start["status"], headers["ETag"] = HTTPStatus.NOT_MODIFIED.value, known
        for name in _OF_CONTENT:
            del headers[name]
        return True


LEAST_BYTES = 1024
"""Below, an answer fits into one packet anyway."""
PAYS = 0.9
"""An answer is encoded if this much of it, or less, is left."""
_SAMPLE_BYTES = 65536
"""Bytes that are encoded first: the rest of a larger answer is encoded only if this pays."""
_KEPT_BYTES = 16_000_000
"""Whole answers in codings that are kept: a tag names one content, so that none gets old."""
_INLINE_BYTES = 65536
"""More is encoded in a thread, not on the event loop."""
_THREADS = 2
"""For that only: those of the endpoints are for endpoints."""
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
        self._threads, self._kept = CapacityLimiter(_THREADS), Cache[str, bytes](_KEPT_BYTES, len)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and encode its answer."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        coding = preferred_coding(Headers(scope=scope).get("accept-encoding"))
        await self._app(scope, receive, _EncodedSending(coding, send, self._threads, self._kept).send)


class _EncodedSending:
    """One answer. Its start is held back until the first part of its body is there to be tried."""

    def __init__(
        self, coding: str | None, send: Send, threads: CapacityLimiter, kept: Cache[str, bytes]
    ) -> None:
        self._coding, self._send, self._threads, self._kept = coding, send, threads, kept
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
        await self._send_in_parts(message)

    async def _send_in_parts(self, message: Message) -> None:
        """Send each part of the body when the one before has left, so that no slow client fills memory."""
        body = message.get("body", b"")
        for start in range(0, len(body) or 1, PART_BYTES):
            stop = start + PART_BYTES
            more = stop < len(body) or message.get("more_body", False)
            await self._send({**message, "body": body[start:stop], "more_body": more})

    async def _begin(self, start: Message, first: Message) -> Message:
        """Return the first part as it is sent, and complete the headers."""
        headers, body = MutableHeaders(scope=start), bytes(first.get("body", b""))
        is_whole = not first.get("more_body", False)
        if self._coding is None or not _may_pay(start["status"], headers, body, is_whole):
            return first
        tag = coded(headers["etag"], self._coding) if "etag" in headers else None
        known = self._kept.get(tag) if tag is not None and is_whole else None
        if known is not None:
            return _whole(headers, known, first, self._coding)
        sample = await self._in_time(encoded, body[:_SAMPLE_BYTES], self._coding)
        # A stream may begin with little, a schema or a line of names, that tells nothing of the rest.
        if len(body) >= LEAST_BYTES and len(sample) > PAYS * min(len(body), _SAMPLE_BYTES):
            return first
        if is_whole:
            content = sample if len(body) <= _SAMPLE_BYTES else await self._all(tag, body, self._coding)
            return _whole(headers, content, first, self._coding)
        headers["Content-Encoding"] = self._coding
        if tag is not None:
            headers["ETag"] = tag
        del headers["Content-Length"]
        self._encoder = encoder(self._coding)
        return await self._encoded(first, self._encoder)

    async def _all(self, tag: str | None, body: bytes, coding: str) -> bytes:
        """Return a whole answer in a coding; it is kept, since static files are asked for again and again."""
        if tag is None:
            return await self._in_time(encoded, body, coding)
        return await self._in_time(
            lambda body: self._kept.get_or_make(tag, lambda: encoded(body, coding)), body
        )

    async def _encoded(self, message: Message, encoder: Encoder) -> Message:
        body = message.get("body", b"")
        content = await self._in_time(encoder.piece, body) if body else b""
        if not message.get("more_body", False):
            content += encoder.end()
        return {**message, "body": content}

    async def _in_time(self, work: Callable[..., bytes], body: bytes, *further: str) -> bytes:
        """Return ``work`` of a body without keeping other requests from the event loop for long."""
        if len(body) <= _INLINE_BYTES:
            return work(body, *further)
        return await to_thread.run_sync(work, body, *further, limiter=self._threads)


def _whole(headers: MutableHeaders, content: bytes, first: Message, coding: str) -> Message:
    """Return a whole answer in a coding, and complete its headers."""
    headers["Content-Encoding"], headers["Content-Length"] = coding, str(len(content))
    if "etag" in headers:
        headers["ETag"] = coded(headers["etag"], coding)
    return {**first, "body": content}


def _may_pay(status: int, headers: Headers, body: bytes, is_whole: bool) -> bool:
    if status < HTTPStatus.OK or "content-encoding" in headers:
        return False
    kind = headers.get("content-type", "").partition(";")[0]
    return kind not in _NEVER and (not is_whole or len(body) >= LEAST_BYTES)
