"""Adds to the OpenAPI document what FastAPI does not see: bodies, roles, refusals, examples, links."""

import json
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any  # parts of a JSON document

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic.json_schema import models_json_schema

from service.api.keys.access import ACCESS, OPEN
from service.api.replies import MEDIA_TYPE, VOLATILE, ApiError, refusals
from service.schemas.atlas.documents import AtlasIn
from service.schemas.problem.documents import AuditIn, JobIn, ValidationIn
from service.schemas.problem.sections import MarksPatchIn
from service.schemas.reading.documents import Document, Fault
from service.schemas.replies.job import ProblemDetailsOut
from service.schemas.study.reading import MODELS as STUDIES
from service.schemas.sweep.reading import SweepIn
from service.versions import version_of

Part = Mapping[str, Any]
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
_NOT_MODIFIED = {"description": "The client has the current answer already."}


def request_body(
    model: str,
    examples: Document,
    *,
    several: bool = False,
    required: bool = True,
    media_types: Sequence[str] = ("application/json",),
) -> dict[str, Any]:
    """Return the OpenAPI extension of an endpoint whose JSON body is ``model``, or ``several`` of them."""
    schema: dict[str, object] = {"$ref": _TEMPLATE.format(model=model)}
    if several:
        schema = {"oneOf": [schema, {"type": "array", "items": schema}]}
    content = {name: {"schema": schema, "examples": dict(examples)} for name in media_types}
    return {"requestBody": {"required": required, "content": content}}


def describe(app: FastAPI) -> dict[str, Any]:
    """Return the OpenAPI document of ``app``, with the models of bodies and refusals."""
    document: dict[str, Any] = get_openapi(
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
            *((model, "validation") for model in STUDIES.values()),
            (ProblemDetailsOut, "serialization"),
        ],
        ref_template=_TEMPLATE,
    )
    _describe_refusals(definitions["$defs"])
    components = document.setdefault("components", {})
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
    describe_links(document["paths"])
    describe_examples(document)
    return document


def _describe_refusals(schemas: dict[str, dict[str, Any]]) -> None:
    """Add what pydantic cannot express: required fields of refusals, and refusals inside a list's answer."""
    problem = schemas["ProblemDetailsOut"]
    problem["required"] = ["type", "title", "status", "detail"]
    problem["examples"] = [_shown(REFUSALS[422])]
    properties = schemas["JobItemOut"]["properties"]
    refusal = {"$ref": _TEMPLATE.format(model="ProblemDetailsOut")}
    properties["problem"] = {
        "anyOf": [refusal, {"type": "null"}],
        "description": properties["problem"]["description"],
    }


def _describe_access(document: Part) -> None:
    """Add to every operation the role it needs, and the refusals common to all."""
    for_all = {str(status): entry for status, entry in refusals(500).items()}
    with_keys = {str(status): entry for status, entry in refusals(401, 403, 429, 503).items()}
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            role = ACCESS[path][method.upper()]
            further = for_all if role is OPEN else {**for_all, **with_keys}
            operation["security"] = [] if role is OPEN else [{}, {_SCHEME: [role.value]}]
            operation["responses"] = dict(sorted({**further, **operation["responses"]}.items()))


def _describe_conditions(document: Part) -> None:
    """Add to every GET whose answer has a tag how to ask again."""
    for path, operations in document["paths"].items():
        if "get" not in operations or path in VOLATILE:
            continue
        operation = operations["get"]
        if "text/event-stream" in operation["responses"]["200"]["content"]:
            continue  # has no tag: it is never the same
        operation.setdefault("parameters", []).append(_IF_NONE_MATCH)
        operation["responses"] = dict(sorted({**operation["responses"], "304": _NOT_MODIFIED}.items()))


RECORDED = Path(__file__).with_name("examples.json")
"""``{operation id: {status: {media type: {name: answer}}}}``, as a service answered."""
_PLACE = "#/components/examples/"

