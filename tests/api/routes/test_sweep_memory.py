"""A million points through the real server: its memory does not grow with them."""

import json
import urllib.request
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from service.storage.codecs.points import SOLVED, ChunkPoints, chunk_outcome
from service.storage.database.database import Database
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.tables.sweeps import SweepChunkRow, SweepRow
from tests.support.serving import serving
from tests.support.sweeps import BASE

POINTS, CHUNK = 1_000_000, 10_000
MOST_GROWTH = 300 * 2**20
"""What the service promises to need beyond its idle self."""
DOCUMENT = {
    "base": BASE,
    "axes": [
        {"pointer": "/potential/parameters/a", "uniform": [-2, -1, 1000]},
        {"pointer": "/motion/lambda", "linspace": [0.1, 2, 1000]},
    ],
}


def store_points(url: str) -> str:
    """Write a finished sweep straight into its tables."""
    database, draws = Database(url), np.random.default_rng(1)
    sweep = SweepStore(database).submit(DOCUMENT, points=POINTS, most=CHUNK)
    with database.write() as session:
        for first in range(0, POINTS, CHUNK):
            numbers = {name: draws.normal(size=CHUNK) for name in ("period", "energy", "error")}
            outcome = chunk_outcome(ChunkPoints([SOLVED] * CHUNK, numbers), 1.0)
            bounds = {name: list(pair) for name, pair in outcome.bounds.items()}
            chunk = SweepChunkRow(
                sweep_id=sweep.id, first=first, count=CHUNK, refused=0, bounds=bounds, data=outcome.data
            )
            session.add(chunk)
        row = session.get_one(SweepRow, sweep.id)
        row.done, row.next_index, row.state = POINTS, POINTS, "succeeded"
    database.close()
    return sweep.id


def peak(process: int) -> int:
    """The most memory that the process ever had, in bytes."""
    status = Path(f"/proc/{process}/status").read_text()
    return 1024 * int(next(line for line in status.splitlines() if line.startswith("VmHWM")).split()[1])


def ask(address: str, accept: str):
    return urllib.request.urlopen(urllib.request.Request(address, headers={"Accept": accept}), timeout=120)


@pytest.fixture
def sweep_id(sqlite_url):
    return store_points(sqlite_url)


def test_streaming_a_million_points_takes_little_memory(sweep_id, tmp_path):
    with serving(tmp_path, workers=0) as service:
        idle, place = peak(service.process.pid), f"{service.address}/v1/sweeps/{sweep_id}/points"
        with ask(place, "application/vnd.apache.arrow.stream") as answer:
            assert sum(batch.num_rows for batch in pa.ipc.open_stream(answer)) == POINTS
        last = np.inf
        with ask(f"{place}?order=-energy&columns=energy", "application/vnd.apache.arrow.stream") as answer:
            for batch in pa.ipc.open_stream(answer):
                energies = batch.column(0).to_numpy()
                assert last >= energies[0]
                assert (np.diff(energies) <= 0).all()
                last = energies[-1]
        with ask(f"{place}?where=period<-4", "application/x-ndjson") as answer:
            assert all(json.loads(line)["period"] < -4 for line in answer)
        assert peak(service.process.pid) - idle < MOST_GROWTH
