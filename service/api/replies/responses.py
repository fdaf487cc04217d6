"""Writes JSON answers without NaN, and the OpenAPI entries of refusals."""

import json
from collections.abc import Mapping
from datetime import datetime
from http import HTTPStatus

from fastapi import Response

from service.api.replies.errors import MEDIA_TYPE
from service.schemas.replies.response_model import ResponseModel

JSON = "application/json"


def json_response(
    model: ResponseModel, *, status: int = HTTPStatus.OK, headers: Mapping[str, str] | None = None
) -> Response:
    """Return a model as JSON.

    Pydantic's and orjson's writers are not used: both silently turn NaN into null, and
    orjson refuses integers beyond 64 bits, which problems may hold.
    """
    return Response(json_content(model), status_code=status, media_type=JSON, headers=headers)


def json_content(model: ResponseModel) -> bytes:
    """Return the bytes of a model as JSON."""
    return json.dumps(model.model_dump(by_alias=True), allow_nan=False, default=_instant).encode()


def _instant(value: object) -> str:
    if isinstance(value, datetime):
        return value.isoformat()
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def refusals(*statuses: int) -> dict[int | str, dict[str, object]]:
    """Return the OpenAPI entries of refusals: these statuses, and 422, which any request can have."""
    schema = {"$ref": "#/components/schemas/ProblemDetailsOut"}
    return {
        status: {
            "description": HTTPStatus(status).phrase,
            "content": {MEDIA_TYPE: {"schema": schema}},
        }
        for status in sorted({*statuses, HTTPStatus.UNPROCESSABLE_ENTITY.value})
    }