_FAULT = Fault("/body/A", "invalid_inertia", "0 is not positive; a moment of inertia is > 0")
REFUSALS: Mapping[int, ApiError] = {
    error.status: error
    for error in (
        ApiError(400, "invalid_json", "line 1, column 9: expected a value"),
        ApiError(401, "key_missing", "send a key as Authorization: Bearer plh_…"),
        ApiError(
            403, "role_insufficient", "the role read does not allow this", extras={"needed_role": "submit"}
        ),
        ApiError(404, "not_found", "there is no job 019f0000-0000-7000-8000-000000000001"),
        ApiError(406, "not_acceptable", "accepted are application/json and text/csv"),
        ApiError(408, "request_timeout", "the request was not complete in time"),
        ApiError(409, "idempotency_key_in_use", "the first request with this key is still at work"),
        ApiError(412, "changed_meanwhile", "it has changed since its ETag was read; read it again"),
        ApiError(413, "body_too_large", "at most 1000000 bytes are accepted"),
        ApiError(415, "unsupported_media_type", "accepted is application/json"),
        ApiError(422, "invalid_problem", f"/body/A: {_FAULT.message}", faults=[_FAULT]),
        ApiError(429, "too_many_requests", "try again in 2 s"),
        ApiError(500, "internal_error", "the service failed; its log has the reason"),
        ApiError(503, "unavailable", "the database cannot be reached; try again in 2 s"),
    )
}
"""One refusal for each status that some route has."""


def _shown(refusal: ApiError) -> Document:
    return {**refusal.document(), "request_id": "019f0000-0000-7000-8000-000000000000"}


@cache
def recorded() -> Mapping[str, Mapping[str, Mapping[str, Document]]]:
    """Return the recorded answers."""
    found: dict[str, dict[str, dict[str, dict[str, object]]]] = json.loads(RECORDED.read_bytes())
    return found


def describe_examples(document: dict[str, Any]) -> None:
    """Add an example to every answer that has a body of text."""
    document["components"]["examples"] = {
        str(status): {"summary": error.code, "value": _shown(error)} for status, error in REFUSALS.items()
    }
    for operations in document["paths"].values():
        for operation in operations.values():
            given = recorded().get(operation["operationId"], {})
            for status, answer in operation["responses"].items():
                for media_type, content in answer.get("content", {}).items():
                    if media_type == MEDIA_TYPE:
                        content["examples"] = {"refused": {"$ref": f"{_PLACE}{status}"}}
                    elif named := given.get(status, {}).get(media_type):
                        content["examples"] = {name: {"value": value} for name, value in named.items()}


LEADS_TO: Mapping[str, Mapping[str, str]] = {
    "JobOut": {"job_id": "/id", "solution_id": "/solution"},
    "JobListOut": {"job_id": "/items/0/job/id"},
    "JobPageOut": {"job_id": "/items/0/id"},
    "SolutionOut": {"solution_id": "/id", "job_id": "/job"},
    "SolutionPageOut": {"solution_id": "/items/0/id"},
    "AuditOut": {"audit_id": "/id", "job_id": "/id", "solution_id": "/solution"},
    "SweepOut": {"sweep_id": "/id"},
    "SweepPageOut": {"sweep_id": "/items/0/id"},
    "SweepStateOut": {"sweep_id": "/id"},
}
"""For each model the path parameters that it has the values of, as JSON pointers into it."""
UNLINKED = ("get_result",)
"""Operations to which no answer leads: most jobs have no result."""


def describe_links(paths: Mapping[str, Mapping[str, dict[str, Any]]]) -> None:
    """Add ``links`` to every answer whose model is in the table.

    They lead to the operations whose path parameters it has.
    """
    targets = [
        (names, operation["operationId"])
        for path, operations in paths.items()
        if (names := {part[1:-1] for part in path.split("/") if part.startswith("{")})
        for operation in operations.values()
        if operation["operationId"] not in UNLINKED
    ]
    for operations in paths.values():
        for operation in operations.values():
            for status, answer in operation["responses"].items():
                links = dict(_links(answer, targets)) if status.startswith("2") else {}
                if links:
                    answer["links"] = links


def _links(answer: Part, targets: Sequence[tuple[set[str], str]]) -> Iterator[tuple[str, Part]]:
    for model in _models(answer):
        given = LEADS_TO.get(model, {})
        for wanted, operation in targets:
            if wanted <= given.keys():
                parameters = {name: f"$response.body#{given[name]}" for name in sorted(wanted)}
                yield f"{model}.{operation}", {"operationId": operation, "parameters": parameters}


def _models(answer: Part) -> Iterator[str]:
    """Yield the names of the models that the JSON of an answer may be."""
    schema = answer.get("content", {}).get("application/json", {}).get("schema", {})
    for each in (schema, *schema.get("anyOf", ())):
        yield each.get("$ref", "").rpartition("/")[2]
