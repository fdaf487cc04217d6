"""Sweeps whose points are known functions of their indices, done without any solver."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import delete

from service.jobs.records import Claim
from service.storage.codecs.packing import SOLVED, ChunkPoints, chunk_outcome
from service.storage.database.database import Database
from service.storage.jobs.job_store import JobStore
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.tables.jobs import JobRow
from service.storage.tables.solutions import SweepChunkRow, SweepRow

FloatArray = NDArray[np.float64]

BASE = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": -1, "b": "1/20"}},
    "motion": {"type": "planar", "lambda": 1},
    "time": {"stop": 10, "samples": 3},
}
AXES = [
    {"pointer": "/potential/parameters/a", "values": [-2, "-1/3"]},
    {"pointer": "/motion/lambda", "linspace": [0.1, 2, 50]},
]
SWEEP = {"base": BASE, "axes": AXES, "keep": ["period", "energy"]}
POINTS = 100
STORED_CHUNK = 10_000
REFUSED_EVERY = 7
"""Points whose index this divides have no motion; the first has one."""


def is_refused(indices: NDArray[np.int64]) -> NDArray[np.bool_]:
    return (indices % REFUSED_EVERY == 0) & (indices > 0)


def period_of(indices: NDArray[np.int64]) -> FloatArray:
    """Neither growing nor falling, and never twice the same."""
    return np.where(is_refused(indices), np.nan, np.sin(indices + 1.0))


def energy_of(indices: NDArray[np.int64]) -> FloatArray:
    """Often the same."""
    return np.where(is_refused(indices), np.nan, -(indices // 10 % 3) / 4.0)


def finish_chunk(
    jobs: JobStore,
    claim: Claim,
    *,
    series: Mapping[str, Callable[[NDArray[np.int64]], FloatArray]] = {},
    source: Mapping[str, object] | None = None,
    point_seconds: float = 0.05,
) -> None:
    """Do a worker's work for a chunk; by the time that a point takes others are cut."""
    first, count = claim.problem["first"], claim.problem["count"]
    assert isinstance(first, int)
    assert isinstance(count, int)
    indices = np.arange(first, first + count)
    outcomes = ["no_motion" if refused else SOLVED for refused in is_refused(indices)]
    numbers = {"period": period_of(indices), "energy": energy_of(indices)}
    points = ChunkPoints(outcomes, numbers, {name: of(indices) for name, of in series.items()})
    assert jobs.finish(claim, chunk_outcome(points, point_seconds * count, source))[0]


def finish_sweep(jobs: JobStore, chunks: int | None = None, **series: object) -> None:
    """Do the work of all chunks there are, or of the first few."""
    if chunks is None:
        # A sweep that is only to be done has a few chunks, not a dozen: each takes many statements.
        series = {"point_seconds": 0.01, **series}
    done = 0
    while chunks is None or done < chunks:
        claim = jobs.claim("test", lease_seconds=60.0)
        if claim is None:
            return
        finish_chunk(jobs, claim, **series)  # type: ignore[arg-type]
        done += 1


def store_points(url: str, points: int) -> str:
    """Write a finished sweep straight into its tables; return its id."""
    document = {
        "base": BASE,
        "axes": [
            {"pointer": "/potential/parameters/a", "uniform": [-2, -1, points // 1000]},
            {"pointer": "/motion/lambda", "linspace": [0.1, 2, 1000]},
        ],
    }
    database, draws = Database(url), np.random.default_rng(1)
    sweep = SweepStore(database).submit(document, points=points, most=STORED_CHUNK)
    with database.write() as session:
        for first in range(0, points, STORED_CHUNK):
            numbers = {name: draws.normal(size=STORED_CHUNK) for name in ("period", "energy", "error")}
            outcome = chunk_outcome(ChunkPoints([SOLVED] * STORED_CHUNK, numbers), 1.0)
            bounds = {name: list(pair) for name, pair in outcome.bounds.items()}
            session.add(
                SweepChunkRow(
                    sweep_id=sweep.id,
                    first=first,
                    count=STORED_CHUNK,
                    refused=0,
                    bounds=bounds,
                    data=outcome.data,
                )
            )
        session.execute(delete(JobRow).where(JobRow.sweep_id == sweep.id))
        row = session.get_one(SweepRow, sweep.id)
        row.done, row.next_index, row.state = points, points, "succeeded"
    database.close()
    return sweep.id
