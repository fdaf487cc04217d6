"""``python -m workers solve FILE`` and ``atlas FILE``: one document, without a database, in child processes.

The answer is JSON, a picture, a table of samples, or text for people.
"""

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any  # JSON values of a summary: their shapes are those of the solution resource

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from service.csv_text import LF, csv_blocks
from service.dynamics.motion import NO_CROSS_CHECK
from service.dynamics.solution.ball_columns import is_part
from service.jobs.kernels import FASTER, NeedsKernelsError, way_of_solution
from service.jobs.records import Refused, SolveOutcome
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.atlas.reading import read_atlas
from service.schemas.atlas.replies import AtlasOut
from service.schemas.atlas.showing import describe_atlas, picture_of
from service.schemas.problem.problem import read_problem
from service.schemas.replies.verdict_text import Refusal
from service.settings import Settings, read_settings
from service.storage.codecs.packing import decode_arrays
from service.terminal import STANDARD_STREAM, OutputFile, answer, check_writable, read_document, say
from service.verdicts.atlases import examine_atlas
from service.verdicts.examination import examine_problem
from service.verdicts.refusals import refusal_of_reading
from workers.process.tasks import solve_examined

FloatArray = NDArray[np.float64]
_REFUSED, _WRONG_USAGE = 1, 2


def solve_file(file: Path, *, csv: Path | None, as_json: bool) -> int:
    """Solve the problem of a file and print the solution; return 0 if it was solved, else 1."""
    if csv == STANDARD_STREAM and as_json:
        say("--json and --csv - both write to stdout; accepted is one of them")
        return _WRONG_USAGE
    settings = read_settings()
    document = read_document(file)
    if csv is not None:
        check_writable(csv)
    refusal = refusal_of_reading(document, read_problem)
    if refusal is not None:
        say(_reason(refusal))
        return _REFUSED
    outcome = _compute(json.dumps(document), settings)
    if isinstance(outcome, Refused):
        say(_reason(outcome.error))
        return _REFUSED
    if way_of_solution(outcome.summary) == "plain":
        say(f"solved without compiled kernels: {FASTER}")
    columns = decode_arrays(outcome.samples)
    if csv is not None:
        with OutputFile(csv) as output:
            output.write(b"".join(csv_blocks(columns, [columns.values()], LF)))
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


def _reason(error: Mapping[str, object]) -> str:
    return Refusal.model_validate({"pointer": "", **error}).reason()


def draw_file(file: Path, *, as_json: bool, picture: Path | None) -> int:
    """Print the atlas that the document of a file asks for; return 1 if it is refused."""
    if picture == STANDARD_STREAM and as_json:
        say("--json and --picture=- both write to stdout; accepted is one of them")
        return _WRONG_USAGE
    if picture is not None:
        check_writable(picture)
    settings = read_settings()
    document = read_document(file)
    error = refusal_of_reading(document, read_atlas)
    result = {"error": error} if error is not None else _drawn(document, settings)
    if isinstance(result, str):
        say(result)
        return _REFUSED
    if "error" in result:
        if as_json:
            answer(json.dumps(result["error"]) + "\n")
        say(Refusal.model_validate(result["error"]).reason())
        return _REFUSED
    drawn = AtlasOut.model_validate(result["verdict"])
    if picture is not None:
        with OutputFile(picture) as out:
            out.write(picture_of(drawn).encode())
    if picture != STANDARD_STREAM:
        answer(json.dumps(result["verdict"]) + "\n" if as_json else describe_atlas(drawn) + "\n")
    return 0


def _drawn(document: object, settings: Settings) -> dict[str, object] | str:
    """Return the atlas or its refusal, or for people why there is neither."""
    # Not at the top: it loads the solvers.
    from workers.computation.atlases import with_stability  # noqa: PLC0415

    request = json.dumps(document)
    sandbox = Sandbox(1, memory_mb=settings.job_memory_mb, preload=[with_stability.__module__])
    limit = f"POLHODE_VERDICT_SECONDS = {settings.verdict_seconds:g}"
    try:
        with Console(stderr=True).status("drawing …"):  # shows nothing where stderr is not a terminal
            result = sandbox.run(examine_atlas, request, seconds=settings.verdict_seconds)
            if read_atlas(document).wants_stability:
                limit = f"POLHODE_JOB_SECONDS = {settings.job_seconds:g}"
                result = sandbox.run(with_stability, request, result, seconds=settings.job_seconds)
    except SandboxTimeoutError:
        return f"no atlas within {limit}"
    except SandboxMemoryError:
        return f"no atlas within POLHODE_JOB_MEMORY_MB = {settings.job_memory_mb}"
    except SandboxCrashError as fault:
        return f"no atlas: {fault}"
    finally:
        sandbox.close()
    read: dict[str, object] = json.loads(result)
    return read


