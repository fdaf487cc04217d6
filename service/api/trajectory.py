"""GET /v1/solutions/{id}/trajectory: stored samples, or samples at any other times."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from http import HTTPStatus
from typing import Annotated, Literal

import numpy as np
from fastapi import APIRouter, Header, Query, Response
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from service.api.errors import ApiError, invalid_request
from service.api.formats import Trajectory, choose_format, media_types
from service.api.limits import check_query_samples
from service.api.resources import Inside, Resources
from service.api.responses import refusals
from service.dynamics.dense_output import DenseOutput
from service.dynamics.enclosure import is_part
from service.dynamics.motion import COLUMNS
from service.dynamics.orientation import (
    QUATERNION,
    evaluated_alone,
    orientation_errors,
    trajectory_columns,
    trajectory_errors,
)
from service.dynamics.sampling import sample_times
from service.schemas.asked_series import asked_series
from service.schemas.faults import Fault
from service.schemas.numbers import MAX_SAMPLES
from service.schemas.solution import TrajectoryOut
from service.storage.solutions.codec import decode_arrays, decode_dense

router = APIRouter(prefix="/v1/solutions", tags=["solutions"])

SOURCE_HEADER = "Polhode-Samples"
LATEST = 1e15
"""Largest |t|: beyond it a double cannot tell a phase."""

FloatArray = NDArray[np.float64]


class TrajectoryQuery(BaseModel):
    """Which times and columns."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    start: float | None = Field(default=None, ge=-LATEST, le=LATEST, description="0 if left out.")
    stop: float | None = Field(default=None, ge=-LATEST, le=LATEST)
    samples: int | None = Field(
        default=None, ge=1, le=MAX_SAMPLES, description="Equidistant from start to stop, both included."
    )
    columns: str | None = Field(default=None, description="Names with commas between, such as t,g1,g3.")


@router.get(
    "/{solution_id}/trajectory",
    response_model=TrajectoryOut,
    responses={
        200: {
            "model": TrajectoryOut,
            "description": "The columns. CSV, NPZ and Arrow carry the error in the header Polhode-Error."
            " Polhode-Samples says `stored`, or `evaluated` if made from the dense output just now.",
            "content": media_types(),
        },
        **refusals(404, 406),
    },
)
def get_trajectory(
    solution_id: str,
    query: Annotated[TrajectoryQuery, Query()],
    inside: Inside,
    accept: Annotated[str | None, Header()] = None,
) -> Response:
    """Return the samples at the problem's times, or with start, stop and samples those at any other times.

    Samples that are no longer stored are made again from the dense output.
    """
    write = choose_format(accept)
    asked = query.start, query.stop, query.samples
    if asked == (None, None, None):
        packet = inside.solutions.samples_if_kept(solution_id)
        samples = _remade(inside, solution_id) if packet is None else _stored(inside, solution_id, packet)
    else:
        times = _times(query)
        check_query_samples(len(times), inside.settings)
        dense = decode_dense(inside.solutions.dense(solution_id))
        _require_series(dense.columns)
        alone = dense if query.columns is None else evaluated_alone(dense, _names(query.columns))
        samples = _evaluated(alone, times)
    response = write(_selected(samples, query.columns))
    response.headers[SOURCE_HEADER] = samples.source
    return response


@dataclass(frozen=True, slots=True)
class _Samples:
    """Columns with the bounds of their absolute errors."""

    columns: Mapping[str, FloatArray]
    error: float
    """Of all those of the six variables that are here."""
    orientation: Mapping[str, float]
    """Of the columns of the orientation, each by itself."""
    source: Literal["stored", "evaluated"]


def _stored(inside: Resources, solution_id: str, packet: bytes) -> _Samples:
    summary = inside.solutions.get(solution_id).summary
    stored = decode_arrays(packet)
    columns = {name: values for name, values in stored.items() if not is_part(name)}
    _require_series(columns)
    error = summary["error"]
    assert isinstance(error, int | float)
    own: Mapping[str, float] = {}
    if QUATERNION[0] in columns:
        own = orientation_errors(decode_dense(inside.solutions.dense(solution_id)), columns["t"])
    return _Samples(columns, float(error), own, "stored")


def _remade(inside: Resources, solution_id: str) -> _Samples:
    """Return what was stored once: the same times and columns, with the error of the dense output."""
    asked = asked_series(inside.solutions.get(solution_id).problem)
    dense = decode_dense(inside.solutions.dense(solution_id))
    _require_series(dense.columns)
    times = sample_times(asked.time.to_domain(), dense.period)
    remade = _evaluated(dense, times)
    left_out = set(COLUMNS) - set(asked.columns())
    columns = {name: values for name, values in remade.columns.items() if name not in left_out}
    return replace(remade, columns=columns)


def _evaluated(dense: DenseOutput, times: FloatArray) -> _Samples:
    columns = {"t": times, **trajectory_columns(dense, times)}
    errors = trajectory_errors(dense, times)
    error = max((errors[name] for name in COLUMNS if name in errors), default=0.0)
    return _Samples(columns, error, errors, "evaluated")


def _require_series(columns: Collection[str]) -> None:
    if not columns:
        detail = "this solution was asked for without any function of time: there is no trajectory"
        raise ApiError(HTTPStatus.NOT_FOUND, "no_series", detail)


def _times(query: TrajectoryQuery) -> FloatArray:
    message = "start, stop and samples go together; only start may be left out"
    faults = [
        Fault(f"?{name}", "missing_parameter", message)
        for name, value in (("stop", query.stop), ("samples", query.samples))
        if value is None
    ]
    start = query.start or 0.0
    if query.stop is not None and query.stop < start:
        faults.append(Fault("?stop", "out_of_range", f"stop must be ≥ start = {start}"))
    if faults or query.stop is None or query.samples is None:
        raise invalid_request(faults)
    return np.linspace(start, query.stop, query.samples)


def _names(columns: str) -> list[str]:
    return [name.strip() for name in columns.split(",")]


def _selected(samples: _Samples, names: str | None) -> Trajectory:
    """Return the columns asked for, with the largest of their errors."""
    wanted = list(samples.columns) if names is None else _names(names)
    unknown = [name for name in wanted if name not in samples.columns]
    if unknown:
        listed = ", ".join(samples.columns)
        message = f"there is no column {unknown[0][:40]!r} here; accepted are {listed}"
        raise invalid_request([Fault("?columns", "unknown_column", message)])
    errors = {**samples.orientation, **dict.fromkeys(COLUMNS, samples.error), "t": 0.0}
    error = max(errors.get(name, samples.error) for name in wanted)
    return Trajectory({name: samples.columns[name] for name in wanted}, error)
