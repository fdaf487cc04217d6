"""``python -m workers solve FILE``: one problem, here and now, without a database."""

import argparse
import json
import sys
from pathlib import Path

from rich.console import Console

from service.jobs.outcome import SolveOutcome
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.settings import Settings
from service.storage.solutions.codec import decode_arrays
from workers.computation import solve_checked
from workers.presentation import describe, to_csv


def solve(options: argparse.Namespace) -> int:
    """Solve the problem of a file and print what was found; 0 if it was solved, 1 if not."""
    path: Path = options.file
    try:
        document = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as fault:
        sys.stderr.write(f"{path}: {fault}\n")
        return 1
    outcome = _compute(document, Settings())
    if outcome.error is not None or outcome.summary is None:
        sys.stderr.write(_reason(outcome.error or {}))
        return 1
    columns = decode_arrays(outcome.samples)
    if options.csv is not None:
        options.csv.write_text(to_csv(columns), encoding="utf-8")
    if options.json:
        series = {name: values.tolist() for name, values in columns.items()}
        sys.stdout.write(json.dumps({**outcome.summary, "columns": series}, allow_nan=False) + "\n")
    else:
        sys.stdout.write(describe(outcome.summary, columns) + "\n")
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
        return "".join(
            f"{fault['pointer'] or '/'}: {fault['message']} ({fault['code']})\n" for fault in faults
        )
    lines = [f"{error.get('code')}: {error.get('detail')}"]
    lines += [
        f"  {name}: {json.dumps(value)}"
        for name, value in error.items()
        if name not in ("code", "detail", "pointer")
    ]
    return "\n".join(lines) + "\n"
