"""Hands a request to its endpoint without a comparison with all others, or answers 304 in its place."""

from fastapi.routing import APIRoute, APIRouter
from starlette.requests import Request
from starlette.routing import Match
from starlette.types import Receive, Scope, Send

from service.api.keys.shapes import ByShape
from service.api.tagged import TAGGED, unchanged


class Switchboard:
    """In front of a router whose routes are all its own: finds the route that the router would find.

    What no route takes entirely (unknown paths, other methods, a slash too many) is left to the router.
    """

    def __init__(self, router: APIRouter) -> None:
        self._router = router
        self._routes = ByShape((route.path, route) for route in router.routes if isinstance(route, APIRoute))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request to its endpoint."""
        if scope["type"] == "http" and not scope.get("root_path"):
            for route in self._routes.of(scope["path"]):
                match, found = route.matches(scope)
                if match is Match.FULL:
                    scope.setdefault("router", self._router)
                    scope.update(found)
                    known = None
                    if scope["method"] == "GET" and (tagged := TAGGED.get(route.path)) is not None:
                        known = await unchanged(Request(scope), tagged)
                    await (known or route.handle)(scope, receive, send)
                    return
        await self._router.app(scope, receive, send)
