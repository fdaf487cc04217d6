"""A real installation whose processes are killed at random while a client submits, and what came of it."""

import contextlib
import json
import random
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from http.client import HTTPException
from pathlib import Path

import numpy as np
from sqlalchemy import func, select
from sqlalchemy.orm import Session, aliased

from service.jobs.records import FINISHED, AttemptOutcome, JobKind, JobState, pause_after
from service.storage.database.database import Database
from service.storage.database.migration import migrate
from service.storage.tables.jobs import AttemptRow, JobRow
from service.storage.tables.solutions import SolutionRow, SweepRow
from tests.crash.client import Client
from tests.crash.installation import SETTINGS, STALL_SECONDS, Installation, kill
from tests.support.databases import url_of
from tests.support.postgres import postgres_server
from tests.support.waiting import wait_until

PREY = {
    **{"api": 2, "worker": 2, "helper": 1, "judge": 1, "child": 8},
    **{"scheduler": 1, "nanny": 1, "Dask worker": 2, "children's": 1, "network": 1},
}
"""Weights with which a kind of process is chosen to be killed; a network stalls for a while."""
RECOVERY_SECONDS = 180.0
"""Until an installation has started, and beside the storm's own length until all is done."""
LONGEST = 5.0
"""A storm that has not reached what is planned after so many times its seconds ends all the same."""
AWAY_SECONDS = 1.0
"""Between the crash of Postgres and its next start."""


@dataclass
class Figures:
    """What a storm did, and what came of it."""

    seconds: float = 0.0
    kills: Counter[str] = field(default_factory=Counter)
    stalls: int = 0
    """The times that the network to the cluster stalled."""
    deaths: dict[int, float] = field(default_factory=dict)
    """When which process was killed."""
    acknowledged: list[str] = field(default_factory=list)
    repeated: int = 0
    """Requests that got no answer or a 503, and were sent again."""
    unfinished: int = 0
    """Acknowledged jobs, and sweeps, without an end."""
    lost: int = 0
    """Acknowledged jobs that did not succeed."""
    doubled: int = 0
    """Jobs that succeeded more than once."""
    lost_attempts: int = 0
    points: int = 0
    """Stored points of sweeps."""
    taken_over: list["TakenOver"] = field(default_factory=list)
    """Jobs whose attempts were lost, or returned."""
    recovery_seconds: float = 0.0
    """Seconds from the last kill to the last result."""
    left_processes: int = 0
    doctor: dict = field(default_factory=dict)

    def line(self) -> str:
        kills = ", ".join(f"{count} {kind}" for kind, count in sorted(self.kills.items()))
        return (
            f"{self.seconds:.0f} s, killed: {kills}; the network stalled {self.stalls} times; "
            f"{len(self.acknowledged)} jobs, {self.points} points, "
            f"{self.repeated} requests sent again, {self.lost_attempts} attempts lost; "
            f"{self._said('problems', JobKind.SOLVE)}; {self._said('chunks', JobKind.CHUNK)}; "
            f"jobs unfinished {self.unfinished}, lost {self.lost}, doubled {self.doubled}; "
            f"recovered in {self.recovery_seconds:.1f} s, processes left {self.left_processes}, "
            f"doctor {'clean' if self.doctor['clean'] else f'NOT CLEAN: {self.doctor}'}"
        )

    def _said(self, name: str, kind: JobKind) -> str:
        of = [each for each in self.taken_over if each.kind is kind]
        parts = (
            "{:.1f} s, p99 {:.1f}, most {:.1f} s".format(*np.quantile(seconds or [0.0], [0.5, 0.99, 1.0]))
            for seconds in ([each.seconds for each in of], [each.waiting for each in of])
        )
        return "{} {} taken over in {} ({} of waiting for a worker that took jobs)".format(
            len(of), name, *parts
        )


@dataclass(frozen=True)
class TakenOver:
    """A job that was claimed again after an attempt that was lost, or returned."""

    kind: JobKind
    """A chunk of a sweep waits behind all problems, until its lane is owed a job."""
    seconds: float
    """To the next claim: from the death of the worker if it was killed, else from the end of the attempt."""
    waiting: float
    """Seconds of these in which it might have been claimed: some worker took jobs, while in the others all
    had been killed and were starting; and the pause was over that a job has which was lost alone before."""


