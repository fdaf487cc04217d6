"""A million points through the real server: its memory does not grow with them."""

import json
import urllib.request
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from tests.support.serving import serving
from tests.support.sweeps import store_points

POINTS = 1_000_000
MOST_GROWTH = 300 * 2**20
"""What the service promises to need beyond its idle self."""


def peak(process: int) -> int:
    """The most memory that the process ever had, in bytes."""
    status = Path(f"/proc/{process}/status").read_text()
    return 1024 * int(next(line for line in status.splitlines() if line.startswith("VmHWM")).split()[1])


def ask(address: str, accept: str):
    return urllib.request.urlopen(urllib.request.Request(address, headers={"Accept": accept}), timeout=120)


@pytest.fixture
def sweep_id(sqlite_url):
    return store_points(sqlite_url, POINTS)


@pytest.mark.long
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
