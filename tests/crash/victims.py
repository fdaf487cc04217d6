"""Processes that do one thing to a database and are killed at one of their commits.

``python -m tests.crash.victims`` reads a line for each: the fault, the URL and
the name of what to do. It forks, so that a victim lives for some milliseconds,
and answers with how the victim ended.
"""

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from sqlalchemy.orm import configure_mappers

from service.jobs.records import Claim, JobKind, JobResult, Refused, Solved
from service.schemas.reading.documents import Annotation
from service.storage.codecs.packing import encode_document
from service.storage.database.database import VARIABLE, Database
from service.storage.database.rows import new_id
from service.storage.jobs.job_store import JobStore
from service.storage.keys import GivenAnswer, GivenKey, KeyTakenError, Receipt
from service.storage.solutions.result_store import AuditStore, ResultStore
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.upkeep import retention
from tests.support.databases import PROBLEM, SUMMARY
from tests.workers.chores import do_chunk
from tests.workers.processes import ROOT

RETRIES = {"max_attempts": 3, "retry_seconds": 0.0}
GIVING_UP = {"max_attempts": 1, "retry_seconds": 0.0}
ANNOTATION = Annotation({"project": "thesis", "run": "7"}, "first try")
SOLVED = Solved(SUMMARY, b"dense", b"samples")
COMPARISON = {"verdict": "agrees", "stored": dict(SUMMARY)}
ATLAS = {"lambda": [1, 2]}
ERROR = {"code": "no_motion", "detail": "there is none"}
OVER = 0.0
"""A lease that has ended when it is granted, so that nobody need wait for its end."""


@dataclass(frozen=True)
class Stores:
    database: Database
    jobs: JobStore
    sweeps: SweepStore
    audits: AuditStore
    atlases: ResultStore

    def claim(self) -> Claim:
        claim = self.jobs.claim("victim", lease_seconds=OVER)
        assert claim is not None
        return claim

    def submitted(self) -> str:
        return self.jobs.submit(PROBLEM, new_id()).id

    def swept(self, points: int) -> str:
        return self.sweeps.submit({"seconds": 0.01}, points=points, most=20).id

    def finish(self, claim: Claim) -> None:
        comparison = None if claim.audited is None else COMPARISON
        assert self.jobs.finish(claim, replace(SOLVED, comparison=comparison))[0]

    def finish_atlas(self, claim: Claim) -> None:
        assert self.jobs.finish(claim, JobResult(encode_document(ATLAS)))[0]

    def finish_chunk(self, claim: Claim, points: int | None = None) -> None:
        payload = dict(claim.payload)
        payload["count"] = points or payload["count"]
        assert self.jobs.finish(claim, do_chunk(json.dumps(payload)))[0]


def submit(stores: Stores) -> None:
    stores.submitted()


def submit_marked(stores: Stores) -> None:
    stores.jobs.submit_many([(PROBLEM, new_id())] * 2, annotations=[ANNOTATION, Annotation(note="second")])


def succeed_marked(stores: Stores) -> None:
    stores.jobs.submit(PROBLEM, new_id(), annotation=ANNOTATION)
    stores.finish(stores.claim())


def annotate_job(stores: Stores) -> None:
    stores.jobs.submit(PROBLEM, new_id(), annotation=ANNOTATION)
    job_id = stores.claim().job_id
    stores.jobs.annotate(
        job_id, lambda job: Annotation({"project": "other", "new": job.annotation.labels["run"]}, "changed")
    )


def annotate_sweep(stores: Stores) -> None:
    sweep_id = stores.sweeps.submit({"seconds": 0.01}, points=50, most=20, annotation=ANNOTATION).id
    stores.sweeps.annotate(sweep_id, lambda _: Annotation({"run": "8"}))


def submit_many(stores: Stores) -> None:
    stores.jobs.submit_many([(PROBLEM, new_id()) for _ in range(5)])


def receipt() -> Receipt:
    return Receipt(GivenKey("", new_id(), "print"), lambda made: GivenAnswer(202, {}, repr(made).encode()))


def submit_once(stores: Stores) -> None:
    stores.jobs.submit(PROBLEM, new_id(), receipt=receipt())


def submit_sweep_once(stores: Stores) -> None:
    stores.sweeps.submit({"seconds": 0.01}, points=50, most=20, receipt=receipt())


