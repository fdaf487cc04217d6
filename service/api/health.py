"""/livez and /readyz: is the process alive, can it serve."""

from concurrent.futures import CancelledError
from http import HTTPStatus

from alembic.script import ScriptDirectory
from fastapi import APIRouter, Response
from sqlalchemy import text
from sqlalchemy.exc import SQLAlchemyError

from service.api.errors import ApiError
from service.api.queries import without_query
from service.api.resources import Inside, Resources
from service.api.responses import json_response, refusals
from service.examination import answer_ping
from service.sandbox import SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.solution import HealthOut
from service.storage.migration import migrations_folder

router = APIRouter(tags=["health"])

OK = "ok"
_PING_SECONDS = 5.0


@router.get("/livez", response_model=HealthOut, responses=refusals(), dependencies=[without_query])
def livez() -> Response:
    """Answer: the process serves."""
    return json_response(HealthOut(status="ok", checks={}))


@router.get("/readyz", response_model=HealthOut, responses=refusals(503), dependencies=[without_query])
def readyz(inside: Inside) -> Response:
    """Say whether the database is reachable and of this version, and verdicts can be reached."""
    checks = {"database": _database(inside), "sandbox": _sandbox(inside)}
    bad = [f"{name}: {said}" for name, said in checks.items() if said != OK]
    if bad:
        raise ApiError(HTTPStatus.SERVICE_UNAVAILABLE, "not_ready", "; ".join(bad), extras={"checks": checks})
    return json_response(HealthOut(status="ok", checks=checks))


def _database(inside: Resources) -> str:
    try:
        with inside.database.read() as session:
            stored = session.scalar(text("SELECT version_num FROM alembic_version"))
    except SQLAlchemyError:
        return "cannot be read, or has no tables; polhode migrate makes them"
    wanted = ScriptDirectory(str(migrations_folder())).get_current_head()
    return OK if stored == wanted else f"schema {stored}, needed is {wanted}; polhode migrate brings it there"


def _sandbox(inside: Resources) -> str:
    if not inside.sandbox.is_idle:
        return OK  # busy with verdicts, each of which has its limit
    try:
        inside.sandbox.run(answer_ping, seconds=_PING_SECONDS)
    except (SandboxTimeoutError, SandboxMemoryError, SandboxCrashError, CancelledError):
        return "no child process answers"
    return OK
