"""What a job costs around its computation, beside bare engines, and in tables that are full."""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from sqlalchemy import text

from service.storage.database.database import Database
from service.storage.database.migration import migrate
from service.storage.jobs.job_store import JobStore
from tests.benchmarks.bare import analyze
from tests.benchmarks.measuring import Effort, Table, in_words
from tests.support.finishing import finish_success
from tests.support.postgres import PostgresServer, postgres_server
from tests.support.serving import Service, serving
from tests.support.waiting import wait_until
from tests.workers.process.engines.installation import Installation, installed

T = TypeVar("T")

PLACES = 2
"""Jobs at the same time, of ours and of the bare engines."""
PATIENCE = 600.0
SUMMARY: dict[str, object] = {"method": "quadrature", "tier": "standard"}


def engines(effort: Effort) -> Table:
    """Return how many empty jobs a second go through each engine, and by plain statements."""
    number = effort.repeats(1000)
    rows = []
    with tempfile.TemporaryDirectory() as folder, postgres_server() as server:
        for name, engine, make in (
            ("SQLite, one machine", "local", lambda name: sqlite_url(Path(folder), name)),
            ("Postgres, one machine", "local", lambda name: postgres_url(server)),
            ("Postgres, several machines", "postgres", lambda name: postgres_url(server)),
        ):
            bare = bare_seconds(make("bare"), number)
            for workers in (1, PLACES):
                with installed(make(f"ours-{workers}"), engine, Path(folder)) as installation:
                    submitted, done = _through(installation, number, workers)
                rows.append(
                    (
                        name,
                        f"{workers} x {PLACES // workers}",
                        f"{number / submitted:,.0f}",
                        f"{number / done:,.0f}",
                        f"{number / bare:,.0f}",
                        f"{bare / done:.2f}",
                    )
                )
    remark = (
        f"{number} empty jobs that wait already, {PLACES} at a time, by the clock. Bare are two plain "
        "statements a job on the same tables. Ours run in children that can be killed, and store a solution "
        "each. Postgres does not wait for the disk here, SQLite does; its statistics are up to date, as "
        "autovacuum keeps them. At least 0.5 is asked of the ratio."
    )
    heads = (
        "database and engine",
        "workers x slots",
        "submitted in a list, jobs/s",
        "done, jobs/s",
        "bare engine, jobs/s",
        "ratio",
    )
    return Table("Jobs a second", remark, heads, tuple(rows))


def growth(effort: Effort) -> Table:
    """Return what a job costs in tables that have held few or many."""
    small, large = 1_000, effort.repeats(1_000_000)
    rows = []
    with tempfile.TemporaryDirectory() as folder, postgres_server() as server:
        for name, engine, make in (
            ("SQLite, one machine", "local", lambda size: sqlite_url(Path(folder), f"rows-{size}")),
            ("Postgres, one machine", "local", lambda size: postgres_url(server)),
            ("Postgres, several machines", "postgres", lambda size: postgres_url(server)),
        ):
            costs = [_cost_among(make(size), engine, size, effort.repeats(500)) for size in (small, large)]
            ratios = [after / before for before, after in zip(*costs, strict=True)]
            rows.append(
                (
                    name,
                    *(f"{in_words(b)} → {in_words(a)}" for b, a in zip(*costs, strict=True)),
                    f"{max(ratios):.2f}",
                )
            )
    heads = ("database and engine", "submit", "take", "finish", "largest ratio")
    remark = f"Medians of one job at a time, with {small:,} and with {large:,} finished jobs in the tables."
    return Table("The cost of a job as the tables grow", remark, heads, tuple(rows))


def service(effort: Effort) -> Table:
    """Return how fast lists of real jobs go through the service, and how fast it answers meanwhile."""
    number = effort.repeats(500)
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder), workers=PLACES) as running:
        _submit_list(running, range(20))  # everything is imported and compiled
        wait_until(lambda: _left(running) == 0, PATIENCE)
        began = time.perf_counter()
        job = _submit_list(running, range(100, 100 + number))
        submitted = time.perf_counter() - began
        gets = []
        while _left(running):
            for _ in range(20):
                asked = time.perf_counter()
                running.call("GET", f"/v1/jobs/{job}")
                gets.append(time.perf_counter() - asked)
        done = time.perf_counter() - began
    percentile = statistics.quantiles(gets, n=100)[98] if len(gets) > 1 else gets[0]
    rows = (
        (f"a list of {number} problems, examined and queued", f"{number / submitted:,.0f} jobs/s"),
        ("from the list to the last solution", f"{number / done:,.0f} jobs/s"),
        (f"GET of a job meanwhile, median of {len(gets)}", in_words(statistics.median(gets))),
        ("the same, 99th percentile; at most 150 ms is asked", in_words(percentile)),
    )
    remark = (
        f"Gravity, planar motions, 101 samples over a period, each with its own λ; {PLACES} workers, SQLite."
    )
    return Table("Real jobs in a list", remark, ("what", "measured"), rows)


