"""Gives answers to GET an entity tag, or 304 if the client has them already, and answers HEAD as GET."""

from http import HTTPStatus

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.replies.responses import (
    NO_STORE,
    REVALIDATE,
    VOLATILE,
    matching_tag,
    tag_of_content,
)

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
        await self._app(scope, receive, _Answer(scope, send).send)


class _Answer:
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
