"""The OpenAPI document: request bodies are read by ourselves, hence described here."""

from collections.abc import Mapping
from importlib.metadata import version

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic.json_schema import models_json_schema

from service.schemas.problem_document import ProblemDetailsOut
from service.schemas.sections import ProblemIn, ValidationIn

_TEMPLATE = "#/components/schemas/{model}"

DESCRIPTION = (
    "Motions of a rigid body about a fixed point with the angular velocity in a principal plane: "
    "verdicts on potentials, motions by quadrature or integration, and a database of solutions. "
    'Numbers may be JSON numbers or strings with an exact value: "17/10", "1e-12".'
)


def request_body(model: str, examples: Mapping[str, object]) -> dict[str, object]:
    """Return the OpenAPI extension of an endpoint whose JSON body is ``model``."""
    schema = {"$ref": _TEMPLATE.format(model=model)}
    content = {"application/json": {"schema": schema, "examples": dict(examples)}}
    return {"requestBody": {"required": True, "content": content}}


def describe(app: FastAPI) -> dict[str, object]:
    """Return the OpenAPI document of ``app``, with the models of bodies and refusals."""
    document: dict[str, object] = get_openapi(
        title="polhode", version=version("polhode"), description=DESCRIPTION, routes=app.routes
    )
    _, definitions = models_json_schema(
        [(ProblemIn, "validation"), (ValidationIn, "validation"), (ProblemDetailsOut, "serialization")],
        ref_template=_TEMPLATE,
    )
    # Refusals leave out what does not apply to them.
    definitions["$defs"]["ProblemDetailsOut"]["required"] = ["type", "title", "status", "detail"]
    components = document.setdefault("components", {})
    assert isinstance(components, dict)
    schemas = components.setdefault("schemas", {})
    schemas.update(definitions["$defs"])
    components["schemas"] = dict(sorted(schemas.items()))
    return document
