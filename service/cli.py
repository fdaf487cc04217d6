"""The command ``polhode``.

Exit codes: 0 done, 1 refused or failed with the reason on stderr, 2 wrong usage.
Heavy modules are imported by the commands that need them: ``polhode worker``
does not wait for the web framework.
"""

import json
import os
import signal
import socket
import sqlite3
import sys
from collections.abc import Callable, Mapping
from ipaddress import ip_address
from pathlib import Path
from types import FrameType
from typing import Annotated, NoReturn

import typer
from pydantic import ValidationError
from rich.console import Console

from service.jobs.wakeup import Doorbell
from service.local_workers import LocalWorkers, worker_environment
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.strict_json import InvalidJsonError, parse_json
from service.schemas.verdict_text import Answer, describe_verdict
from service.settings import Settings

REFUSED, WRONG_USAGE = 1, 2
LOG_LEVELS = ("critical", "error", "warning", "info", "debug")

FINISH_REQUESTS_SECONDS = 3
"""How long open requests may go on after a signal to stop."""

app = typer.Typer(
    name="polhode",
    help="Motions of a rigid body about a fixed point: verdicts, solutions and their database, as a service.",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)

DatabaseUrl = Annotated[
    str | None, typer.Option(help="SQLite or Postgres. POLHODE_DATABASE_URL, else sqlite:///polhode.db")
]
Document = Annotated[Path, typer.Argument(help="a JSON document", show_default=False)]
AsJson = Annotated[bool, typer.Option("--json", help="print JSON")]


def main() -> None:
    """Run the command line."""
    app()


@app.command()
def serve(
    host: Annotated[str | None, typer.Option(help="Loopback only. POLHODE_HOST, else 127.0.0.1")] = None,
    port: Annotated[int | None, typer.Option(help="0: any free one. POLHODE_PORT, else 8000")] = None,
    workers: Annotated[
        int | None, typer.Option(help="Jobs at the same time; 0: API only. POLHODE_WORKERS, else 1")
    ] = None,
    database_url: DatabaseUrl = None,
    log_level: Annotated[str, typer.Option(help=" | ".join(LOG_LEVELS))] = "warning",
) -> None:
    """Migrate the database, serve the API and run local workers until SIGTERM or SIGINT."""
    settings = _settings(host=host, port=port, workers=workers, database_url=database_url)
    if log_level not in LOG_LEVELS:
        _fail(f"--log-level {log_level}: accepted are {', '.join(LOG_LEVELS)}", WRONG_USAGE)
    if not _is_loopback(settings.host):
        _fail(
            f"host {settings.host}: the service asks nobody who they are, so only this machine may reach it; "
            "accepted are 127.0.0.1, ::1 and localhost",
            WRONG_USAGE,
        )
    signal.signal(signal.SIGTERM, _stop)
    signal.signal(signal.SIGINT, _stop)
    with _listen(settings.host, settings.port) as listener:
        _migrate(settings)
        _serve(settings, listener, log_level)


@app.command()
def worker(
    slots: Annotated[
        int | None, typer.Option(min=1, help="Jobs at the same time. POLHODE_WORKERS, else 1")
    ] = None,
    database_url: DatabaseUrl = None,
) -> None:
    """Compute queued jobs until SIGTERM or SIGINT."""
    settings = _settings(workers=slots, database_url=database_url)
    _become_worker(["run", "--slots", str(max(settings.workers, 1))], worker_environment(settings))


@app.command()
def migrate(database_url: DatabaseUrl = None) -> None:
    """Create the tables, or bring them to this version."""
    _migrate(_settings(database_url=database_url))


@app.command()
def validate(file: Document, as_json: AsJson = False) -> None:
    """Say whether a potential admits planar motions; of a whole problem, whether it can be solved."""
    from service.examination import examine_problem, examine_question  # noqa: PLC0415

    document = _read_document(file)
    is_problem = isinstance(document, dict) and "time" in document
    text = _examine(examine_problem if is_problem else examine_question, json.dumps(document))
    answer = Answer.model_validate_json(text)
    if as_json:
        found = json.loads(text)
        sys.stdout.write(json.dumps(found.get("error") or found["verdict"]) + "\n")
    if answer.error is not None:
        _fail(answer.error.reason(), REFUSED)
    if answer.verdict is None:
        _say("a state motion: its potential needs no verdict")
        return
    if not as_json:
        sys.stdout.write(f"{describe_verdict(answer.verdict)}\n")
    if answer.verdict.verdict != "admissible":
        _fail(f"the potential is {answer.verdict.verdict}", REFUSED)


@app.command()
def solve(
    file: Document,
    as_json: AsJson = False,
    csv: Annotated[Path | None, typer.Option(metavar="OUT", help="write the samples as CSV")] = None,
) -> None:
    """Solve one problem here and now, without a database."""
    options = ["--json"] if as_json else []
    if csv is not None:
        options += ["--csv", str(csv)]
    _become_worker(["solve", *options, "--", str(file)], os.environ)


