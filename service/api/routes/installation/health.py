"""GET /livez and /readyz: whether the process is alive, and whether it can serve."""

from concurrent.futures import CancelledError
from contextlib import suppress
from http import HTTPStatus

from fastapi import APIRouter, Response
from sqlalchemy.exc import SQLAlchemyError

from service.api.dependencies import Inside, Resources
from service.api.queries.queries import without_query
from service.api.replies.errors import ApiError
from service.api.replies.responses import json_response, refusals
from service.jobs.kernels import Kernels, most_missing
from service.sandbox import SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.replies.solution import CompilingOut, HealthOut, ReadinessOut
from service.storage.database.revisions import fault_of, stored_revision
from service.storage.database.sqlite_file import LOG_BYTES, DatabaseFileError
from service.storage.jobs.worker_registry import WorkerRegistry, WorkersState
from service.verdicts.examination import answer_ping

router = APIRouter(tags=["health"])

OK = "ok"
_PING_SECONDS = 5.0


@router.get("/livez", response_model=HealthOut, responses=refusals(), dependencies=[without_query])
async def get_liveness() -> Response:
    """Answer: the process serves."""
    return json_response(HealthOut(status="ok", checks={}))


@router.get("/readyz", response_model=ReadinessOut, responses=refusals(503), dependencies=[without_query])
async def get_readiness(inside: Inside) -> Response:
    """Tell whether the database can be read and written and has this version's schema, and verdicts work.

    A worker process that dies repeatedly is reported but does not count as unready: jobs are still accepted.
    So are workers that still start: `workers` says whether a job would be computed now; and so is a task that
    compiles kernels, with how far it is: until it ends jobs are solved without them.
    """
    told, workers, kernels = await inside.checks.get()
    checks = dict(told)
    bad = [f"{name}: {said}" for name, said in checks.items() if said != OK]
    if bad:
        raise ApiError(HTTPStatus.SERVICE_UNAVAILABLE, "not_ready", "; ".join(bad), extras={"checks": checks})
    if log := _log_of(inside):
        checks["write_ahead_log"] = log
    if inside.local_worker is not None:
        checks["worker"] = str(inside.local_worker())
    compiling = None
    if kernels is not None and kernels.fault is not None:
        checks["kernels"] = str(kernels)
    elif kernels is not None:
        compiling = CompilingOut(
            done=kernels.done, of=kernels.of, seconds=kernels.seconds, waits=kernels.waits
        )
    return json_response(ReadinessOut(status="ok", checks=checks, workers=workers, compiling=compiling))


def checks_of(inside: Resources) -> tuple[dict[str, str], WorkersState, Kernels | None]:
    """Look whether everything works; return what is wrong by part, the workers, and kernels they lack."""
    checks = {"database": _database(inside), "sandbox": _sandbox(inside)}
    if checks["database"] != OK:
        return checks, "none", None
    kernels = None
    with suppress(SQLAlchemyError):  # the next request says so
        registry = WorkerRegistry(inside.database, lease_seconds=inside.settings.lease_seconds)
        kernels = most_missing(registry.kernels())
    return checks, _workers(inside), kernels


def _log_of(inside: Resources) -> str | None:
    """Return how large SQLite's write-ahead log is, None if it is not larger than usual."""
    file = inside.database.file
    size = 0 if file is None else file.log_bytes()
    return None if size <= 2 * LOG_BYTES else f"{size / 1e6:.0f} MB, kept by a reader that stays open"


def _workers(inside: Resources) -> WorkersState:
    registry = WorkerRegistry(inside.database, lease_seconds=inside.settings.lease_seconds)
    try:
        state = registry.state()
    except SQLAlchemyError:  # the next request says so
        return "none"
    if state == "none" and inside.local_worker is not None and inside.local_worker().is_running:
        return "starting"  # it has not entered the database yet
    return state


def _database(inside: Resources) -> str:
    try:
        with inside.database.read() as session:
            stored = stored_revision(session.connection())
    except SQLAlchemyError as fault:
        lost = getattr(fault, "orig", None)
        return str(lost) if isinstance(lost, DatabaseFileError) else "cannot be read"
    if mismatch := fault_of(stored):
        return mismatch
    reason = inside.presence.fault()
    return OK if reason is None else f"cannot be written to: {reason}"


def _sandbox(inside: Resources) -> str:
    if not (inside.verdicts.is_idle and inside.sandbox.is_idle):
        return OK  # busy with verdicts, each of which has a time limit
    try:
        inside.sandbox.run(answer_ping, seconds=_PING_SECONDS)
    except (SandboxTimeoutError, SandboxMemoryError, SandboxCrashError, CancelledError):
        return "no child process answers"
    return OK
