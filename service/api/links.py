"""Adds to the OpenAPI document which operations an answer leads to, so that tools can follow them."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any  # parts of a JSON document

Part = Mapping[str, Any]

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


def describe_links(paths: Mapping[str, Mapping[str, dict[str, Any]]]) -> None:
    """Add ``links`` to every answer whose model is in the table.

    They lead to the operations whose path parameters it has.
    """
    targets = [
        (names, operation["operationId"])
        for path, operations in paths.items()
        if (names := _path_parameters(path))
        for operation in operations.values()
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


def _path_parameters(path: str) -> set[str]:
    return {part[1:-1] for part in path.split("/") if part.startswith("{")}