@dataclass(frozen=True)
class Plan:
    """How hard it storms. It ends when all three are reached."""

    seed: int
    jobs: int
    """To be acknowledged."""
    seconds: float
    kills: int = 0
    pause_seconds: float = 0.4
    """Mean time between two kills."""

    def is_done(self, passed: float, figures: Figures, client: Client) -> bool:
        return passed >= self.seconds and (
            # In a short storm the client is done long before: nobody need wait for it.
            not self.kills or (figures.kills.total() >= self.kills and not client.is_alive())
        )


def on_sqlite(plan: Plan, *, has_cluster: bool = False) -> Figures:
    with tempfile.TemporaryDirectory() as folder:
        url = url_of(Path(folder) / "storm.db")
        migrate(url)
        return storm(url, Path(folder), plan, has_cluster=has_cluster)


def on_postgres(plan: Plan, *, engine: str = "local", has_cluster: bool = False) -> Figures:
    """In the middle the server crashes as well. With the engine ``postgres`` there are two hosts."""

    def crash() -> None:
        server.stop("immediate")
        threading.Event().wait(AWAY_SECONDS)
        server.start()

    with tempfile.TemporaryDirectory() as folder, postgres_server() as server:
        url = server.url(server.create_database())
        migrate(url)
        return storm(url, Path(folder), plan, engine=engine, disaster=crash, has_cluster=has_cluster)


def on_two_hosts(plan: Plan) -> Figures:
    return on_postgres(plan, engine="postgres")


def on_cluster(plan: Plan) -> Figures:
    return on_sqlite(plan, has_cluster=True)


def on_cluster_and_postgres(plan: Plan) -> Figures:
    return on_postgres(plan, has_cluster=True)


def storm(
    url: str,
    folder: Path,
    plan: Plan,
    *,
    engine: str = "local",
    disaster: Callable[[], None] | None = None,
    has_cluster: bool = False,
) -> Figures:
    """Let it storm as planned, with a ``disaster`` in the middle; then wait until everything is done."""
    figures, chance = Figures(), random.Random(plan.seed)
    installation = Installation(url, folder, engine, has_cluster=has_cluster)
    database = Database(url)
    began = time.monotonic()
    try:
        wait_until(lambda: _is_ready(installation), RECOVERY_SECONDS)
        client = Client(installation, jobs=plan.jobs, seconds=plan.seconds)
        client.start()
        _rage(installation, figures, chance, plan, client, disaster)
        ended = time.monotonic()
        wait_until(lambda: _is_over(installation, client, database), RECOVERY_SECONDS + ended - began)
        figures.recovery_seconds = time.monotonic() - ended
        if client.fault is not None:
            raise client.fault
        figures.acknowledged, figures.repeated = client.acknowledged, client.repeated
        installation.stop()
        figures.left_processes = _left(installation)
        figures.doctor = json.loads(
            installation.run("doctor", "--json", "--all", "--seed", str(plan.seed)).stdout
        )
        _count(figures, database)
    finally:
        installation.clean_up()
        database.close()
    figures.seconds = time.monotonic() - began
    return figures


def _left(installation: Installation) -> int:
    """Return how many processes outlive the others; those that are about to end have a moment."""
    with contextlib.suppress(AssertionError):
        wait_until(lambda: not installation.processes(), 60.0)
    return len(installation.processes())


def _is_ready(installation: Installation) -> bool:
    with contextlib.suppress(OSError, HTTPException):
        return installation.call("GET", "/readyz")["status"] == "ok"
    return False


def _rage(
    installation: Installation,
    figures: Figures,
    chance: random.Random,
    plan: Plan,
    client: Client,
    disaster: Callable[[], None] | None,
) -> None:
    began = time.monotonic()
    # However few are killed, and however slow the machine: one of each of these.
    due = ["api", "worker", "child"]
    if installation.network is not None:
        due += ["scheduler", "nanny", "Dask worker", "network"]
    chance.shuffle(due)
    longest = plan.seconds * LONGEST + RECOVERY_SECONDS
    while (passed := time.monotonic() - began) < longest:
        if plan.is_done(passed, figures, client) and not due:
            return
        if disaster is not None and passed > plan.seconds / 2:
            disaster()
            disaster = None
        time.sleep(chance.expovariate(1 / plan.pause_seconds))
        processes = installation.processes()
        kinds = sorted({kind for _, kind in processes} | ({"network"} if installation.network else set()))
        # Only what is at work can lose something; a start that is killed has not begun.
        if "child" in kinds:
            first = next((kind for kind in due if kind in kinds), None)
            kind = first or chance.choices(kinds, [PREY[kind] for kind in kinds])[0]
            if kind == "network" and installation.network is not None:
                installation.network.stall()
                time.sleep(STALL_SECONDS)
                installation.network.resume()
                figures.stalls += 1
                due = [other for other in due if other != kind]
            elif kill(prey := chance.choice([pid for pid, of in processes if of == kind])):
                figures.deaths[prey] = time.time()
                figures.kills[kind] += 1
                due = [other for other in due if other != kind]
        installation.start_the_dead()


