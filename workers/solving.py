"""``python -m workers solve FILE``: one problem, here and now, without a database."""

import argparse
import json
from pathlib import Path

from rich.console import Console

from service.examination import refusal_of_reading
from service.jobs.outcome import SolveOutcome
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.problem import read_problem
from service.settings import Settings, read_settings
from service.storage.solutions.codec import decode_arrays
from service.terminal import STANDARD_STREAM, OutputFile, answer, check_writable, read_document, say
from workers.computation import solve_checked
from workers.presentation import describe, to_csv


def solve(options: argparse.Namespace) -> int:
    """Solve the problem of a file and print what was found; 0 if it was solved, 1 if not."""
    csv: Path | None = options.csv
    if csv == STANDARD_STREAM and options.json:
        say("--json and --csv - both write to stdout; accepted is one of them")
        return 2
    settings = read_settings()
    document = read_document(options.file)
    if csv is not None:
        check_writable(csv)
    refusal = refusal_of_reading(document, read_problem)
    if refusal is not None:
        say(_reason(refusal))
        return 1
    outcome = _compute(json.dumps(document), settings)
    if outcome.error is not None or outcome.summary is None:
        say(_reason(outcome.error or {}))
        return 1
    columns = decode_arrays(outcome.samples)
    if csv is not None:
        with OutputFile(csv) as file:
            file.write(to_csv(columns).encode())
    if options.json:
        series = {name: values.tolist() for name, values in columns.items()}
        answer(json.dumps({**outcome.summary, "columns": series}, allow_nan=False) + "\n")
    elif csv == STANDARD_STREAM:
        say(describe(outcome.summary, columns))
    else:
        answer(describe(outcome.summary, columns) + "\n")
    return 0


def _compute(document: str, settings: Settings) -> SolveOutcome:
    """Run the computation in a child with the limits of a job, and a sign of life for a person."""
    console = Console(stderr=True)
    sandbox = Sandbox(1, memory_mb=settings.job_memory_mb, preload=["workers.computation"])
    try:
        with console.status("solving …"):  # shows nothing where stderr is not a terminal
            return sandbox.run(solve_checked, document, seconds=settings.job_seconds)
    except SandboxTimeoutError:
        detail = f"not solved within POLHODE_JOB_SECONDS = {settings.job_seconds:g}"
        return _failed("time_limit", detail)
    except SandboxMemoryError:
        return _failed(
            "memory_limit", f"more memory needed than POLHODE_JOB_MEMORY_MB = {settings.job_memory_mb}"
        )
    except SandboxCrashError as fault:
        return _failed("lost_worker", f"the computation's process died: {fault}")
    finally:
        sandbox.close()


def _failed(code: str, detail: str) -> SolveOutcome:
    return SolveOutcome(summary=None, dense=b"", samples=b"", error={"code": code, "detail": detail})


def _reason(error: dict[str, object]) -> str:
    """Return the error as lines: each fault with its place, or the one sentence."""
    faults = error.get("faults")
    if isinstance(faults, list):
        return "\n".join(
            f"{fault['pointer'] or '/'}: {fault['message']} ({fault['code']})" for fault in faults
        )
    lines = [f"{error.get('code')}: {error.get('detail')}"]
    lines += [
        f"  {name}: {json.dumps(value)}"
        for name, value in error.items()
        if name not in ("code", "detail", "pointer")
    ]
    return "\n".join(lines)
