"""Adds examples of answers to the OpenAPI document: recorded answers, and one refusal for each status."""

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any  # parts of a JSON document

from service.api.replies.errors import MEDIA_TYPE, ApiError
from service.schemas.reading.documents import Fault

RECORDED = Path(__file__).with_name("examples.json")
"""``{operation id: {status: {media type: {name: answer}}}}``, as a service answered."""
_PLACE = "#/components/examples/"
_REQUEST_ID = "019f0000-0000-7000-8000-000000000000"

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


@cache
def recorded() -> Mapping[str, Mapping[str, Mapping[str, Mapping[str, object]]]]:
    """Return the recorded answers."""
    found: dict[str, dict[str, dict[str, dict[str, object]]]] = json.loads(RECORDED.read_bytes())
    return found


def describe_examples(document: dict[str, Any]) -> None:
    """Add an example to every answer that has a body of text."""
    document["components"]["examples"] = {
        str(status): {"summary": error.code, "value": {**error.document(), "request_id": _REQUEST_ID}}
        for status, error in REFUSALS.items()
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
