"""The OpenAPI document: request bodies are read by ourselves, hence described here."""

from collections.abc import Mapping
from importlib.metadata import version

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic.json_schema import models_json_schema

from service.api.access import ACCESS, OPEN
from service.api.responses import refusals
from service.schemas.problem_document import ProblemDetailsOut
from service.schemas.sections import ProblemIn, ValidationIn
from service.schemas.sweeps import SweepIn

_SCHEME = "key"
_TEMPLATE = "#/components/schemas/{model}"

DESCRIPTION = (
    "Motions of a rigid body about a fixed point with the angular velocity in a principal plane: "
    "verdicts on potentials, motions by quadrature or integration, and a database of solutions. "
    'Numbers may be JSON numbers or strings with an exact value: "17/10", "1e-12".'
)


def request_body(model: str, examples: Mapping[str, object], *, several: bool = False) -> dict[str, object]:
    """Return the OpenAPI extension of an endpoint whose JSON body is ``model``, or ``several`` of them."""
    schema: dict[str, object] = {"$ref": _TEMPLATE.format(model=model)}
    if several:
        schema = {"oneOf": [schema, {"type": "array", "items": schema}]}
    content = {"application/json": {"schema": schema, "examples": dict(examples)}}
    return {"requestBody": {"required": True, "content": content}}


def describe(app: FastAPI) -> dict[str, object]:
    """Return the OpenAPI document of ``app``, with the models of bodies and refusals."""
    document: dict[str, object] = get_openapi(
        title="polhode", version=version("polhode"), description=DESCRIPTION, routes=app.routes
    )
    _, definitions = models_json_schema(
        [
            (ProblemIn, "validation"),
            (ValidationIn, "validation"),
            (SweepIn, "validation"),
            (ProblemDetailsOut, "serialization"),
        ],
        ref_template=_TEMPLATE,
    )
    # Refusals leave out what does not apply to them.
    definitions["$defs"]["ProblemDetailsOut"]["required"] = ["type", "title", "status", "detail"]
    components = document.setdefault("components", {})
    assert isinstance(components, dict)
    schemas = components.setdefault("schemas", {})
    schemas.update(definitions["$defs"])
    components["schemas"] = dict(sorted(schemas.items()))
    components["securitySchemes"] = {
        _SCHEME: {
            "type": "http",
            "scheme": "bearer",
            "description": "A key made by `polhode keys create`. Needed as soon as there is any key.",
        }
    }
    _describe_access(document)
    return document


def _describe_access(document: Mapping[str, object]) -> None:
    """Say of every operation which role it needs, and that it can be refused for want of it."""
    paths = document["paths"]
    assert isinstance(paths, dict)
    further = {str(status): entry for status, entry in refusals(401, 403, 429).items()}
    for path, operations in paths.items():
        for method, operation in operations.items():
            role = ACCESS[path][method.upper()]
            if role is OPEN:
                operation["security"] = []
                continue
            operation["security"] = [{}, {_SCHEME: [role.value]}]
            operation["responses"] = dict(sorted({**further, **operation["responses"]}.items()))
