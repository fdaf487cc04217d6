"""``python -m workers solve FILE``: solves one problem in this process, without a database."""

import json
from contextlib import suppress
from pathlib import Path

from rich.console import Console

from service.jobs.kernels import FASTER, NeedsKernelsError, told_way
from service.jobs.outcome import Refused, SolveOutcome
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.problem.problem import read_problem
from service.settings import Settings, read_settings
from service.storage.codecs.packing import decode_arrays
from service.terminal import STANDARD_STREAM, OutputFile, answer, check_writable, read_document, say
from service.verdicts.examination import examine_problem
from service.verdicts.refusals import refusal_of_reading
from workers.computation.text import describe, to_csv
from workers.process.tasks import solve_examined


def solve_file(file: Path, *, csv: Path | None, as_json: bool) -> int:
    """Solve the problem of a file and print the solution; return 0 if it was solved, else 1."""
    if csv == STANDARD_STREAM and as_json:
        say("--json and --csv - both write to stdout; accepted is one of them")
        return 2
    settings = read_settings()
    document = read_document(file)
    if csv is not None:
        check_writable(csv)
    refusal = refusal_of_reading(document, read_problem)
    if refusal is not None:
        say(_reason(refusal))
        return 1
    outcome = _compute(json.dumps(document), settings)
    if isinstance(outcome, Refused):
        say(_reason(outcome.error))
        return 1
    if told_way(outcome.summary) == "plain":
        say(f"solved without compiled kernels: {FASTER}")
    columns = decode_arrays(outcome.samples)
    if csv is not None:
        with OutputFile(csv) as output:
            output.write(to_csv(columns).encode())
    if as_json:
        series = {name: values.tolist() for name, values in columns.items()}
        answer(json.dumps({**outcome.summary, "columns": series}, allow_nan=False) + "\n")
    elif csv == STANDARD_STREAM:
        say(describe(outcome.summary, columns))
    else:
        answer(describe(outcome.summary, columns) + "\n")
    return 0


def _compute(document: str, settings: Settings) -> SolveOutcome:
    """Compute in a child with the limits of a verdict and of a job, and show a progress sign."""
    console = Console(stderr=True)
    sandbox = Sandbox(1, memory_mb=settings.job_memory_mb, preload=["workers.computation.compute"])
    try:
        with console.status("examining …"):  # shows nothing where stderr is not a terminal
            try:
                report = sandbox.run(examine_problem, document, seconds=settings.verdict_seconds)
            except SandboxTimeoutError:
                detail = f"no verdict within POLHODE_VERDICT_SECONDS = {settings.verdict_seconds:g}"
                return _failed("verdict_time_limit", detail)
        seconds = settings.job_seconds
        with suppress(NeedsKernelsError), console.status("solving …"):
            return sandbox.run(solve_examined, document, report, seconds=seconds)
        say("only compiled kernels solve this, and they are not ready: they are compiled now")
        # It loads the solvers.
        from workers.cli.compile import compile_solvers  # noqa: PLC0415

        compile_solvers()
        with console.status("solving …"):
            return sandbox.run(solve_examined, document, report, seconds=seconds)
    except NeedsKernelsError:
        return _failed("not_ready", "only compiled kernels solve this, and they are not compiled")
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


def _failed(code: str, detail: str) -> Refused:
    return Refused({"code": code, "detail": detail})


def _reason(error: dict[str, object]) -> str:
    """Return the error as lines: each fault with its place, or the message."""
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
