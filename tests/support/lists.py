"""Lists of jobs and sweeps as tests look at them: newest first."""

from service.jobs.records import JobPage, JobState, SweepPage
from service.schemas.query.terms import ListQuery, in_state
from service.storage.jobs.job_store import JobStore
from service.storage.sweeps.sweep_store import SweepStore


def list_jobs(jobs: JobStore, *, state: JobState | None = None, limit: int = 50, offset: int = 0) -> JobPage:
    return jobs.find(ListQuery(in_state(state), limit=limit, offset=offset))


def list_sweeps(
    sweeps: SweepStore, *, state: JobState | None = None, limit: int = 50, offset: int = 0
) -> SweepPage:
    return sweeps.find(ListQuery(in_state(state), limit=limit, offset=offset))
