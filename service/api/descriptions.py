"""Adds request bodies, roles and refusals to the OpenAPI document, which FastAPI does not see."""

from collections.abc import Mapping, Sequence

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic.json_schema import models_json_schema

from service.api.examples import describe_examples
from service.api.keys.access import ACCESS, OPEN
from service.api.links import describe_links
from service.api.replies.conditional import VOLATILE
from service.api.replies.responses import refusals
from service.schemas.atlas.reading import AtlasIn
from service.schemas.problem.documents import AuditIn, JobIn, ValidationIn
from service.schemas.reading.marks_in import MarksPatchIn
from service.schemas.replies.job import ProblemDetailsOut
from service.schemas.sweep.reading import SweepIn
from service.versions import version_of

_SCHEME = "key"
_TEMPLATE = "#/components/schemas/{model}"

DESCRIPTION = (
    "Motions of a rigid body about a fixed point with the angular velocity in a principal plane: "
    "verdicts on potentials, motions by quadrature or integration, and a database of solutions. "
    'Numbers may be JSON numbers or strings with an exact value: "17/10", "1e-12".'
)


_IF_NONE_MATCH = {
    "name": "If-None-Match",
    "in": "header",
    "required": False,
    "description": "The `ETag` of an earlier answer: 304 without a body if nothing has changed since.",
    "schema": {"type": "string"},
}
_EVENT_STREAM = "text/event-stream"
_NOT_MODIFIED = {"description": "The client has the current answer already."}

_REFUSAL = {
    "type": "urn:polhode:problem:invalid_problem",
    "title": "The document is not a valid problem",
    "status": 422,
    "detail": "/body/A: 0 is not positive; a moment of inertia is > 0",
    "errors": [
        {
            "pointer": "/body/A",
            "code": "invalid_inertia",
            "message": "0 is not positive; a moment of inertia is > 0",
        }
    ],
    "request_id": "019f0000-0000-7000-8000-000000000000",
}


def request_body(
    model: str,
    examples: Mapping[str, object],
    *,
    several: bool = False,
    required: bool = True,
    media_types: Sequence[str] = ("application/json",),
) -> dict[str, object]:
    """Return the OpenAPI extension of an endpoint whose JSON body is ``model``, or ``several`` of them."""
    schema: dict[str, object] = {"$ref": _TEMPLATE.format(model=model)}
    if several:
        schema = {"oneOf": [schema, {"type": "array", "items": schema}]}
    content = {name: {"schema": schema, "examples": dict(examples)} for name in media_types}
    return {"requestBody": {"required": required, "content": content}}


def describe(app: FastAPI) -> dict[str, object]:
    """Return the OpenAPI document of ``app``, with the models of bodies and refusals."""
    document: dict[str, object] = get_openapi(
        title="polhode", version=version_of("polhode"), description=DESCRIPTION, routes=app.routes
    )
    _, definitions = models_json_schema(
        [
            (JobIn, "validation"),
            (MarksPatchIn, "validation"),
            (ValidationIn, "validation"),
            (AtlasIn, "validation"),
            (AuditIn, "validation"),
            (SweepIn, "validation"),
            (ProblemDetailsOut, "serialization"),
        ],
        ref_template=_TEMPLATE,
    )
    _describe_refusals(definitions["$defs"])
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
    _describe_conditions(document)
    paths = document["paths"]
    assert isinstance(paths, dict)
    describe_links(paths)
    describe_examples(document)
    return document


def _describe_refusals(schemas: dict[str, dict[str, object]]) -> None:
    """Add what pydantic cannot express: required fields of refusals, and refusals inside a list's answer."""
    problem = schemas["ProblemDetailsOut"]
    problem["required"] = ["type", "title", "status", "detail"]
    problem["examples"] = [_REFUSAL]
    properties = schemas["JobItemOut"]["properties"]
    assert isinstance(properties, dict)
    refusal = {"$ref": _TEMPLATE.format(model="ProblemDetailsOut")}
    properties["problem"] = {
        "anyOf": [refusal, {"type": "null"}],
        "description": properties["problem"]["description"],
    }


def _describe_access(document: Mapping[str, object]) -> None:
    """Add to every operation the role it needs, and the refusals common to all."""
    paths = document["paths"]
    assert isinstance(paths, dict)
    for_all = {str(status): entry for status, entry in refusals(500).items()}
    with_keys = {str(status): entry for status, entry in refusals(401, 403, 429, 503).items()}
    for path, operations in paths.items():
        for method, operation in operations.items():
            role = ACCESS[path][method.upper()]
            further = for_all if role is OPEN else {**for_all, **with_keys}
            operation["security"] = [] if role is OPEN else [{}, {_SCHEME: [role.value]}]
            operation["responses"] = dict(sorted({**further, **operation["responses"]}.items()))


def _describe_conditions(document: Mapping[str, object]) -> None:
    """Add to every GET whose answer has a tag how to ask again."""
    paths = document["paths"]
    assert isinstance(paths, dict)
    for path, operations in paths.items():
        if "get" not in operations or path in VOLATILE:
            continue
        operation = operations["get"]
        if _EVENT_STREAM in operation["responses"]["200"]["content"]:
            continue  # has no tag: it is never the same
        operation.setdefault("parameters", []).append(_IF_NONE_MATCH)
        operation["responses"] = dict(sorted({**operation["responses"], "304": _NOT_MODIFIED}.items()))
