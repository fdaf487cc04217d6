"""Checks a request before authentication, and lets chosen pages of other origins use the API (CORS).

Accepted are the same origin, or one that is named, and an unambiguous length.
"""

from collections.abc import Collection
from http import HTTPStatus
from urllib.parse import urlsplit

from fastapi import Response
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.dependencies import Resources
from service.api.replies.errors import ApiError
from service.settings import origins_in

_SAFE = frozenset({"GET", "HEAD", "OPTIONS", "TRACE"})
_OWN_SITES = frozenset({"same-origin", "none"})
_PORTS = {"http": 80, "https": 443}


def check_origin(method: str, headers: Headers, trusted: Collection[str]) -> None:
    """Refuse state-changing requests from pages of another origin; programs send no such headers.

    Browsers send Sec-Fetch-Site, which is right behind any proxy too. Without it
    (older browsers, plain HTTP to another machine), Origin must have the host and
    port of Host, or be one of ``trusted``.

    Raises
    ------
    ApiError
        403.
    """
    origin, site = headers.get("origin"), headers.get("sec-fetch-site")
    if method in _SAFE or (origin is None and site is None):
        return
    if origin and origin in trusted:
        return
    if site is not None:
        if site in _OWN_SITES:
            return
    elif _is_of_host(origin or "", headers.get("host", "")):
        return
    detail = (
        f"the request was sent by a page of {(origin or 'another origin')[:100]!r}; "
        "accepted are pages of this service, and those that POLHODE_ORIGINS or POLHODE_CORS_ORIGINS names"
    )
    raise ApiError(HTTPStatus.FORBIDDEN, "cross_origin", detail)


def check_length(version: str, headers: Headers) -> None:
    """Refuse a request whose length is ambiguous, against request smuggling (RFC 9112, 6.1 and 11.2).

    Raises
    ------
    ApiError
        400; the connection is closed, since the next bytes may be another client's.
    """
    if "transfer-encoding" not in headers:
        return
    if "content-length" in headers:
        detail = "both Content-Length and Transfer-Encoding were sent; one of them is accepted"
    elif version == "1.0":
        detail = "Transfer-Encoding was sent with HTTP/1.0; it is accepted with HTTP/1.1"
    else:
        return
    raise ApiError(HTTPStatus.BAD_REQUEST, "ambiguous_length", detail, headers={"Connection": "close"})


def _is_of_host(origin: str, host: str) -> bool:
    try:
        page, here = urlsplit(origin), urlsplit(f"//{host}")
        port = _PORTS.get(page.scheme)
        return page.hostname is not None and (page.hostname, page.port or port) == (
            here.hostname,
            here.port or port,
        )
    except ValueError:
        return False


_MAX_AGE_SECONDS = 600
"""How long a browser may remember what it may send."""
_METHODS = "GET, HEAD, POST, PATCH, DELETE, OPTIONS"
_SENT = (
    "Accept, Authorization, Content-Encoding, Content-Type, Idempotency-Key, If-None-Match, Last-Event-ID,"
    " Polhode-Echo, Prefer, X-Request-ID"
)
# A wildcard would leave out Authorization, and older browsers do not know it.
_SHOWN = (
    "Content-Disposition, ETag, Idempotency-Replayed, Link, Location, Polhode-Deviation, Polhode-Echo,"
    " Polhode-Error, Polhode-Points, Polhode-Points-Done, Polhode-Samples, Preference-Applied, RateLimit,"
    " RateLimit-Policy, Retry-After, Server, X-Request-ID"
)


class Sharing:
    """Adds the headers that browsers ask for. Keys are sent by scripts, never by browsers: no credentials."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a preflight, or pass the request on and mark its answer."""
        shared = _shared_with(scope) if scope["type"] == "http" else frozenset[str]()
        if not shared:
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        origin = headers.get("origin")
        allowed = {"Access-Control-Allow-Origin": origin} if origin in shared and origin else {}

        async def send_marked(message: Message) -> None:
            if message["type"] == "http.response.start":
                marked = MutableHeaders(scope=message)
                # Caches must keep apart what is sent to different origins, and to none.
                marked.add_vary_header("Origin")
                marked.update({**allowed, **({"Access-Control-Expose-Headers": _SHOWN} if allowed else {})})
            await send(message)

        if allowed and scope["method"] == "OPTIONS" and "access-control-request-method" in headers:
            answer = Response(
                status_code=HTTPStatus.NO_CONTENT,
                headers={
                    "Access-Control-Allow-Methods": _METHODS,
                    "Access-Control-Allow-Headers": _SENT,
                    "Access-Control-Max-Age": str(_MAX_AGE_SECONDS),
                },
            )
            await answer(scope, receive, send_marked)
            return
        await self._app(scope, receive, send_marked)


def _shared_with(scope: Scope) -> frozenset[str]:
    resources: Resources = scope["app"].state.resources
    return origins_in(resources.settings.cors_origins)