Summary = Mapping[str, Any]

ROWS_SHOWN = 6


def describe(summary: Summary, columns: Mapping[str, FloatArray]) -> str:
    """Return the solution with its error bounds in a few lines."""
    if not columns:
        return "\n".join(_numbers(summary))
    shown = {name: values for name, values in columns.items() if not is_part(name)}
    return "\n".join([*_numbers(summary), "", *_table(shown)])


def _numbers(summary: Summary) -> Iterator[str]:
    yield f"method      {summary['method']}"
    period = summary["period"]
    if period is not None:
        yield f"period      {_number(period)}"
    if summary["aperiodic"] is not None:
        yield f"aperiodic   {summary['aperiodic']}"
        for when, end in summary["asymptotes"].items():
            yield f"{when:<12}{_asymptote(end)}"
    energy = summary["energy"]
    yield f"energy      {_number(energy)}"
    window = summary["window"]
    if window is not None:
        (lower, upper), (first, last) = window["ends"], window["g1"]
        yield f"window      {lower} to {upper}, g1 from {first:.12g} to {last:.12g}"
    yield f"error       ≤ {summary['error']:.1e} in every variable at the sampled times"
    groups = {name: error["relative"] for name, error in summary["errors"].items()}
    if groups:
        parts = (f"{name} {error:.1e}" for name, error in groups.items() if error is not None)
        yield f"relative    ≤ {', '.join(parts)}"
    for name, integral in (summary["invariants"] or {}).items():
        value = f" of {integral['value']!r} ({integral['kind']})" if "value" in integral else ""
        yield f"{name + ' drift':<18}{integral['drift']:.1e}{value}"
    stability = summary["stability"]
    if stability is not None:
        yield f"stability   {stability['verdict']}, trace {stability['trace']!r} ± {stability['error']:.1e}"
    for name, angle in (summary["precession"] or {}).items():
        yield f"precession  {name} {angle['value']!r} ± {angle['error']:.1e} a period"
    check, warnings = summary["cross_check"], summary["warnings"]
    if check is not None and not any(warning["code"] == NO_CROSS_CHECK for warning in warnings):
        verdict = "agrees" if check["agrees"] else "DISAGREES"
        extent = f"within {check['disagreement']:.1e} up to t = {check['horizon']:.6g}"
        yield f"cross-check {verdict} with {check['method']} {extent}"
    for convention in summary["conventions"]:
        yield f"convention  {convention}"
    for warning in warnings:
        yield f"warning     {warning['message']} ({warning['code']})"


def _number(estimate: Mapping[str, Any]) -> str:
    if "radius" in estimate:
        return f"{estimate['value']} ± {estimate['radius']} (proven)"
    return f"{estimate['value']!r} ± {estimate['error']:.1e}"


def _asymptote(end: Mapping[str, Any]) -> str:
    where = "{} at g = ({:.12g}, {:.12g}, {:.12g})".format(end["kind"], *end["gamma"])
    if end["time"] is not None:
        return f"{where}, t = {end['time']['value']!r} ± {end['time']['error']:.1e}"
    if end["rate"] is not None:
        return f"{where}, approached like exp(-{end['rate']['value']:.12g} |t|)"
    return where


def _table(columns: Mapping[str, FloatArray]) -> Iterator[str]:
    names = list(columns)
    yield "".join(f"{name:>16}" for name in names)
    length = len(columns["t"])
    chosen = sorted({round(k * (length - 1) / max(ROWS_SHOWN - 1, 1)) for k in range(ROWS_SHOWN)})
    for row in chosen:
        yield "".join(f"{columns[name][row]:16.10f}" for name in names)
    if length > len(chosen):
        yield f"({len(chosen)} of {length} samples)"
