"""GET /v1/solutions/{id}/trajectory: samples at stored or any other times; .../function; .../enclosures.

Enclosures are the proven samples of the certified tier.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from http import HTTPStatus
from typing import Annotated, Literal

import numpy as np
from fastapi import APIRouter, Depends, Request, Response
from numpy.typing import NDArray
from pydantic import Field, PlainValidator, WithJsonSchema

from service.api.dependencies import Inside, Resources
from service.api.formats.negotiation import PARQUET, Accept, chosen, named_file
from service.api.formats.trajectories import Trajectory, media_types, write, write_function
from service.api.keys.limits import query_samples_faults
from service.api.middleware.heavy_answers import heavy
from service.api.queries.queries import (
    FORMAT_HELP,
    Asked,
    FormatName,
    QueryModel,
    asked_of,
    query_parameters,
    refuse_if_any,
    without_query,
)
from service.api.replies import ApiError, SolutionId, json_response, refusals
from service.api.tagged import validator_headers
from service.dynamics.equations.orientation import (
    PRECESSION,
    QUATERNION,
    column_names,
    evaluated_alone,
    orientation_errors,
    parts_of,
    trajectory_columns,
    trajectory_errors,
)
from service.dynamics.motion import COLUMNS, columns_of
from service.dynamics.problem import TimeSpan
from service.dynamics.sampling import SampleTimes, sample_times
from service.dynamics.solution.dense_output import MAX_PARTS, RADIUS, DenseOutput, as_decimals, is_part, join
from service.dynamics.solution.preview import deviation, preview_times
from service.jobs.records import SolutionNotFoundError
from service.schemas.problem.trusted import ONE_AT_A_TIME, outputs_of, times_of
from service.schemas.reading.documents import Document, Fault
from service.schemas.reading.numbers import LATEST, MAX_SAMPLES, read_time
from service.schemas.replies.solution import EnclosureOut, EnclosuresOut, MotionFunctionOut, TrajectoryOut
from service.settings import Settings
from service.storage.codecs.packing import decode_arrays, decode_dense
from service.storage.solutions.solution_store import Solution

router = APIRouter(prefix="/v1/solutions", tags=["solutions"])

SOURCE_HEADER = "Polhode-Samples"
DEVIATION_HEADER = "Polhode-Deviation"
"""Header with the largest difference of a preview's lines from the curves, as a share of their ranges."""
MOST_PREVIEWED = 10_000
TIMES = ("start", "stop", "samples")
"""The parameters that ask for other times than the stored ones."""

FloatArray = NDArray[np.float64]
Instant = Annotated[
    Fraction,
    PlainValidator(read_time),
    WithJsonSchema({"type": "number", "minimum": -float(LATEST), "maximum": float(LATEST)}),
]


class TrajectoryQuery(QueryModel):
    """The times and columns asked for."""

    start: Instant | None = Field(default=None, description="0 if left out.")
    stop: Instant | None = Field(default=None, description="Last time, not before start.")
    samples: int | None = Field(
        default=None, ge=1, le=MAX_SAMPLES, description="Equidistant from start to stop, both included."
    )
    preview: int | None = Field(
        default=None,
        ge=2,
        le=MOST_PREVIEWED,
        description="So many times at which the columns are drawn best, closer together where they are bent;"
        f" over those of the problem, or from start to stop. {DEVIATION_HEADER} says how far the drawn lines"
        " are off at most, as a share of a column's range.",
    )
    columns: str | None = Field(default=None, description="Names with commas between, such as t,g1,g3.")
    format: FormatName | None = Field(default=None, description=FORMAT_HELP)


@router.get(
    "/{solution_id}/trajectory",
    response_model=TrajectoryOut,
    responses={
        200: {
            "model": TrajectoryOut,
            "description": "The columns. All but JSON carry the error in the header Polhode-Error; Parquet"
            " has the problem, the provenance, units and errors in its metadata."
            " Polhode-Samples says `stored`, or `evaluated` if made from the dense output just now.",
            "content": media_types(),
        },
        **refusals(404, 406),
    },
    openapi_extra=query_parameters(TrajectoryQuery),
)
@heavy
def get_trajectory(
    request: Request,
    solution_id: SolutionId,
    asked: Annotated[Asked[TrajectoryQuery], Depends(asked_of(TrajectoryQuery))],
    inside: Inside,
    accept: Accept = None,
) -> Response:
    """Return the samples at the problem's times, or with start, stop and samples those at any other times.

    Samples that are no longer stored are recomputed from the dense output.
    """
    media_type = chosen(asked.parameters.format, accept)
    query, is_stored = asked.parameters, asked.sent.isdisjoint((*TIMES, "preview"))
    faults = [*asked.faults, *([] if is_stored else _faults_of_times(asked, inside.settings))]
    if faults:
        refuse_if_any([*faults, *_faults_of_columns(inside, solution_id, query.columns)])
    told = validator_headers(request, inside)
    if is_stored:
        packet = inside.solutions.samples_if_kept(solution_id)
        samples = _remade(inside, solution_id) if packet is None else _stored(inside, solution_id, packet)
    else:
        dense = decode_dense(inside.solutions.dense(solution_id))
        _require_series(dense.columns)
        alone = dense if query.columns is None else evaluated_alone(dense, _names(query.columns))
        if query.preview is None:
            samples = _evaluated(alone, _times(query))
        else:
            samples, off = _previewed(inside, solution_id, alone, query)
            told |= off
    file = named_file(f"trajectory-{solution_id}", media_type)
    headers = {**told, **file, SOURCE_HEADER: samples.source}
    about = _about(inside.solutions.get(solution_id)) if media_type == PARQUET else {}
    return write(_selected(samples, query.columns), media_type, headers, about)


