"""Gives every request an id, and times, counts and logs it."""

import logging
import re
import time

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.dependencies import Resources
from service.api.replies import REQUEST_ID, server_name
from service.logs import about
from service.storage.database.rows import new_id

logger = logging.getLogger(__name__)

RATE = "rate"
"""In the state of a request: the headers that tell of the limit of requests."""
ECHO = "Polhode-Echo"
"""Header that is returned as it was sent. Ids do not tell whose an answer is: proxies set them."""

_SANE_ID = re.compile(r"[A-Za-z0-9._:-]{1,128}")
_ABSOLUTE = re.compile(r"https?://(?P<authority>[^/?#@\s]+)", re.ASCII | re.IGNORECASE)
_METHODS = frozenset({"GET", "POST", "PUT", "PATCH", "DELETE", "HEAD", "OPTIONS"})
_QUIET = ("/livez", "/readyz", "/metrics")
"""Polled often by machines, so logged less."""


class Observation:
    """Our outermost middleware."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and record the answer."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        _read_absolute_form(scope)
        sent = Headers(scope=scope)
        request_id = _id_of(sent)
        scope.setdefault("state", {})["request_id"] = request_id
        if _SANE_ID.fullmatch(echo := sent.get(ECHO, "")):
            scope["state"][ECHO] = {ECHO: echo}
        status = 500  # an unhandled error: an outer layer makes the answer
        began = time.perf_counter()

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message).update(standing_headers(scope))
            await send(message)

        with about(request_id=request_id):
            try:
                await self._app(scope, receive, send_with_id)
            finally:
                _observe(scope, status, time.perf_counter() - began)


def _read_absolute_form(scope: Scope) -> None:
    """Read a target such as ``http://host/v1/jobs``, whose authority replaces Host (RFC 9112, 3.2.2)."""
    found = _ABSOLUTE.match(scope["path"])
    if found is None:
        return
    scope["path"] = scope["path"][found.end() :] or "/"
    raw = scope.get("raw_path") or b""
    scope["raw_path"] = raw[found.end() :] or b"/"
    headers = [(name, value) for name, value in scope["headers"] if name != b"host"]
    scope["headers"] = [*headers, (b"host", found["authority"].encode())]


def standing_headers(scope: Scope) -> dict[str, str]:
    """Return the headers of every answer: who answers to which request, and what the rate limit leaves."""
    state = scope.get("state", {})
    request_id = state.get("request_id")
    named = {} if request_id is None else {REQUEST_ID: request_id}
    return {"Server": server_name(), **named, **state.get(ECHO, {}), **state.get(RATE, {})}


def id_of(request: Request) -> str | None:
    """Return the id of the request, if it has one yet."""
    found = request.scope.get("state", {}).get("request_id")
    return found if isinstance(found, str) else None


def _id_of(headers: Headers) -> str:
    sent = headers.get(REQUEST_ID, "")
    return sent if _SANE_ID.fullmatch(sent) else new_id()


def _observe(scope: Scope, status: int, seconds: float) -> None:
    method = scope["method"] if scope["method"] in _METHODS else "other"
    # The route's template, not the path: otherwise every id or unknown path would be a metric of its own.
    route = getattr(scope.get("route"), "path", "none")
    resources: Resources = scope["app"].state.resources
    resources.metrics.observe(method, route, status, seconds)
    level = logging.DEBUG if scope["path"] in _QUIET else logging.INFO
    fields = {"method": method, "path": scope["path"], "status": status, "seconds": round(seconds, 6)}
    logger.log(level, "request", extra={"fields": fields})