def submit_taken(stores: Stores) -> None:
    taken = receipt()
    stores.jobs.submit_many([(PROBLEM, new_id())] * 2, receipt=taken)
    with contextlib.suppress(KeyTakenError):
        stores.jobs.submit(PROBLEM, new_id(), receipt=taken)


def claim(stores: Stores) -> None:
    stores.submitted()
    stores.claim()


def claim_many(stores: Stores) -> None:
    submit_many(stores)
    assert len(stores.jobs.take("victim", 3, lease_seconds=OVER).claims) == 3


def cancel_queued(stores: Stores) -> None:
    stores.jobs.cancel(stores.submitted())


def cancel_running(stores: Stores) -> None:
    job_id = stores.submitted()
    stores.claim()
    stores.jobs.cancel(job_id)


def heartbeat(stores: Stores) -> None:
    stores.submitted()
    assert stores.jobs.heartbeat([stores.claim()], lease_seconds=OVER)


def succeed(stores: Stores) -> None:
    stores.submitted()
    stores.finish(stores.claim())


def reuse(stores: Stores) -> None:
    digest = new_id()
    stores.jobs.submit_many([(PROBLEM, digest)] * 2)
    stores.finish(stores.claim())
    assert stores.jobs.take("victim", 1, lease_seconds=OVER).reused


def succeed_and_take(stores: Stores) -> None:
    stores.submitted()
    stores.submitted()
    kept, taken = stores.jobs.finish(stores.claim(), SOLVED, then_take=1, lease_seconds=OVER)
    assert kept
    assert len(taken.claims) == 1


def succeed_and_reuse(stores: Stores) -> None:
    stores.jobs.submit_many([(PROBLEM, new_id())] * 2)
    kept, taken = stores.jobs.finish(stores.claim(), SOLVED, then_take=1, lease_seconds=OVER)
    assert kept
    assert len(taken.reused) == 1


def end_several_and_take(stores: Stores) -> None:
    stores.jobs.submit_many([(PROBLEM, new_id()) for _ in range(8)], annotations=[ANNOTATION] * 8)
    claims = stores.jobs.take("victim", 1, lease_seconds=OVER, together=4).claims
    ended = [(claim, SOLVED) for claim in claims[:3]] + [(claims[3], Refused(ERROR))]
    kept, taken = stores.jobs.finish_problems(ended, then_take=1, lease_seconds=OVER, together=3)
    assert len(kept) == 4
    assert len(taken.claims) == 3


def fail(stores: Stores) -> None:
    stores.submitted()
    assert stores.jobs.finish_failure(stores.claim(), ERROR)


def lose(stores: Stores) -> None:
    stores.submitted()
    assert stores.jobs.lose(stores.claim(), "died", **RETRIES)


def lose_for_good(stores: Stores) -> None:
    stores.submitted()
    assert stores.jobs.lose(stores.claim(), "died", **GIVING_UP)


def give_back(stores: Stores) -> None:
    stores.submitted()
    assert stores.jobs.give_back(stores.claim())


def reconcile(stores: Stores) -> None:
    stores.submitted()
    stores.claim()
    assert stores.jobs.reconcile(**RETRIES)


def reconcile_for_good(stores: Stores) -> None:
    stores.submitted()
    stores.claim()
    assert stores.jobs.reconcile(**GIVING_UP)


def submit_sweep(stores: Stores) -> None:
    stores.swept(50)


def cancel_sweep(stores: Stores) -> None:
    sweep_id = stores.swept(50)
    stores.finish_chunk(stores.claim())
    stores.claim()
    stores.sweeps.cancel(sweep_id)


def finish_pilot(stores: Stores) -> None:
    stores.swept(50)
    stores.finish_chunk(stores.claim())


def finish_part(stores: Stores) -> None:
    stores.swept(50)
    stores.finish_chunk(stores.claim(), points=5)


def finish_sweep(stores: Stores) -> None:
    stores.swept(3)
    stores.finish_chunk(stores.claim())


def split_chunk(stores: Stores) -> None:
    stores.swept(50)
    assert stores.jobs.finish_failure(stores.claim(), ERROR)


def refuse_point(stores: Stores) -> None:
    stores.swept(1)
    assert stores.jobs.finish_failure(stores.claim(), ERROR)


def lose_chunk_for_good(stores: Stores) -> None:
    stores.swept(50)
    stores.claim()
    assert stores.jobs.reconcile(**GIVING_UP)


