"""Errors of requests about a job or its solution, one class per cause."""

from collections.abc import Sequence

from service.jobs.states import JobState


class JobNotFoundError(LookupError):
    """There is no job of that id."""

    def __init__(self, job_id: str) -> None:
        super().__init__(f"there is no job {job_id}")
        self.job_id = job_id


class JobFinishedError(Exception):
    """A job that has succeeded or failed cannot be cancelled."""

    def __init__(self, job_id: str, state: JobState) -> None:
        super().__init__(f"job {job_id} has already {state}: only queued and running jobs can be cancelled")
        self.job_id, self.state = job_id, state


class SolutionNotFoundError(LookupError):
    """There is no solution of that id."""

    def __init__(self, solution_id: str) -> None:
        super().__init__(f"there is no solution {solution_id}")
        self.solution_id = solution_id


class AuditNotFoundError(LookupError):
    """There is no audit of that id of that solution."""

    def __init__(self, solution_id: str, audit_id: str) -> None:
        super().__init__(f"there is no audit {audit_id} of a solution {solution_id}")


class AtlasNotFoundError(LookupError):
    """There is no atlas of that id."""

    def __init__(self, atlas_id: str) -> None:
        super().__init__(f"there is no atlas {atlas_id}; a job has one when it has succeeded in drawing it")


class StillAtWorkError(Exception):
    """A job or a sweep that has not finished cannot be deleted."""

    def __init__(self, kind: str, its_id: str, state: JobState) -> None:
        super().__init__(f"{kind} {its_id} is {state}: only finished ones can be deleted; cancel it first")
        self.state = state


class InUseError(Exception):
    """Something else refers to what should be deleted."""

    def __init__(self, what: str, referrers: Sequence[str], count: int) -> None:
        super().__init__(f"{what} cannot be deleted; number of those that refer to it: {count}")
        self.referrers = tuple(referrers)
