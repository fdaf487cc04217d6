"""All endpoints with their errors and their description, put on an application."""

from fastapi import FastAPI
from fastapi.routing import APIRoute

from service.api import (
    accuracy,
    docs_page,
    enclosures,
    families,
    handlers,
    health,
    jobs,
    metrics,
    points,
    solutions,
    sweeps,
    trajectory,
    validations,
)
from service.api.access import check_roles
from service.api.documentation import describe
from service.api.observing import Observation
from service.api.security import Guard


def install(app: FastAPI) -> None:
    """Give ``app`` the endpoints; what they work with is ``app.state.resources``."""
    routers = [
        resource.router
        for resource in (
            validations,
            jobs,
            solutions,
            trajectory,
            enclosures,
            sweeps,
            points,
            families,
            accuracy,
            health,
            metrics,
            docs_page,
        )
    ]
    check_roles(routers)
    for router in routers:
        app.include_router(router)
        for route in router.routes:
            if isinstance(route, APIRoute):
                # Clients are generated with these names: short, and the same whatever the path.
                route.operation_id = route.name
    handlers.install(app)
    app.add_middleware(Guard)
    app.add_middleware(Observation)

    def openapi() -> dict[str, object]:
        if app.openapi_schema is None:
            app.openapi_schema = describe(app)
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]
