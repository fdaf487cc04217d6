"""``python -m workers solve FILE``, ``atlas FILE`` and ``study FILE``: one document, in child processes.

The answer is JSON, a picture, a table of samples, or text for people.
"""

import io
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar  # JSON values of a summary: their shapes are those of the solution resource
from xml.etree import ElementTree  # of our own text

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from service.csv_text import LF, csv_blocks
from service.dynamics.solution.dense_output import is_part
from service.jobs.kernels import FASTER, NeedsKernelsError, way_of_solution
from service.jobs.records import JobResult, Refused, SolveOutcome
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.atlas.documents import AtlasOut, read_atlas
from service.schemas.atlas.showing import describe_atlas, picture_of
from service.schemas.problem.problem import read_problem
from service.schemas.reading.documents import Part
from service.schemas.replies.study import describe_answer
from service.schemas.replies.text import Refusal, describe_solution
from service.schemas.study.reading import read_study
from service.settings import Settings, read_settings
from service.storage.codecs.packing import decode_arrays, decode_document
from service.terminal import STANDARD_STREAM, OutputFile, answer, check_writable, read_document, say
from service.verdicts.examination import examine_problem
from service.verdicts.questions import examine_atlas
from service.verdicts.refusals import refusal_of_reading
from workers.process.tasks import solve_examined, study

FloatArray = NDArray[np.float64]
T = TypeVar("T")
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

    def work(sandbox: Sandbox) -> SolveOutcome:
        with console.status("examining …"):  # shows nothing where stderr is not a terminal
            try:
                report = sandbox.run(examine_problem, document, seconds=settings.verdict_seconds)
            except SandboxTimeoutError:
                return _too_late("no verdict", settings)
        seconds = settings.job_seconds
        with suppress(NeedsKernelsError), console.status("solving …"):
            return sandbox.run(solve_examined, document, report, seconds=seconds)
        say("only compiled kernels solve this, and they are not ready: they are compiled now")
        # It loads the solvers.
        from workers.cli.compile import compile_solvers  # noqa: PLC0415

        compile_solvers()
        try:
            with console.status("solving …"):
                return sandbox.run(solve_examined, document, report, seconds=seconds)
        except NeedsKernelsError:
            return _failed("not_ready", "only compiled kernels solve this, and they are not compiled")

    return _in_child(work, settings, preload="workers.computation.compute", unfinished="not solved")


def _in_child(
    work: Callable[[Sandbox], T], settings: Settings, *, preload: str, unfinished: str
) -> T | Refused:
    """Return what ``work`` does in a child with the limits of a job, or which of them it went beyond."""
    sandbox = Sandbox(1, memory_mb=settings.job_memory_mb, preload=[preload])
    try:
        return work(sandbox)
    except SandboxTimeoutError:
        return _failed("time_limit", f"{unfinished} within POLHODE_JOB_SECONDS = {settings.job_seconds:g}")
    except SandboxMemoryError:
        return _failed(
            "memory_limit", f"more memory needed than POLHODE_JOB_MEMORY_MB = {settings.job_memory_mb}"
        )
    except SandboxCrashError as fault:
        return _failed("lost_worker", f"the computation's process died: {fault}")
    finally:
        sandbox.close()


def _too_late(unfinished: str, settings: Settings) -> Refused:
    limit = f"POLHODE_VERDICT_SECONDS = {settings.verdict_seconds:g}"
    return _failed("verdict_time_limit", f"{unfinished} within {limit}")


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
        if picture != STANDARD_STREAM and picture.suffix.lower() not in PICTURES:
            say(f"--picture {picture}: accepted endings are {', '.join(PICTURES)}; - is SVG to stdout")
            return _WRONG_USAGE
        check_writable(picture)
    settings = read_settings()
    document = read_document(file)
    error = refusal_of_reading(document, read_atlas)
    result = {"error": error} if error is not None else _drawn(document, settings)
    if "error" in result:
        if as_json:
            answer(json.dumps(result["error"]) + "\n")
        say(_reason(result["error"]))
        return _REFUSED
    drawn = AtlasOut.model_validate(result["verdict"])
    if picture is not None:
        svg = picture_of(drawn)
        try:
            content = png_of(svg) if picture.suffix.lower() == ".png" else svg.encode()
        except ModuleNotFoundError as fault:
            say(f"--picture {picture}: a PNG needs {fault.name}, which is not installed; .svg needs nothing")
            return _REFUSED
        with OutputFile(picture) as out:
            out.write(content)
    if picture != STANDARD_STREAM:
        answer(json.dumps(result["verdict"]) + "\n" if as_json else describe_atlas(drawn) + "\n")
    return 0


def study_file(file: Path, *, as_json: bool) -> int:
    """Print the answer to the study of a file; return 1 if it is refused."""
    settings = read_settings()
    document = read_document(file)
    refusal = refusal_of_reading(document, read_study)
    if refusal is not None:
        say(_reason(refusal))
        return _REFUSED

    def work(sandbox: Sandbox) -> JobResult | Refused:
        with Console(stderr=True).status("searching …"):  # shows nothing where stderr is not a terminal
            return sandbox.run(study, json.dumps(document), seconds=settings.job_seconds)

    outcome = _in_child(work, settings, preload="workers.computation.studies", unfinished="no answer")
    if isinstance(outcome, Refused):
        say(_reason(outcome.error))
        return _REFUSED
    found = decode_document(outcome.data)
    answer((json.dumps(found) if as_json else describe_answer(found)) + "\n")
    return 0


