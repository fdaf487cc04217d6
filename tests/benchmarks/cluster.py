"""A Dask cluster beside children of this machine, and how much one bridge and its database carry."""

import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from sqlalchemy import select

from service.storage.database.database import Database
from service.storage.jobs.job_store import JobStore
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.tables.operations import WorkerRow
from tests.benchmarks.lists import seconds_of_list
from tests.benchmarks.measuring import Effort, Table
from tests.benchmarks.throughput import PATIENCE, PLACES, postgres_url, sqlite_url
from tests.benchmarks.whole.requests import PROBLEM, wait_until_warm
from tests.support.dask_cluster import Cluster
from tests.support.postgres import PostgresServer, postgres_server
from tests.support.serving import Service, serving
from tests.support.waiting import wait_until
from tests.workers.processes import Worker

JOBS, POINTS = 10_000, 1_000_000
ROUNDS = 3
SLEEPERS = 16
"""Threads of the cluster whose children sleep instead of computing."""
CHUNK_POINTS, CHUNK_SECONDS = 1000, 0.25
_TICKS = os.sysconf("SC_CLK_TCK")
SWEEP = {
    "base": {**PROBLEM, "motion": {"type": "planar", "lambda": 1}, "accuracy": {"tier": "standard"}},
    "keep": ["period", "energy", "error"],
}