def _through(installation: Installation, number: int, workers: int) -> tuple[float, float]:
    """Return how long it takes to submit empty jobs, and to work them off once the children are there."""
    slots = PLACES // workers
    problems = [({"number": k}, os.urandom(16).hex()) for k in range(number)]
    began = time.perf_counter()
    installation.jobs.submit_many(problems)
    submitted = time.perf_counter() - began
    analyze(installation.database)
    crew = [
        installation.start_worker(slots=slots, lease_seconds=30, poll_seconds=0.5, clock_shift=0.0)
        for _ in range(workers)
    ]
    wait_until(lambda: _pause() or installation.count("solutions") == number, PATIENCE)
    with installation.database.read() as session:
        ends = session.scalars(text("SELECT ended_at FROM attempts ORDER BY ended_at")).all()
    for worker in crew:
        worker.terminate()
    early = number // 10
    return submitted, (ends[-1] - ends[early]) * number / (number - 1 - early)


def _cost_among(url: str, engine: str, size: int, number: int) -> tuple[float, float, float]:
    """Return the median times to submit, to take and to finish a job among ``size`` others."""
    database = Database(url, announces_jobs=engine == "postgres")
    store = JobStore(database)
    _fill(database, size)
    times: dict[str, list[float]] = {"submit": [], "take": [], "finish": []}
    for k in range(number):
        _timed(times["submit"], lambda: store.submit({"number": k}, os.urandom(16).hex()))  # noqa: B023
        taken = _timed(times["take"], lambda: store.take("bench", 1, lease_seconds=60.0))
        (claim,) = taken.claims
        _timed(
            times["finish"],
            lambda: finish_success(store, claim, SUMMARY, dense=b"dense", samples=b"samples"),  # noqa: B023
        )
    database.close()
    submit, take, finish = (statistics.median(each) for each in times.values())
    return submit, take, finish


def _fill(database: Database, size: int) -> None:
    """Insert finished jobs with an attempt each."""
    is_sqlite = database.engine.dialect.name == "sqlite"
    numbers = (
        "(WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n LIMIT :size) SELECT k FROM n)"
        if is_sqlite
        else "generate_series(1, :size) AS numbers(k)"
    )
    key = "printf('%032x', k)" if is_sqlite else "CAST(lpad(to_hex(k), 32, '0') AS uuid)"
    false = "0" if is_sqlite else "false"
    with database.write() as session:
        session.execute(
            text(
                "INSERT INTO jobs "
                "(id, state, attempt, progress, reused, problem, digest, created_at, finished_at) "
                f"SELECT {key}, 'failed', 1, 0, {false}, '{{}}', '{'0' * 64}', k, k FROM {numbers}"
            ),
            {"size": size},
        )
        session.execute(
            text(
                "INSERT INTO attempts (job_id, number, worker, started_at, ended_at, outcome) "
                "SELECT id, 1, 'bench', created_at, finished_at, 'failed' FROM jobs"
            )
        )
    analyze(database)


def _submit_list(running: Service, numbers: range) -> str:
    """Submit problems each like no other; return the id of the last job."""
    problems = [
        {
            "body": {"A": 2, "C": 1},
            "potential": {"type": "gravity", "a": -1},
            "motion": {"type": "planar", "nu": f"{1000 + k}/1000"},
            "time": {"periods": 1, "samples": 101},
        }
        for k in numbers
    ]
    answer = running.call("POST", "/v1/jobs", problems)
    assert answer.status == 202, answer
    return str(answer.document["items"][-1]["job"]["id"])


def _left(running: Service) -> int:
    states = ("queued", "running")
    return sum(running.call("GET", f"/v1/jobs?state={state}&limit=1").document["total"] for state in states)


def _timed(times: list[float], action: Callable[[], T]) -> T:
    began = time.perf_counter()
    result = action()
    times.append(time.perf_counter() - began)
    return result


def _pause() -> bool:
    """Leave the processors to those that are measured."""
    time.sleep(0.2)
    return False


def bare_seconds(url: str, number: int) -> float:
    """Return how long plain statements take, in a process of their own: see :mod:`tests.benchmarks.bare`."""
    command = [sys.executable, "-m", "tests.benchmarks.bare", url, str(number)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def sqlite_url(folder: Path, name: str) -> str:
    """Return the URL of a new database."""
    url = f"sqlite:///{folder / name}.db"
    migrate(url)
    return url


def postgres_url(server: PostgresServer) -> str:
    """Return the URL of a new database."""
    url = server.url(server.create_database())
    migrate(url)
    return url
