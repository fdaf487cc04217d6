"""``polhode validate``, ``solve``, ``compile`` and ``calibrate``: commands that need no service."""

import json
import os
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from service.cli.children import examining
from service.cli.common import (
    REFUSED,
    WRONG_USAGE,
    AsJson,
    DatabaseUrl,
    Document,
    become_worker,
    fail,
    migrate_database,
    settings_of,
)
from service.local.workers import worker_environment
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.replies.verdict_text import Answer, describe_verdict
from service.terminal import answer, read_document, say
from service.typesetting.equations import FORMATS, Format


def validate(
    file: Document,
    as_json: AsJson = False,
    formulas: Annotated[
        str | None,
        typer.Option(metavar="FORMATS", help="the formulas as text,latex,mathml, simplified where possible"),
    ] = None,
) -> None:
    """Tell whether a potential admits planar motions, or whether a whole problem can be solved."""
    from service.schemas.problem.problem import read_question  # noqa: PLC0415
    from service.verdicts.refusals import refusal_of_reading  # noqa: PLC0415

    formats = _formats(formulas)
    document = read_document(file)
    refusal = refusal_of_reading(document, read_question)
    text = json.dumps({"error": refusal}) if refusal is not None else _examined(document, formats)
    judged = Answer.model_validate_json(text)
    if as_json:
        found = json.loads(text)
        answer(json.dumps(found.get("error") or _without_choice(found["verdict"], document)) + "\n")
    if judged.error is not None:
        fail(judged.error.reason(), REFUSED)
    if judged.verdict is None:
        say("a motion from any state: its potential needs no verdict")
        return
    if not as_json:
        answer(f"{describe_verdict(judged.verdict, formats)}\n")
    if judged.verdict.verdict != "admissible":
        fail(f"the potential is {judged.verdict.verdict}", REFUSED)


def _without_choice(verdict: object, document: object) -> object:
    """Drop the plan of a problem with a budget: the tier depends on an installation's accuracy table."""
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
    """Solve one problem in this terminal, without a database."""
    options = ["--json"] if as_json else []
    if csv is not None:
        options.append(f"--csv={csv}")
    become_worker(["solve", *options, "--", str(file)], os.environ)


def compile_solvers() -> None:
    """Compile the fast solvers, which takes a minute or two, so that the first job does not wait for it."""
    become_worker(["compile"], os.environ)


def calibrate(
    quick: Annotated[bool, typer.Option("--quick", help="fewer problems, each measured once")] = False,
    as_json: AsJson = False,
    database_url: DatabaseUrl = None,
) -> None:
    """Measure the error and the time of every tier on this machine, and store the table."""
    settings = settings_of(database_url=database_url)
    migrate_database(settings)
    options = [name for name, given in (("--quick", quick), ("--json", as_json)) if given]
    become_worker(["calibrate", *options], worker_environment(settings))


def _formats(asked: str | None) -> list[Format]:
    names = [] if asked is None else asked.split(",")
    unknown = [name for name in names if name not in FORMATS]
    if unknown:
        fail(f"--formulas: {unknown[0]!r} is not accepted; accepted are {', '.join(FORMATS)}", WRONG_USAGE)
    return [each for each in FORMATS if each in names]


def _examined(document: object, formats: Sequence[Format]) -> str:
    """Examine a document in a child process, so that no formula can block the terminal."""
    from service.verdicts.examination import examine_question  # noqa: PLC0415
    from service.verdicts.formulas import examine_question_with_formulas  # noqa: PLC0415

    settings = settings_of()
    with examining(settings, examine_question.__module__) as sandbox:
        if not formats:
            return sandbox.run(examine_question, json.dumps(document), seconds=settings.verdict_seconds)
        asked = json.dumps({"document": document, "formats": formats})
        text = sandbox.run(examine_question_with_formulas, asked, seconds=settings.verdict_seconds)
        return _simplified(sandbox, text, settings.formula_seconds)


def _simplified(sandbox: Sandbox, text: str, seconds: float) -> str:
    """Return the answer with its formulas simplified, as far as there is time."""
    from service.verdicts.formulas import simplify_formula, with_simplified  # noqa: PLC0415

    found = json.loads(text)
    if found.get("verdict") is None:
        return text
    answers: list[str] = []
    deadline = time.monotonic() + seconds
    for work in found["verdict"]["works"]:
        rest = deadline - time.monotonic()
        if rest <= 0:
            break
        with suppress(SandboxTimeoutError, SandboxMemoryError, SandboxCrashError):
            answers.append(sandbox.run(simplify_formula, work, seconds=rest, crashes=0))
    return json.dumps({**found, "verdict": with_simplified(found["verdict"], answers)})