def beside_children(effort: Effort) -> Table:
    """Return the rates of single problems and of a sweep here and on a cluster of as many threads."""
    number, points = (JOBS // 10, POINTS // 20) if effort.is_quick else (JOBS, POINTS)
    rounds = 1 if effort.is_quick else ROUNDS
    jobs: dict[str, list[float]] = {"local": [], "dask": []}
    sweeps: dict[str, list[float]] = {"local": [], "dask": []}
    for turn in range(rounds):
        # In turns, so that whatever else the machine does hits both alike; never both at the same time.
        for pool in jobs:
            with _service(pool) as running:
                jobs[pool].append(
                    number / seconds_of_list(running, PROBLEM, "standard", 100_000 + turn * number, number)
                )
                sweeps[pool].append(points / _seconds_of_sweep(running, points, turn))
    rows = []
    for name, rates, asked in (
        (f"{number:,} problems of a list", jobs, "≥ 0.5"),
        (f"a sweep of {points:,} points", sweeps, "≥ 0.8"),
    ):
        local, dask = statistics.median(rates["local"]), statistics.median(rates["dask"])
        rows.append((name, f"{local:,.0f}", f"{dask:,.0f}", f"{dask / local:.2f}", asked))
    remark = (
        f"{PLACES} children here, or a scheduler and one Dask worker with {PLACES} threads on the same "
        "processors, SQLite; from the POST to the last result, the median of some turns."
    )
    heads = ("what", "here, a second", "by Dask, a second", "ratio", "asked")
    return Table("A Dask cluster beside children of this machine", remark, heads, tuple(rows))


@contextmanager
def _service(pool: str) -> Iterator[Service]:
    with tempfile.TemporaryDirectory() as folder:
        if pool == "local":
            with serving(Path(folder), workers=PLACES, POLHODE_LOG_LEVEL="warning") as running:
                wait_until_warm(running)
                yield running
            return
        with closing(Cluster(Path(folder), threads=PLACES)) as cluster:
            chosen = {"POLHODE_POOL": "dask", "POLHODE_DASK_SCHEDULER": cluster.address}
            with serving(Path(folder), workers=PLACES, POLHODE_LOG_LEVEL="warning", **chosen) as running:
                wait_until_warm(running)
                yield running


def _seconds_of_sweep(running: Service, points: int, turn: int) -> float:
    axis = {"pointer": "/motion/lambda", "uniform": [f"{11 + turn}/10", "6", points], "seed": turn}
    began = time.perf_counter()
    answer = running.call("POST", "/v1/sweeps", {**SWEEP, "axes": [axis]})
    if answer.status != 202:
        raise RuntimeError(f"{answer.status}: {str(answer.document)[:500]}")
    path = f"/v1/sweeps/{answer.document['id']}"
    wait_until(lambda: running.call("GET", path).document["state"] == "succeeded", PATIENCE)
    return time.perf_counter() - began


def carried(effort: Effort) -> Table:
    """Return what one bridge and its database carry when the cluster only sleeps, and what it costs them."""
    rows = []
    with tempfile.TemporaryDirectory() as name, postgres_server() as server:
        folder = Path(name)
        with closing(Cluster(folder, threads=SLEEPERS)) as cluster:
            for engine, make in (
                ("SQLite", lambda kind: sqlite_url(folder, kind)),
                ("Postgres", lambda kind: postgres_url(server)),
            ):
                for bridges in (1, 2):
                    for kind, submit in (("single jobs", _submit_jobs), ("chunks", _submit_chunks)):
                        url = make(f"{kind} {bridges}")
                        found = _carried(cluster, server, url, effort, submit, bridges)
                        rows.append((engine, str(bridges), kind, *found))
    remark = (
        f"{SLEEPERS} children of one Dask worker sleep {CHUNK_SECONDS:g} s for a chunk of {CHUNK_POINTS} "
        "points, and not at all for a job. Processor time of the bridges, and of Postgres, for each; "
        "they saturate at the rate, a second, at which each of them alone fills one processor."
    )
    heads = (
        "database",
        "bridges",
        "what",
        "a second",
        "bridges, ms each",
        "Postgres, ms each",
        "bridges saturate at, a second",
    )
    return Table("What one bridge carries", remark, heads, tuple(rows))


def _submit_jobs(database: Database, number: int) -> Callable[[], bool]:
    jobs = JobStore(database)
    made = jobs.submit_many([({"number": k}, f"sleeps {k}") for k in range(number)])
    return lambda: jobs.get(made[-1].id).is_finished and all(jobs.get(job.id).is_finished for job in made)


def _submit_chunks(database: Database, number: int) -> Callable[[], bool]:
    sweeps = SweepStore(database)
    document = {"seconds": CHUNK_SECONDS / CHUNK_POINTS, "pause": CHUNK_SECONDS}
    sweep = sweeps.submit(document, points=number * CHUNK_POINTS, most=CHUNK_POINTS)
    return lambda: sweeps.get(sweep.id).finished_at is not None


def _carried(
    cluster: Cluster,
    server: PostgresServer,
    url: str,
    effort: Effort,
    submit: Callable[[Database, int], Callable[[], bool]],
    number_of_bridges: int,
) -> tuple[str, ...]:
    database = Database(url)
    number = effort.repeats(2000 if submit is _submit_jobs else 1000)
    terms = {"pool": "dask", "dask_scheduler": cluster.address, "lease_seconds": 10.0, "poll_seconds": 0.1}
    bridges = [Worker(url, **terms) for _ in range(number_of_bridges)]

    def spent() -> float:
        return sum(_seconds(bridge.process.pid) for bridge in bridges)

    try:
        wait_until(lambda: _ready(database) == number_of_bridges)
        wait_until(submit(database, 2))
        is_done = submit(database, number)
        began, before = time.perf_counter(), spent()
        theirs = _postgres_seconds(server)
        wait_until(is_done, PATIENCE)
        seconds = time.perf_counter() - began
        ours = (spent() - before) / number
        theirs = (_postgres_seconds(server) - theirs) / number
    finally:
        for bridge in bridges:
            bridge.clean_up()
        database.close()
    shown = f"{1e3 * theirs:.2f}" if url.startswith("postgres") else ""
    saturated = number_of_bridges / ours
    return f"{number / seconds:,.0f}", f"{1e3 * ours:.2f}", shown, f"{saturated:,.0f}"


def _ready(database: Database) -> int:
    """Return how many bridges may compute."""
    with database.read() as session:
        found = session.scalars(select(WorkerRow.cluster)).all()
    return sum(each is not None and each["threads"] == SLEEPERS for each in found)


def _postgres_seconds(server: PostgresServer) -> float:
    """Return the processor time of a server and of the processes of its connections."""
    found = 0.0
    server_id = int((server.folder / "data" / "postmaster.pid").read_text().split()[0])
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            if server_id in (parent, int(folder.name)):
                found += _seconds(int(folder.name))
    return found


def _seconds(process: int) -> float:
    """Return the processor time of a process."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS
