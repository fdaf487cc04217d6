"""The installation: its health, state, metrics, measured accuracy, catalogue, and its documentation."""

from collections.abc import Mapping
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import asdict
from functools import cache
from http import HTTPStatus
from importlib.resources import files
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response
from pydantic import Field
from sqlalchemy.exc import SQLAlchemyError

from service.api.dependencies import Checks, Inside, Resources
from service.api.prometheus import TEXT_FORMAT
from service.api.queries.queries import QueryModel, query_of, query_parameters, without_query
from service.api.replies import ApiError, json_response, refusals, tag_of_content
from service.catalogue import cases, classical, families
from service.dashboard.routes import HEADERS
from service.dynamics.accuracy import MotionKind
from service.dynamics.problem import Tier
from service.jobs.kernels import most_missing
from service.jobs.records import AttemptOutcome
from service.sandbox import SandboxError
from service.schemas.replies.installation import AccuracyOut, AccuracyRowOut, FamiliesOut, UnavailableOut
from service.schemas.replies.job import ClusterOut, StatusOut
from service.schemas.replies.solution import CompilingOut, HealthOut, ReadinessOut
from service.settings import Settings
from service.storage.database.availability import LOG_BYTES, DatabaseFileError
from service.storage.database.database import Database
from service.storage.database.migration import fault_of, stored_revision
from service.storage.solutions.accuracy_store import AccuracyStore
from service.storage.solutions.shipped_accuracy import shipped_comparison, shipped_costs
from service.storage.upkeep.presence import GONE_SECONDS, SILENT_LEASES, WorkerRegistry, WorkersState
from service.storage.upkeep.statistics import status_of
from service.verdicts.examination import answer_ping

router = APIRouter()

OK = "ok"
_PING_SECONDS = 5.0


@router.get(
    "/livez", tags=["health"], response_model=HealthOut, responses=refusals(), dependencies=[without_query]
)
async def get_liveness() -> Response:
    """Answer: the process serves."""
    return json_response(HealthOut(status="ok", checks={}))


@router.get(
    "/readyz",
    tags=["health"],
    response_model=ReadinessOut,
    responses=refusals(503),
    dependencies=[without_query],
)
async def get_readiness(inside: Inside) -> Response:
    """Tell whether the database can be read and written and has this version's schema, and verdicts work.

    A worker process that dies repeatedly is reported but does not count as unready: jobs are still accepted.
    So are workers that still start: `workers` says whether a job would be computed now; and so is a task that
    compiles kernels, with how far it is: until it ends jobs are solved without them.
    """
    shared, workers, kernels, cluster = await inside.checks.get()
    checks = dict(shared)
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
    shown = None if cluster is None else ClusterOut.model_validate(asdict(cluster))
    return json_response(
        ReadinessOut(status="ok", checks=checks, workers=workers, compiling=compiling, cluster=shown)
    )


def checks_of(inside: Resources) -> Checks:
    """Look whether everything works; return what is wrong by part, the workers, kernels, and the cluster.

    Of kernels those that a worker lacks, of several clusters the one with most threads.
    """
    checks = {"database": _database(inside), "sandbox": _sandbox(inside)}
    if checks["database"] != OK:
        return checks, "none", None, None
    kernels = cluster = None
    with suppress(SQLAlchemyError):  # the next request says so
        registry = WorkerRegistry(inside.database, lease_seconds=inside.settings.lease_seconds)
        kernels = most_missing(registry.kernels())
        cluster = next(reversed(registry.clusters()), None)
    return checks, _workers(inside), kernels, cluster


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
    except (SandboxError, CancelledError):
        return "no child process answers"
    return OK


@router.get(
    "/v1/status",
    tags=["status"],
    response_model=StatusOut,
    responses=refusals(),
    dependencies=[without_query],
)
def get_status(inside: Inside) -> Response:
    """Tell what waits, what each worker does, and how many jobs ended lately."""
    return json_response(status_document(inside.database, inside.settings))


