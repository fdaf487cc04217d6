"""A request reaches the endpoint that the router's own search in order would find."""

import itertools

import pytest
from fastapi import FastAPI
from fastapi.routing import APIRoute
from starlette.routing import Match

from service.api.keys.access import ACCESS, ByShape
from service.api.routing import install

WORDS = ("x", "facets", "statistics", "jobs", "01a1fcba-3232-7921-abd1-05ca72abad77")
PATHS = sorted(
    {
        "/".join(parts)
        for template in ACCESS
        for parts in itertools.product(
            *(WORDS if part.startswith("{") else (part,) for part in template.split("/"))
        )
    }
    | {"/", "/v1", "/v1/", "/v1/jobs/", "//livez", "/livez/", "/v1/solutions/a/b/c", "/v1/nothing"}
)


@pytest.fixture(scope="module")
def routes():
    app = FastAPI()
    install(app)
    return [route for route in app.router.routes if isinstance(route, APIRoute)]


def scope_of(method, path):
    return {"type": "http", "method": method, "path": path, "headers": []}


@pytest.mark.parametrize("method", ["GET", "POST", "DELETE"])
def test_the_first_route_of_the_right_shape_is_the_first_of_all(routes, method):
    by_shape = ByShape((route.path, route) for route in routes)
    found = 0
    for path in PATHS:
        wanted = next((r for r in routes if r.matches(scope_of(method, path))[0] is Match.FULL), None)
        chosen = next(
            (r for r in by_shape.of(path) if r.matches(scope_of(method, path))[0] is Match.FULL), None
        )
        assert chosen is wanted, path
        found += chosen is not None
    assert found > 0


def test_no_template_has_a_parameter_where_shapes_spell_the_path_out(routes):
    for route in routes:
        assert "{" not in "/".join(route.path.split("/")[:3]), route.path
        assert ":path}" not in route.path
