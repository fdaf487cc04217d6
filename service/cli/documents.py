"""``polhode validate``, ``solve`` and ``calibrate``: work that is done here and now."""

import json
import os
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
    settings_of,
)
from service.local_workers import worker_environment
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.verdict_text import Answer, describe_verdict
from service.terminal import answer, read_document, say


def validate(file: Document, as_json: AsJson = False) -> None:
    """Say whether a potential admits planar motions; of a whole problem, whether it can be solved."""
    from service.examination import examine_question, refusal_of_reading  # noqa: PLC0415
    from service.schemas.problem import read_question  # noqa: PLC0415

    document = read_document(file)
    refusal = refusal_of_reading(document, read_question)
    text = (
        _examine(examine_question, json.dumps(document))
        if refusal is None
        else json.dumps({"error": refusal})
    )
    judged = Answer.model_validate_json(text)
    if as_json:
        found = json.loads(text)
        answer(json.dumps(found.get("error") or _without_choice(found["verdict"], document)) + "\n")
    if judged.error is not None:
        fail(judged.error.reason(), REFUSED)
    if judged.verdict is None:
        say("a state motion: its potential needs no verdict")
        return
    if not as_json:
        answer(f"{describe_verdict(judged.verdict)}\n")
    if judged.verdict.verdict != "admissible":
        fail(f"the potential is {judged.verdict.verdict}", REFUSED)


def _without_choice(verdict: object, document: object) -> object:
    """Return the verdict without a plan if a budget was sent: what it chooses depends on an installation."""
    match verdict, document:
        case dict(), {"accuracy": {"budget_seconds": _}}:
            return {**verdict, "plan": None}
    return verdict


def solve(
    file: Document,
    as_json: AsJson = False,
    csv: Annotated[
        Path | None, typer.Option(metavar="OUT", help="write the samples as CSV; - is stdout")
    ] = None,
) -> None:
    """Solve one problem here and now, without a database."""
    options = ["--json"] if as_json else []
    if csv is not None:
        options.append(f"--csv={csv}")
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