@router.get(
    "/{solution_id}/function",
    response_model=MotionFunctionOut,
    responses=refusals(404),
    dependencies=[without_query],
)
@heavy
def get_function(request: Request, solution_id: SolutionId, inside: Inside) -> Response:
    """Return the motion as a function of time, which clients evaluate at any times themselves."""
    told = validator_headers(request, inside)
    dense = decode_dense(inside.solutions.dense(solution_id))
    _require_series(dense.columns)
    return write_function(dense, told)


def _about(solution: Solution) -> Document:
    """Return what a file says of the solution that it is from."""
    return {
        "solution": solution.id,
        "problem": solution.problem,
        "provenance": solution.summary.get("provenance"),
    }


@dataclass(frozen=True, slots=True)
class _Samples:
    """Columns with the bounds of their absolute errors."""

    columns: Mapping[str, FloatArray]
    error: float
    """The error bound of the six variables."""
    own: Mapping[str, float]
    """The error bounds of columns that have one of their own, such as those of the orientation."""
    source: Literal["stored", "evaluated"]


def _stored(inside: Resources, solution_id: str, packet: bytes) -> _Samples:
    summary = inside.solutions.get(solution_id).summary
    stored = decode_arrays(packet)
    columns = {name: values for name, values in stored.items() if not is_part(name)}
    _require_series(columns)
    own = _own_errors(summary.get("errors"))
    if QUATERNION[0] in columns:
        own |= orientation_errors(decode_dense(inside.solutions.dense(solution_id)), columns["t"])
    return _Samples(columns, float(summary["error"]), own, "stored")


def _own_errors(told: object) -> dict[str, float]:
    """Return the bounds of p, q, r and of g1, g2, g3, where the solution tells them apart."""
    match told:
        case {"omega": {"absolute": float(omega)}, "gamma": {"absolute": float(gamma)}}:
            return {**dict.fromkeys(COLUMNS[:3], omega), **dict.fromkeys(COLUMNS[3:], gamma)}
    return {}


def _remade(inside: Resources, solution_id: str) -> _Samples:
    """Recompute deleted samples: the same times and columns, with the error of the dense output."""
    problem = inside.solutions.get(solution_id).problem
    dense = decode_dense(inside.solutions.dense(solution_id))
    _require_series(dense.columns)
    times = sample_times(times_of(problem["time"]), dense.period)
    remade = _evaluated(dense, times)
    left_out = set(COLUMNS) - set(columns_of(outputs_of(problem)))
    columns = {name: values for name, values in remade.columns.items() if name not in left_out}
    return replace(remade, columns=columns)


def _evaluated(dense: DenseOutput, times: SampleTimes) -> _Samples:
    columns = {"t": times.doubles, **trajectory_columns(dense, times.doubles, times.low_parts)}
    errors = trajectory_errors(dense, times.doubles)
    error = max((errors[name] for name in COLUMNS if name in errors), default=0.0)
    return _Samples(columns, error, errors, "evaluated")


def _previewed(
    inside: Resources, solution_id: str, dense: DenseOutput, query: TrajectoryQuery
) -> tuple[_Samples, dict[str, str]]:
    """Return a preview, and how far it is off."""
    assert query.preview is not None
    if query.stop is None:
        problem = inside.solutions.get(solution_id).problem
        given = sample_times(times_of(problem["time"]), dense.period).doubles
        start, stop = float(given.min()), float(given.max())
    else:
        start, stop = float(query.start or 0), float(query.stop)
    chosen_times = preview_times(dense, start, stop, query.preview)
    samples = _evaluated(dense, SampleTimes(chosen_times, np.zeros(len(chosen_times))))
    parts = {name: columns for name, columns in parts_of(dense).items() if name in samples.columns}
    if query.columns is not None:
        parts = {name: columns for name, columns in parts.items() if name in _names(query.columns)}
    off = deviation(dense, parts, chosen_times, lambda times: trajectory_columns(dense, times))
    return samples, {DEVIATION_HEADER: repr(off)}


