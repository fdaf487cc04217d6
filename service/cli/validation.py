"""Examines a document for ``polhode validate``, in a child process that can be killed."""

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from rich.console import Console

from service.cli.common import REFUSED, WRONG_USAGE, fail, settings_of
from service.sandbox import Sandbox, SandboxCrashError, SandboxError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.problem.problem import read_question
from service.schemas.replies.text import Answer, describe_verdict
from service.settings import Settings
from service.terminal import answer, read_document, say
from service.typesetting.equations import FORMATS, Format
from service.verdicts.examination import examine_question
from service.verdicts.formulas import examine_question_with_formulas, simplify_formula, with_simplified
from service.verdicts.refusals import refusal_of_reading


@contextmanager
def examining(settings: Settings, module: str) -> Iterator[Sandbox]:
    """Provide a child that has ``module`` loaded; a limit that it exceeds ends the command."""
    sandbox = Sandbox(1, memory_mb=settings.job_memory_mb, preload=[module])
    try:
        with Console(stderr=True).status("examining …"):  # shows nothing where stderr is not a terminal
            yield sandbox
    except SandboxTimeoutError:
        fail(f"no verdict within POLHODE_VERDICT_SECONDS = {settings.verdict_seconds:g}", REFUSED)
    except SandboxMemoryError:
        fail(f"no verdict within POLHODE_JOB_MEMORY_MB = {settings.job_memory_mb}", REFUSED)
    except SandboxCrashError as fault:
        fail(f"no verdict: {fault}", REFUSED)
    finally:
        sandbox.close()


def validate_file(file: Path, *, as_json: bool, formulas: str | None) -> None:
    """Print the verdict on the document of a file, and exit with 1 if it is refused or not admissible."""
    formats = _formats(formulas)
    document = read_document(file)
    refusal = refusal_of_reading(document, read_question)
    text = json.dumps({"error": refusal}) if refusal is not None else _examined(document, formats)
    judged = Answer.model_validate_json(text)
    if as_json:
        result = json.loads(text)
        answer(json.dumps(result.get("error") or _without_choice(result["verdict"], document)) + "\n")
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


def _formats(request: str | None) -> list[Format]:
    names = [] if request is None else request.split(",")
    unknown = [name for name in names if name not in FORMATS]
    if unknown:
        fail(f"--formulas: {unknown[0]!r} is not accepted; accepted are {', '.join(FORMATS)}", WRONG_USAGE)
    return [each for each in FORMATS if each in names]


def _examined(document: object, formats: Sequence[Format]) -> str:
    """Examine a document in a child process, so that no formula can block the terminal."""
    settings = settings_of()
    with examining(settings, examine_question.__module__) as sandbox:
        if not formats:
            return sandbox.run(examine_question, json.dumps(document), seconds=settings.verdict_seconds)
        request = json.dumps({"document": document, "formats": formats})
        text = sandbox.run(examine_question_with_formulas, request, seconds=settings.verdict_seconds)
        return _simplified(sandbox, text, settings.formula_seconds)


def _simplified(sandbox: Sandbox, text: str, seconds: float) -> str:
    """Return the answer with its formulas simplified, as far as there is time."""
    result = json.loads(text)
    if result.get("verdict") is None:
        return text
    answers: list[str] = []
    deadline = time.monotonic() + seconds
    for work in result["verdict"]["works"]:
        rest = deadline - time.monotonic()
        if rest <= 0:
            break
        with suppress(SandboxError):
            answers.append(sandbox.run(simplify_formula, work, seconds=rest, crashes=0))
    return json.dumps({**result, "verdict": with_simplified(result["verdict"], answers)})