PICTURES = (".svg", ".png")
"""Endings of the files of pictures."""
_DOTS = 2.0
"""Dots of a PNG for a unit of the SVG."""
_CLASSES: Mapping[str, Mapping[str, str]] = {
    "axis": {"stroke": "#888", "fill": "none"},
    "grid": {"stroke": "#ddd", "fill": "none"},
    "change": {"stroke": "#222", "fill": "none", "dashes": "--"},
    "open": {"fill": "#bbb", "fill-opacity": ".5"},
}
"""The looks of the classes in the style sheet of an atlas."""


def png_of(svg: str) -> bytes:
    """Return the picture of an atlas as PNG: its lines, polygons, rectangles and words, drawn by matplotlib.

    Raises
    ------
    ModuleNotFoundError
        Matplotlib is not installed: nothing else needs it.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415
    from matplotlib.patches import Polygon  # noqa: PLC0415

    root = ElementTree.fromstring(svg)
    width, height = map(float, root.attrib["viewBox"].split()[2:])
    figure = Figure(figsize=(width / 100, height / 100), dpi=100 * _DOTS)
    ax = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(height, 0))
    ax.set_axis_off()
    for order, node in enumerate(root):
        kind, given = node.tag.rpartition("}")[2], node.attrib
        look = {"stroke": "none", "fill": "#222", **_CLASSES.get(given.get("class", ""), {}), **given}
        opacity = float(look.get("fill-opacity", 1))
        if kind == "text":
            size = 10.5 if given.get("class") == "title" else 9.0
            side = {"end": "right", "middle": "center"}.get(given.get("text-anchor", ""), "left")
            ax.text(float(given["x"]), float(given["y"]), node.text or "", size=size, ha=side, zorder=order)
        elif kind in ("line", "polyline", "polygon", "rect"):
            drawn = Polygon(
                _corners(kind, given),
                closed=kind in ("polygon", "rect"),
                facecolor=look["fill"] if look["fill"] == "none" else (look["fill"], opacity),
                edgecolor=look["stroke"],
                linestyle=look.get("dashes", "-"),
                linewidth=0.72 * float(look.get("stroke-width", 1)),
                zorder=order,
            )
            ax.add_patch(drawn)
    content = io.BytesIO()
    figure.savefig(content, format="png")
    return content.getvalue()


def _corners(kind: str, given: Mapping[str, str]) -> list[tuple[float, float]]:
    """Return the corners of a shape."""
    if kind in ("polyline", "polygon"):
        return [(float(x), float(y)) for x, y in (each.split(",") for each in given["points"].split())]
    if kind == "line":
        return [(float(given[f"x{k}"]), float(given[f"y{k}"])) for k in (1, 2)]
    x, y = float(given.get("x", 0)), float(given.get("y", 0))
    right, bottom = x + float(given["width"]), y + float(given["height"])
    return [(x, y), (right, y), (right, bottom), (x, bottom)]


def _drawn(document: object, settings: Settings) -> Part:
    """Return the atlas or its refusal."""
    # Not at the top: it loads the solvers.
    from workers.computation.atlases import with_stability  # noqa: PLC0415

    request = json.dumps(document)

    def work(sandbox: Sandbox) -> Part | Refused:
        with Console(stderr=True).status("drawing …"):  # shows nothing where stderr is not a terminal
            try:
                result = sandbox.run(examine_atlas, request, seconds=settings.verdict_seconds)
            except SandboxTimeoutError:
                return _too_late("no atlas", settings)
            if read_atlas(document).wants_stability:
                result = sandbox.run(with_stability, request, result, seconds=settings.job_seconds)
        drawn: Part = json.loads(result)
        return drawn

    drawn = _in_child(work, settings, preload=with_stability.__module__, unfinished="no atlas")
    return {"error": drawn.error} if isinstance(drawn, Refused) else drawn


Summary = Mapping[str, Any]

ROWS_SHOWN = 6


def describe(summary: Summary, columns: Mapping[str, FloatArray]) -> str:
    """Return the solution with its error bounds in a few lines."""
    if not columns:
        return "\n".join(describe_solution(summary))
    shown = {name: values for name, values in columns.items() if not is_part(name)}
    return "\n".join([*describe_solution(summary), "", *_table(shown)])


def _table(columns: Mapping[str, FloatArray]) -> Iterator[str]:
    names = list(columns)
    yield "".join(f"{name:>16}" for name in names)
    length = len(columns["t"])
    chosen = sorted({round(k * (length - 1) / max(ROWS_SHOWN - 1, 1)) for k in range(ROWS_SHOWN)})
    for row in chosen:
        yield "".join(f"{columns[name][row]:16.10f}" for name in names)
    if length > len(chosen):
        yield f"({len(chosen)} of {length} samples)"