def status_document(database: Database, settings: Settings) -> StatusOut:
    """Return the answer that shows the status."""
    seen_seconds = max(GONE_SECONDS, SILENT_LEASES * settings.lease_seconds)
    status = status_of(database, seen_seconds=seen_seconds)
    document = {
        "at": status.at,
        "queue": [asdict(part) for part in status.queue],
        "workers": [asdict(worker) for worker in status.workers],
        "rates": [
            {"minutes": rate.minutes, **{word.value: rate.by_outcome.get(word, 0) for word in AttemptOutcome}}
            for rate in status.rates
        ],
        "succeeded_by_minute": status.succeeded_by_minute,
    }
    return StatusOut.model_validate(document)


@router.get(
    "/metrics",
    tags=["health"],
    response_class=Response,
    responses={200: {"description": "Prometheus text format.", "content": {"text/plain": {}}}, **refusals()},
    dependencies=[without_query],
)
async def get_metrics(inside: Inside) -> Response:
    """Report jobs, sweeps, workers and requests to a Prometheus server."""
    return Response(await inside.metrics_text.get(), media_type=TEXT_FORMAT)


class AccuracyQuery(QueryModel):
    """The conditions on rows of the table."""

    tier: Tier | None = Field(default=None, description="Only rows of this tier.")
    kind: MotionKind | None = Field(
        default=None, description="Only this kind of motion: of a periodic planar one its ends."
    )

    def admits(self, row: AccuracyRowOut | UnavailableOut) -> bool:
        """Tell whether a row matches the query."""
        return self.tier in (None, row.tier) and self.kind in (None, row.kind)


@router.get(
    "/v1/accuracy",
    tags=["accuracy"],
    response_model=AccuracyOut,
    responses=refusals(),
    openapi_extra=query_parameters(AccuracyQuery),
)
def get_accuracy(
    query: Annotated[AccuracyQuery, Depends(query_of(AccuracyQuery))], inside: Inside
) -> Response:
    """Show the table of the latest `polhode calibrate`, or the shipped one if it was never run.

    Always shipped are `costs`: what a job, a request, a list and a sweep cost at each tier; and
    `comparison`: what other methods take and reach, and what each output adds.
    """
    current = AccuracyStore(inside.database).current()
    answer = AccuracyOut.beside(current, shipped_costs(), shipped_comparison())
    chosen = {
        "rows": [row for row in answer.rows if query.admits(row)],
        "unavailable": [row for row in answer.unavailable if query.admits(row)],
    }
    return json_response(answer.model_copy(update=chosen))


@router.get(
    "/v1/families",
    tags=["families"],
    response_model=FamiliesOut,
    responses=refusals(),
    dependencies=[without_query],
)
def list_families() -> Response:
    """List families, named and classical cases: conditions, parameters, sources, example problems."""
    return json_response(FamiliesOut(items=families(), cases=cases(), classical=classical()))


_PAGE = Path(__file__).with_name("page")
_SWAGGER_UI = "fastapi_swagger.resources"
"""The package that ships the files of Swagger UI."""
_DOCS: Mapping[str, tuple[Path | str, str, str]] = {
    "": (_PAGE, "docs.html", "text/html"),
    "/start.js": (_PAGE, "start.js", "text/javascript"),
    "/swagger-ui-bundle.js": (_SWAGGER_UI, "swagger-ui-bundle.js", "text/javascript"),
    "/swagger-ui.css": (_SWAGGER_UI, "swagger-ui.css", "text/css"),
    "/favicon-32x32.png": (_SWAGGER_UI, "favicon-32x32.png", "image/png"),
}
"""The interactive documentation of the API, with every file it needs, by paths below /docs."""


async def show_documentation(request: Request) -> Response:
    """Return a file of the documentation."""
    content, media_type, headers = _documentation(request.scope["path"].rpartition("/docs")[2])
    return Response(content, media_type=media_type, headers=headers)


for _path in _DOCS:
    router.add_api_route(
        f"/docs{_path}",
        show_documentation,
        methods=["GET", "HEAD"],
        dependencies=[without_query],
        include_in_schema=False,
    )


@cache
def _documentation(path: str) -> tuple[bytes, str, dict[str, str]]:
    folder, name, media_type = _DOCS[path]
    content = (files(folder) if isinstance(folder, str) else folder).joinpath(name).read_bytes()
    headers = {**HEADERS, "Cache-Control": "public, max-age=3600", "ETag": tag_of_content(content)}
    return content, media_type, headers