def solved_id(stores: Stores) -> str:
    job_id = stores.submitted()
    stores.finish(stores.claim())
    solution_id = stores.jobs.get(job_id).solution_id
    assert solution_id is not None
    return solution_id


def submit_audit(stores: Stores) -> None:
    stores.audits.submit(solved_id(stores), PROBLEM, new_id(), receipt=receipt())


def succeed_audit(stores: Stores) -> None:
    stores.audits.submit(solved_id(stores), PROBLEM, new_id())
    stores.finish(stores.claim())


def fail_audit(stores: Stores) -> None:
    stores.audits.submit(solved_id(stores), PROBLEM, new_id())
    assert stores.jobs.finish_failure(stores.claim(), ERROR)


def lose_audit(stores: Stores) -> None:
    stores.audits.submit(solved_id(stores), PROBLEM, new_id())
    stores.claim()
    assert stores.jobs.reconcile(**RETRIES)


def submit_atlas(stores: Stores) -> None:
    stores.atlases.submit(JobKind.ATLAS, ATLAS, new_id(), receipt=receipt())


def succeed_atlas(stores: Stores) -> None:
    stores.atlases.submit(JobKind.ATLAS, ATLAS, new_id())
    stores.finish_atlas(stores.claim())


def delete_drawn(stores: Stores) -> None:
    job_id = stores.atlases.submit(JobKind.ATLAS, ATLAS, new_id()).id
    stores.finish_atlas(stores.claim())
    retention.delete_job(stores.database, job_id)


def delete_audited(stores: Stores) -> None:
    solution_id = solved_id(stores)
    stores.jobs.cancel(stores.audits.submit(solution_id, PROBLEM, new_id()).id)
    retention.delete_solution(stores.database, solution_id)


def delete_job(stores: Stores) -> None:
    job_id = stores.submitted()
    stores.jobs.cancel(job_id)
    retention.delete_job(stores.database, job_id)


def delete_solution(stores: Stores) -> None:
    retention.delete_solution(stores.database, solved_id(stores))


def delete_sweep(stores: Stores) -> None:
    sweep_id = stores.swept(50)
    stores.finish_chunk(stores.claim())
    stores.sweeps.cancel(sweep_id)
    retention.delete_sweep(stores.database, sweep_id)


DEEDS: tuple[Callable[[Stores], None], ...] = (
    end_several_and_take,
    submit, submit_many, submit_once, submit_sweep_once, submit_taken, submit_marked, succeed_marked,
    annotate_job, annotate_sweep,
    claim, claim_many, cancel_queued, cancel_running, heartbeat, succeed, reuse,
    succeed_and_take, succeed_and_reuse, fail, lose, lose_for_good, give_back, reconcile, reconcile_for_good,
    submit_sweep, cancel_sweep, finish_pilot, finish_part, finish_sweep, split_chunk, refuse_point,
    lose_chunk_for_good, submit_audit, succeed_audit, fail_audit, lose_audit, delete_audited,
    submit_atlas, succeed_atlas, delete_drawn,
    delete_job, delete_solution, delete_sweep,
)  # fmt: skip
"""Everything that the API and the workers do to jobs and sweeps; each ends with the commit of its name."""


@contextmanager
def stores_of(url: str) -> Iterator[Stores]:
    database = Database(url)
    audits, atlases = AuditStore(database), ResultStore(database)
    yield Stores(database, JobStore(database), SweepStore(database), audits, atlases)
    database.close()


class Executioner:
    """Starts victims, one at a time."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )

    def __call__(self, deed: Callable[[Stores], None], url: str, fault: str = "") -> int:
        """Return how the victim ended: 0, or minus the signal that killed it."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps([deed.__name__, url, fault]) + "\n")
        self._process.stdin.flush()
        return int(self._process.stdout.readline())

    def close(self) -> None:
        self._process.communicate()


def _become_victim(deed: str, url: str, fault: str) -> int:
    if fault:
        os.environ[VARIABLE] = fault
    with stores_of(url) as stores:
        next(each for each in DEEDS if each.__name__ == deed)(stores)
    return 0


def main() -> None:
    configure_mappers()  # once, not in every victim
    for line in sys.stdin:
        pid = os.fork()
        if pid == 0:
            code = 1
            try:
                code = _become_victim(*json.loads(line))
            finally:
                os._exit(code)
        _, status = os.waitpid(pid, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
