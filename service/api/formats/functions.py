"""Writes motions as functions of time: the coefficients of their series, in JSON that keeps every bit."""

from collections.abc import Mapping
from dataclasses import asdict
from http import HTTPStatus

import numpy as np
import orjson
from fastapi import Response

from service.api.formats.negotiation import JSON
from service.api.replies.errors import ApiError
from service.dynamics.solution.dense_output import DenseOutput


def write_function(dense: DenseOutput, headers: Mapping[str, str]) -> Response:
    """Return the answer; orjson writes doubles by their shortest decimals: the same bits."""
    if not np.isfinite(dense.coefficients).all():
        detail = "the stored solution has values that are not finite; it cannot be sent"
        raise ApiError(HTTPStatus.INTERNAL_SERVER_ERROR, "not_finite", detail)
    document = {
        "columns": list(dense.columns),
        "breaks": np.ascontiguousarray(dense.breaks),
        "coefficients": np.ascontiguousarray(dense.coefficients),
        "period": None if dense.period is None else asdict(dense.period),
        "error": dense.error,
        "errors": dict(dense.errors),
        "advances": {name: asdict(gained) for name, gained in dense.advances.items()},
    }
    content = orjson.dumps(document, option=orjson.OPT_SERIALIZE_NUMPY)
    return Response(content, media_type=JSON, headers=headers)
