"""Registers all endpoints, error handlers and the OpenAPI description on an application.

A request reaches its endpoint without a comparison with all other paths.
"""

from functools import cache
from typing import Any  # parts of the OpenAPI document

from fastapi import FastAPI, Request, Response
from fastapi.responses import JSONResponse
from fastapi.routing import APIRoute, APIRouter
from starlette.routing import Match
from starlette.types import Receive, Scope, Send

from service.api.descriptions import describe
from service.api.keys.access import ByShape, check_roles
from service.api.middleware import error_handlers
from service.api.middleware.caching import Caching, Compression, HeadLikeGet
from service.api.middleware.heavy_answers import FilesInTurns
from service.api.middleware.observing import Observation
from service.api.middleware.security import Guard, Sharing
from service.api.replies import tag_of_content
from service.api.routes import (
    analysis,
    atlases,
    audits,
    changes,
    events,
    installation,
    jobs,
    points,
    solutions,
    studies,
    sweeps,
    trajectory,
    validations,
)
from service.api.tagged import TAGGED, unchanged
from service.dashboard import routes as dashboard


class FastRouter:
    """Finds the route that a router would find, sooner, where all routes are the router's own.

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


def install(app: FastAPI) -> None:
    """Register the endpoints on ``app``; they use ``app.state.resources``."""
    routers = [
        resource.router
        for resource in (
            validations,
            atlases,
            analysis,  # before those of single jobs and solutions, whose paths match its own
            jobs,
            solutions,
            trajectory,
            audits,
            sweeps,
            points,
            studies,
            installation,
            events,
            changes,
            dashboard,
        )
    ]
    routers.append(solutions.by_problem)
    check_roles(routers)
    for router in routers:
        # As they are: routers inside routers would be searched twice for each request.
        app.router.routes.extend(router.routes)
        for route in router.routes:
            if isinstance(route, APIRoute):
                # Generated clients use these names: short, and independent of the path.
                route.operation_id = route.name
    app.router.middleware_stack = FastRouter(app.router)
    error_handlers.install(app)
    # From the inside out: each sees the answers of those before it.
    app.add_middleware(Guard)
    app.add_middleware(Caching)
    app.add_middleware(Compression)
    app.add_middleware(HeadLikeGet)
    app.add_middleware(Sharing)
    app.add_middleware(FilesInTurns)
    app.add_middleware(Observation)

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = describe(app)
        return app.openapi_schema

    @cache
    def written() -> tuple[bytes, str]:
        content = JSONResponse(app.openapi()).body
        return bytes(content), tag_of_content(bytes(content))

    async def show_document(_: Request) -> Response:
        content, tag = written()
        return Response(content, media_type="application/json", headers={"ETag": tag})

    app.openapi = openapi  # type: ignore[method-assign]
    # In place of FastAPI's own, which writes the document, a megabyte, for each request.
    app.add_route("/openapi.json", show_document, include_in_schema=False)