def _is_over(installation: Installation, client: Client, database: Database) -> bool:
    time.sleep(0.1)
    installation.start_the_dead()
    if client.is_alive():
        return False
    live = [state.value for state in JobState if state not in FINISHED]
    with database.read() as session:
        return not any(
            session.scalar(select(func.count()).where(table.state.in_(live))) for table in (JobRow, SweepRow)
        )


def _count(figures: Figures, database: Database) -> None:
    with database.read() as session:
        states: Counter[str | None] = Counter()
        for some in _batches(figures.acknowledged):
            states.update(session.scalars(select(JobRow.state).where(JobRow.id.in_(some))))
        succeeded = AttemptRow.outcome == AttemptOutcome.SUCCEEDED.value
        twice = (
            select(AttemptRow.job_id).where(succeeded).group_by(AttemptRow.job_id).having(func.count() > 1)
        )
        again = select(SolutionRow.job_id).group_by(SolutionRow.job_id).having(func.count() > 1)
        figures.doubled = len(session.scalars(twice.union(again)).all())
        lost = AttemptRow.outcome == AttemptOutcome.LOST.value
        figures.lost_attempts = session.scalar(select(func.count()).select_from(AttemptRow).where(lost)) or 0
        figures.taken_over = _taken_over(session, figures.deaths)
        sweeps = session.execute(select(SweepRow.state, SweepRow.done)).all()
    ended = sum(states[state.value] for state in FINISHED)
    figures.unfinished = len(figures.acknowledged) - ended
    figures.unfinished += sum(state != JobState.SUCCEEDED.value for state, _ in sweeps)
    figures.lost = len(figures.acknowledged) - states[JobState.SUCCEEDED.value]
    figures.points = sum(done for _, done in sweeps)


def _taken_over(session: Session, deaths: Mapping[int, float]) -> list[TakenOver]:
    following = aliased(AttemptRow)
    unended = AttemptOutcome.LOST.value, AttemptOutcome.RETURNED.value
    found = session.execute(
        select(JobRow.kind, AttemptRow, following.started_at)
        .select_from(AttemptRow)
        .join(JobRow, JobRow.id == AttemptRow.job_id)
        .join(following, following.job_id == AttemptRow.job_id)
        .where(following.number == AttemptRow.number + 1, AttemptRow.outcome.in_(unended))
    ).all()
    first_claim, last_claim = func.min(AttemptRow.started_at), func.max(AttemptRow.started_at)
    spans = session.execute(
        select(first_claim, last_claim).group_by(AttemptRow.worker).order_by(first_claim)
    ).all()
    taken_over = []
    for kind, attempt, began in found:
        ended = attempt.ended_at or began
        # The name of a worker has the number of its process.
        killed = deaths.get(int(attempt.worker.split(":")[-2]), ended)
        since = killed if attempt.started_at <= killed <= ended else ended
        working = [(first, last) for first, last in spans]
        waiting = _covered(since, ended, working) + _covered(ended + _pause(session, attempt), began, working)
        taken_over.append(TakenOver(JobKind(kind), began - since, waiting))
    return taken_over


def _pause(session: Session, attempt: AttemptRow) -> float:
    """Return how long a job paused at least after an attempt."""
    if attempt.outcome != AttemptOutcome.LOST.value:
        return 0.0
    lost = AttemptRow.outcome == AttemptOutcome.LOST.value, AttemptRow.number <= attempt.number
    losses = session.scalar(select(func.count()).where(AttemptRow.job_id == attempt.job_id, *lost)) or 0
    return pause_after(losses, float(SETTINGS["POLHODE_RETRY_SECONDS"]), -1.0)


def _covered(start: float, end: float, spans: list[tuple[float, float]]) -> float:
    """Return how much of a time lies within spans, which are in the order of their beginnings."""
    seconds, upto = 0.0, start
    for first, last in spans:
        seconds += max(0.0, min(last, end) - max(first, upto))
        upto = max(upto, last)
    return seconds


def _batches(ids: list[str]) -> Iterator[list[str]]:
    for start in range(0, len(ids), 500):
        yield ids[start : start + 500]
