"""Jobs, solutions and sweeps as they are shown, wherever they are."""

from service.jobs.records import Job, JobKind, JobState, SweepProgress, SweepRecord
from service.schemas.reading.annotation import Annotation
from service.schemas.reading.documents import Document
from service.schemas.replies.job import JobOut
from service.schemas.replies.solution import AuditOut, ComparisonOut, SolutionOut
from service.schemas.replies.sweep import SweepOut, SweepStateOut
from service.storage.solutions.result_store import Audit
from service.storage.solutions.solution_store import Solution

_ADDED_LATER: Document = {
    "asymptotes": None,
    "precession": None,
    "warnings": [],
    "errors": None,
    "error_kind": None,
    "known_cases": [],
}
"""Fields that solutions stored by the first version lack."""


def job_out(job: Job) -> JobOut:
    """Return a job as it is shown."""
    return JobOut(
        id=job.id,
        state=job.state.value,
        priority=job.priority,
        attempt=job.attempt,
        progress=job.progress,
        error=None if job.error is None else dict(job.error),
        reused=job.reused,
        solution=job.solution_id,
        atlas=job.id if job.kind is JobKind.ATLAS and job.state is JobState.SUCCEEDED else None,
        result=None if job.result is None else dict(job.result),
        problem=dict(job.problem),
        labels=dict(job.annotation.labels),
        note=job.annotation.note,
        created_at=job.created_at,
        started_at=job.started_at,
        finished_at=job.finished_at,
    )


def solution_out(solution: Solution) -> SolutionOut:
    """Return a solution as it is shown."""
    document = {
        **_ADDED_LATER,
        **solution.summary,
        "id": solution.id,
        "job": solution.job_id,
        "problem": solution.problem,
        **_annotation(solution.annotation),
        "created_at": solution.created_at,
    }
    return SolutionOut.model_validate(document)


def audit_out(audit: Audit) -> AuditOut:
    """Return an audit as it is shown."""
    job, comparison = audit.job, audit.comparison
    verdict = "failed" if job.state is JobState.FAILED else comparison and comparison["verdict"]
    document = {
        "id": job.id,
        "solution": audit.solution_id,
        "state": job.state.value,
        "verdict": verdict,
        "found": job.solution_id,
        "comparison": comparison and {name: comparison[name] for name in ComparisonOut.model_fields},
        "error": job.error,
        "problem": job.problem,
        "created_at": job.created_at,
        "finished_at": job.finished_at,
    }
    return AuditOut.model_validate(document)


def sweep_out(record: SweepRecord) -> SweepOut:
    """Return a sweep as it is shown, with its document."""
    own = {"document": dict(record.document), "provenances": list(map(dict, record.provenances))}
    return SweepOut.model_validate({**_state(record), **own})


def sweep_state_out(record: SweepProgress) -> SweepStateOut:
    """Return a sweep as lists show it."""
    return SweepStateOut.model_validate(_state(record))


def _state(record: SweepProgress) -> Document:
    return {
        "id": record.id,
        "state": record.state.value,
        "points": record.points,
        "done": record.done,
        "refused": record.refused,
        "progress": record.done / record.points,
        "point_seconds": record.point_seconds,
        "way": record.way,
        "remaining_seconds": record.remaining_seconds,
        "priority": record.priority,
        **_annotation(record.annotation),
        "created_at": record.created_at,
        "started_at": record.started_at,
        "finished_at": record.finished_at,
    }


def _annotation(annotation: Annotation) -> Document:
    return {"labels": dict(annotation.labels), "note": annotation.note}
