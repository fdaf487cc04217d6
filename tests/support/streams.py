"""Streams of events as a client reads them, and answers beside them, on one event loop without sockets."""

import asyncio
import json
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Self

from fastapi import FastAPI

_PATIENCE_SECONDS = 60.0
"""Only a stream that hangs takes so long."""


@dataclass(frozen=True)
class Event:
    name: str
    id: str
    data: bytes

    @property
    def document(self) -> dict:
        return json.loads(self.data)


def _scope(method: str, path: str, headers: Mapping[str, str]) -> dict:
    sent = {"host": "127.0.0.1:8000", **{name.lower(): value for name, value in headers.items()}}
    return {
        "type": "http",
        "asgi": {"version": "3.0", "spec_version": "2.3"},
        "http_version": "1.1",
        "method": method,
        "scheme": "http",
        "path": path,
        "raw_path": path.encode(),
        "query_string": b"",
        "root_path": "",
        "headers": [(name.encode(), value.encode()) for name, value in sent.items()],
        "client": ("127.0.0.1", 1),
        "server": ("127.0.0.1", 8000),
    }


class Stream:
    """An open stream; leaving it disconnects the client. A slow client reads only when it is asked to."""

    def __init__(
        self, app: FastAPI, path: str, *, last_id: str | None = None, is_slow: bool = False, **headers: str
    ) -> None:
        if last_id is not None:
            headers["last-event-id"] = last_id
        self._app, self._scope = app, _scope("GET", path, headers)
        self._parts: asyncio.Queue[bytes | None] = asyncio.Queue()
        self._gone, self._begun, self._may_send = asyncio.Event(), asyncio.Event(), asyncio.Event()
        self._is_slow = is_slow
        self.status, self.headers = 0, dict[str, str]()
        self.comments: list[str] = []
        self._text = b""

    async def __aenter__(self) -> Self:
        self._task = asyncio.create_task(self._app(self._scope, self._receive, self._send))
        await asyncio.wait_for(self._begun.wait(), _PATIENCE_SECONDS)
        return self

    async def __aexit__(self, *_: object) -> None:
        self._gone.set()
        self._may_send.set()
        await asyncio.wait_for(asyncio.gather(self._task, return_exceptions=True), _PATIENCE_SECONDS)

    async def _receive(self) -> dict:
        await self._gone.wait()
        return {"type": "http.disconnect"}

    async def _send(self, message: dict) -> None:
        if message["type"] == "http.response.start":
            self.status = message["status"]
            self.headers = {name.decode(): value.decode() for name, value in message["headers"]}
            return
        self._begun.set()
        self._parts.put_nowait(message.get("body", b""))
        if not message.get("more_body", False):
            self._parts.put_nowait(None)
        if self._is_slow:
            self._may_send.clear()
            await self._may_send.wait()

    async def next(self) -> Event | None:
        """Return the next event, None at the end of the stream."""
        while True:
            part, found, rest = self._text.partition(b"\n\n")
            if found:
                self._text = rest
                if (event := self._parsed(part)) is not None:
                    return event
                continue
            self._may_send.set()
            more = await asyncio.wait_for(self._parts.get(), _PATIENCE_SECONDS)
            if more is None:
                assert self._text == b"", "a stream ends after a whole event"
                return None
            self._text += more

    async def rest(self) -> list[Event]:
        """Return the events to the end of the stream."""
        found = []
        while (event := await self.next()) is not None:
            found.append(event)
        return found

    def _parsed(self, part: bytes) -> Event | None:
        fields: dict[str, str] = {}
        for line in part.decode().split("\n"):
            name, _, value = line.partition(": ")
            if name in ("", ":"):
                self.comments.append(value)
            elif line.startswith(":"):
                self.comments.append(line[1:].strip())
            else:
                assert name not in fields
                fields[name] = value
        if "event" not in fields:
            return None
        return Event(fields["event"], fields["id"], fields["data"].encode())


async def get(app: FastAPI, path: str) -> bytes:
    """Return the body of an answer to GET."""
    async with Stream(app, path) as answer:
        assert answer.status == 200, path
        body = b""
        while (part := await answer._parts.get()) is not None:
            body += part
        return body


@asynccontextmanager
async def started(app: FastAPI) -> AsyncIterator[FastAPI]:
    """Start an application on this event loop, and stop it."""
    async with app.router.lifespan_context(app):
        yield app
