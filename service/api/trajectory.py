"""GET /v1/solutions/{id}/trajectory: stored samples, or samples at any other times."""

from typing import Annotated

import numpy as np
from fastapi import APIRouter, Header, Query, Response
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from service.api.errors import invalid_request
from service.api.formats import Trajectory, choose_format, media_types
from service.api.resources import Inside, Resources
from service.api.responses import refusals
from service.schemas.faults import Fault
from service.schemas.solution import TrajectoryOut
from service.storage.codec import decode_arrays, decode_dense

router = APIRouter(prefix="/v1/solutions", tags=["solutions"])

MAX_SAMPLES = 100_000
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
            "description": "The columns. CSV, NPZ and Arrow carry the error in the header Polhode-Error.",
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
    """Return the stored samples, or with start, stop and samples those at any other times."""
    write = choose_format(accept)
    asked = query.start, query.stop, query.samples
    if asked == (None, None, None):
        trajectory = _stored(inside, solution_id)
    else:
        trajectory = _evaluated(inside, solution_id, _times(query))
    return write(_selected(trajectory, query.columns))


def _stored(inside: Resources, solution_id: str) -> Trajectory:
    summary = inside.solutions.get(solution_id).summary
    columns = decode_arrays(inside.solutions.samples(solution_id))
    error = summary["error"]
    assert isinstance(error, int | float)
    return Trajectory(columns, float(error))


def _evaluated(inside: Resources, solution_id: str, times: FloatArray) -> Trajectory:
    dense = decode_dense(inside.solutions.dense(solution_id))
    values = dense(times)
    columns = {"t": times, **{name: values[:, k] for k, name in enumerate(dense.columns)}}
    return Trajectory(columns, dense.error_at(times))


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


def _selected(trajectory: Trajectory, names: str | None) -> Trajectory:
    if names is None:
        return trajectory
    wanted = [name.strip() for name in names.split(",")]
    unknown = [name for name in wanted if name not in trajectory.columns]
    if unknown:
        listed = ", ".join(trajectory.columns)
        message = f"there is no column {unknown[0][:40]!r} here; accepted are {listed}"
        raise invalid_request([Fault("?columns", "unknown_column", message)])
    return Trajectory({name: trajectory.columns[name] for name in wanted}, trajectory.error)