@app.command()
def calibrate(
    quick: Annotated[bool, typer.Option("--quick", help="fewer problems, each measured once")] = False,
    as_json: AsJson = False,
    database_url: DatabaseUrl = None,
) -> None:
    """Measure what every tier of accuracy reaches and costs on this machine, and store the table."""
    settings = _settings(database_url=database_url)
    _migrate(settings)
    options = [name for name, given in (("--quick", quick), ("--json", as_json)) if given]
    _become_worker(["calibrate", *options], worker_environment(settings))


def _serve(settings: Settings, listener: socket.socket, log_level: str) -> None:
    import uvicorn  # noqa: PLC0415

    from service.app import create_app  # noqa: PLC0415

    doorbell = Doorbell()

    workers = LocalWorkers(settings, doorbell) if settings.workers else None

    class _Server(uvicorn.Server):
        def handle_exit(self, sig: int, frame: FrameType | None) -> None:
            if workers is not None:
                workers.expect_end()
            # Workers hear it and finish; whoever waits for a job is answered as things stand.
            doorbell.close()
            super().handle_exit(sig, frame)

    try:
        config = uvicorn.Config(
            create_app(settings, doorbell=doorbell),
            access_log=False,
            log_level=log_level,
            timeout_graceful_shutdown=FINISH_REQUESTS_SECONDS,
        )
        server = _Server(config)
        host, port = listener.getsockname()[:2]
        _say(f"serving http://{f'[{host}]' if ':' in host else host}:{port}, {settings.workers} workers")
        # It listens to signals itself while it runs, and raises them anew at its end: _stop exits with 0.
        server.run(sockets=[listener])
        if not server.started:
            raise typer.Exit(REFUSED)
    finally:
        if workers is not None:
            workers.stop()
        doorbell.close()


def _stop(number: int, frame: FrameType | None) -> NoReturn:
    raise SystemExit(0)


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except OSError as fault:
        _fail(f"cannot listen on {host} port {port}: {fault.strerror or fault}", REFUSED)


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def _settings(**given: object) -> Settings:
    """Return the settings, in which what was given on the command line comes first."""
    try:
        return Settings.model_validate(
            Settings().model_dump() | {name: value for name, value in given.items() if value is not None}
        )
    except ValidationError as fault:
        reasons = (
            f"{'_'.join(map(str, error['loc']))}: {error['msg']}" for error in fault.errors(include_url=False)
        )
        _fail("; ".join(reasons), WRONG_USAGE)


def _migrate(settings: Settings) -> None:
    from sqlalchemy.exc import SQLAlchemyError  # noqa: PLC0415

    from service.storage.migration import migrate  # noqa: PLC0415

    try:
        migrate(settings.database_url)
    except (SQLAlchemyError, sqlite3.Error, ImportError) as fault:
        # sqlite3.Error: its file cannot be opened. ImportError: the database's driver is not installed.
        reason = str(getattr(fault, "orig", None) or fault).splitlines()[0]
        _fail(f"cannot migrate the database: {reason}", REFUSED)


def _become_worker(arguments: list[str], environment: Mapping[str, str]) -> NoReturn:
    """Replace this process by one of the workers, which the service does not import."""
    os.execve(sys.executable, [sys.executable, "-m", "workers", *arguments], dict(environment))


def _read_document(file: Path) -> object:
    try:
        return parse_json(file.read_bytes())
    except OSError as fault:
        _fail(f"{file}: {fault.strerror}", REFUSED)
    except InvalidJsonError as fault:
        _fail(f"{file}: {fault}", REFUSED)


def _examine(examine: Callable[[str], str], document: str) -> str:
    """Examine a document in a child, so that no formula can keep the terminal."""
    settings = _settings()
    sandbox = Sandbox(1, memory_mb=settings.job_memory_mb, preload=[examine.__module__])
    try:
        with Console(stderr=True).status("examining …"):  # shows nothing where stderr is not a terminal
            return sandbox.run(examine, document, seconds=settings.verdict_seconds)
    except SandboxTimeoutError:
        _fail(f"no verdict within POLHODE_VERDICT_SECONDS = {settings.verdict_seconds:g}", REFUSED)
    except SandboxMemoryError:
        _fail(f"no verdict within POLHODE_JOB_MEMORY_MB = {settings.job_memory_mb}", REFUSED)
    except SandboxCrashError as fault:
        _fail(f"no verdict: {fault}", REFUSED)
    finally:
        sandbox.close()


def _fail(reason: str, code: int) -> NoReturn:
    _say(reason)
    raise typer.Exit(code)


def _say(line: str) -> None:
    sys.stderr.write(f"{line}\n")
