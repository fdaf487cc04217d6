"""A runner with one place and the test's own loop, for jobs that share calls."""

from service.jobs.queue import Lane
from service.jobs.records import AttemptOutcome, JobState
from service.storage.database.rows import new_id
from service.storage.jobs.job_store import JobStore
from tests.support.waiting import wait_until
from workers.process.pool import Pool
from workers.process.results import JobLimits
from workers.process.runner import Runner

LIMITS = JobLimits(lease_seconds=3600.0, job_seconds=3600.0, memory_mb=300, max_attempts=3, retry_seconds=0)


class Together:
    """A runner whose loop is the test's."""

    def __init__(self, jobs: JobStore, pool: Pool, limits: JobLimits) -> None:
        self.jobs = jobs
        self.runner = Runner(jobs, pool, name="worker", limits=limits)
        self.batches: list[int] = []
        self.told: list[str] = []

    def submit(self, *problems: dict) -> list[str]:
        made = self.jobs.submit_many([(problem, new_id()) for problem in problems], lane=Lane.LIST)
        return [job.id for job in made]

    def turn(self) -> None:
        self.told += self.runner.collect(refill=True)
        self.runner.keep_leases()
        self.runner.reconcile()
        self.told += self.runner.fill()

    def finish(self, ids: list[str]) -> list[JobState]:
        def are_finished() -> bool:
            self.turn()
            return all(self.jobs.get(job_id).is_finished for job_id in ids)

        wait_until(are_finished)
        return [self.jobs.get(job_id).state for job_id in ids]

    def outcomes(self, job_id: str) -> list[AttemptOutcome]:
        return [attempt.outcome for attempt in self.jobs.attempts(job_id)]
