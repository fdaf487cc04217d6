"""``polhode validate``, ``solve`` and ``calibrate``: work that is done here and now."""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from service.cli.common import (
    REFUSED,
    AsJson,
    DatabaseUrl,
    Document,
    become_worker,
    fail,
    migrate_database,
    say,
    settings_of,
)
from service.local_workers import worker_environment
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.strict_json import InvalidJsonError, parse_json
from service.schemas.verdict_text import Answer, describe_verdict


def validate(file: Document, as_json: AsJson = False) -> None:
    """Say whether a potential admits planar motions; of a whole problem, whether it can be solved."""
    from service.examination import examine_problem, examine_question  # noqa: PLC0415

    document = read_document(file)
    is_problem = isinstance(document, dict) and "time" in document
    text = _examine(examine_problem if is_problem else examine_question, json.dumps(document))
    answer = Answer.model_validate_json(text)
    if as_json:
        found = json.loads(text)
        sys.stdout.write(json.dumps(found.get("error") or found["verdict"]) + "\n")
    if answer.error is not None:
        fail(answer.error.reason(), REFUSED)
    if answer.verdict is None:
        say("a state motion: its potential needs no verdict")
        return
    if not as_json:
        sys.stdout.write(f"{describe_verdict(answer.verdict)}\n")
    if answer.verdict.verdict != "admissible":
        fail(f"the potential is {answer.verdict.verdict}", REFUSED)


def solve(
    file: Document,
    as_json: AsJson = False,
    csv: Annotated[Path | None, typer.Option(metavar="OUT", help="write the samples as CSV")] = None,
) -> None:
    """Solve one problem here and now, without a database."""
    options = ["--json"] if as_json else []
    if csv is not None:
        options += ["--csv", str(csv)]
    become_worker(["solve", *options, "--", str(file)], os.environ)


def compile_solvers() -> None:
    """Compile the fast solvers now, half a minute of work that the first job had to wait for else."""
    become_worker(["compile"], os.environ)


def calibrate(
    quick: Annotated[bool, typer.Option("--quick", help="fewer problems, each measured once")] = False,
    as_json: AsJson = False,
    database_url: DatabaseUrl = None,
) -> None:
    """Measure what every tier of accuracy reaches and costs on this machine, and store the table."""
    settings = settings_of(database_url=database_url)
    migrate_database(settings)
    options = [name for name, given in (("--quick", quick), ("--json", as_json)) if given]
    become_worker(["calibrate", *options], worker_environment(settings))


def read_document(file: Path) -> object:
    """Return the JSON document of a file, or end with what is wrong with it."""
    try:
        return parse_json(file.read_bytes())
    except OSError as fault:
        fail(f"{file}: {fault.strerror}", REFUSED)
    except InvalidJsonError as fault:
        fail(f"{file}: {fault}", REFUSED)


def _examine(examine: Callable[[str], str], document: str) -> str:
    """Examine a document in a child, so that no formula can keep the terminal."""
    settings = settings_of()
    sandbox = Sandbox(1, memory_mb=settings.job_memory_mb, preload=[examine.__module__])
    try:
        with Console(stderr=True).status("examining …"):  # shows nothing where stderr is not a terminal
            return sandbox.run(examine, document, seconds=settings.verdict_seconds)
    except SandboxTimeoutError:
        fail(f"no verdict within POLHODE_VERDICT_SECONDS = {settings.verdict_seconds:g}", REFUSED)
    except SandboxMemoryError:
        fail(f"no verdict within POLHODE_JOB_MEMORY_MB = {settings.job_memory_mb}", REFUSED)
    except SandboxCrashError as fault:
        fail(f"no verdict: {fault}", REFUSED)
    finally:
        sandbox.close()