def _require_series(columns: Collection[str]) -> None:
    if not columns:
        detail = "the problem asked for no function of time, so this solution has no trajectory"
        raise ApiError(HTTPStatus.NOT_FOUND, "no_series", detail)


def _faults_of_times(asked: Asked[TrajectoryQuery], settings: Settings) -> Iterator[Fault]:
    """Yield the faults of the times, beside those of unreadable parameters."""
    query = asked.parameters
    if query.preview is not None and "samples" in asked.sent:
        message = "preview and samples; one of the two is accepted"
        yield Fault("?preview", "conflicting_parameters", message)
    # A preview has times of its own, and may do without an end.
    needed = ["stop", "samples"] if "preview" not in asked.sent else ["stop"] if "start" in asked.sent else []
    for name in needed:
        if name not in asked.sent:
            message = "start, stop and samples belong together; only start may be left out"
            yield Fault(f"?{name}", "missing_parameter", message)
    start = query.start or Fraction(0)
    is_start_known = query.start is not None or "start" not in asked.sent
    if is_start_known and query.stop is not None and query.stop < start:
        yield Fault("?stop", "out_of_range", f"stop must be ≥ start = {float(start)}")
    yield from query_samples_faults(query.samples or 0, settings)


def _faults_of_columns(inside: Resources, solution_id: str, columns: str | None) -> list[Fault]:
    """Return the faults of the columns that the solution shows."""
    if columns is None:
        return []
    try:
        dense = decode_dense(inside.solutions.dense(solution_id))
    except SolutionNotFoundError:
        return []
    return _unknown_columns(_names(columns), ["t", *column_names(dense)])


def _unknown_columns(wanted: Sequence[str], there: Sequence[str]) -> list[Fault]:
    listed = ", ".join(there)
    return [
        Fault("?columns", "unknown_column", f"there is no column {name[:40]!r} here; accepted are {listed}")
        for name in dict.fromkeys(wanted)
        if name not in there
    ]


def _times(query: TrajectoryQuery) -> SampleTimes:
    assert query.stop is not None
    assert query.samples is not None
    return sample_times(TimeSpan(query.start or Fraction(0), query.stop, query.samples), None)


def _names(columns: str) -> list[str]:
    return [name.strip() for name in columns.split(",")]


def _selected(samples: _Samples, names: str | None) -> Trajectory:
    """Return the columns asked for, with the largest of their errors."""
    wanted = list(samples.columns) if names is None else _names(names)
    refuse_if_any(_unknown_columns(wanted, list(samples.columns)))
    errors = {**dict.fromkeys(COLUMNS, samples.error), **samples.own, "t": 0.0}
    own = {name: errors.get(name, samples.error) for name in wanted}
    return Trajectory({name: samples.columns[name] for name in wanted}, max(own.values()), own)


@router.get(
    "/{solution_id}/enclosures",
    response_model=EnclosuresOut,
    responses=refusals(404),
    dependencies=[without_query],
)
@heavy
def get_enclosures(request: Request, solution_id: SolutionId, inside: Inside) -> Response:
    """Return the six variables at the exact times that were asked, as decimals with proven radii.

    With the output ``orientation`` of a motion that was proven by steps also the quaternion and the azimuths.
    """
    headers = validator_headers(request, inside)
    stored = decode_arrays(inside.solutions.samples(solution_id))
    names = [name for name in (*COLUMNS, *QUATERNION, *PRECESSION) if f"{name}.{RADIUS}" in stored]
    if not names:
        raise ApiError(
            HTTPStatus.NOT_FOUND, "no_enclosures", "only solutions of the tier certified have enclosures"
        )
    with ONE_AT_A_TIME:
        columns = {name: _enclosures(stored, name) for name in names}
        times = _enclosures(stored, "t")
    document = EnclosuresOut(t=stored["t"].tolist(), times=times, columns=columns)
    return json_response(document, headers=headers)


def _enclosures(stored: Mapping[str, FloatArray], name: str) -> list[EnclosureOut]:
    further = sorted(set(stored) & {f"{name}.{part}" for part in range(1, MAX_PARTS)})
    rows = zip(*(stored[part].tolist() for part in (name, *further)), strict=True)
    # Times stored without radii are exact doubles.
    radii = stored.get(f"{name}.{RADIUS}", np.zeros(len(stored[name]))).tolist()
    pairs = (as_decimals(join(row, radius)) for row, radius in zip(rows, radii, strict=True))
    return [EnclosureOut(value=value, radius=radius) for value, radius in pairs]
