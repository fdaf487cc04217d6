"""Lets pages of chosen origins read answers (CORS); without a setting, none may."""

from http import HTTPStatus

from fastapi import Response
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.dependencies import Resources
from service.settings import origins_in

_MAX_AGE_SECONDS = 600
"""How long a browser may remember what it may send."""
_METHODS = "GET, HEAD, POST, PATCH, DELETE, OPTIONS"
_SENT = (
    "Accept, Authorization, Content-Encoding, Content-Type, Idempotency-Key, If-None-Match, Last-Event-ID,"
    " Prefer, X-Request-ID"
)
# A wildcard would leave out Authorization, and older browsers do not know it.
_SHOWN = (
    "Content-Disposition, ETag, Idempotency-Replayed, Link, Location, Polhode-Deviation, Polhode-Error,"
    " Polhode-Points, Polhode-Points-Done, Polhode-Samples, Preference-Applied, RateLimit, RateLimit-Policy,"
    " Retry-After, Server, X-Request-ID"
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
