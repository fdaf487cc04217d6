"""All endpoints with their errors and their description, put on an application."""

from fastapi import FastAPI

from service.api import (
    accuracy,
    enclosures,
    families,
    handlers,
    health,
    jobs,
    solutions,
    trajectory,
    validations,
)
from service.api.documentation import describe


def install(app: FastAPI) -> None:
    """Give ``app`` the endpoints; what they work with is ``app.state.resources``."""
    for resource in (validations, jobs, solutions, trajectory, enclosures, families, accuracy, health):
        app.include_router(resource.router)
    handlers.install(app)

    def openapi() -> dict[str, object]:
        if app.openapi_schema is None:
            app.openapi_schema = describe(app)
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]
