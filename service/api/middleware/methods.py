"""Answers HEAD wherever there is GET."""

from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

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
