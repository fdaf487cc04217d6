"""``python -m workers sweep FILE``: computes a sweep in child processes, without a database.

Points are written to Parquet, Arrow and CSV files as they arrive.
"""

import json
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Protocol

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv, ipc, parquet
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from service.jobs.kernels import FASTER, KERNELS, Kernels, Way, way_of_sweep
from service.jobs.queue import Range
from service.local.workers import why_no_folder
from service.sandbox import Sandbox
from service.schemas.reading.documents import InvalidProblemError
from service.schemas.sweep.reading import read_sweep
from service.schemas.sweep.sweep import Sweep
from service.settings import Settings, read_settings
from service.startup import StopAsked
from service.storage.codecs.packing import SOLVED, ChunkPoints, bounds_of
from service.terminal import STANDARD_STREAM, OutputFile, answer, read_document, say
from workers.cli.compile import compile_solvers
from workers.computation.compiled_code import GROUPS, fixed_way, is_ready
from workers.sweeping.local_pool import LocalPool

FloatArray = NDArray[np.float64]


INDEX, OUTCOME = "index", "outcome"


class PointFile(Protocol):
    """A file that is valid once it is closed, however many points were written."""

    def write_table(self, table: pa.Table) -> None:
        """Add points."""
        ...

    def close(self) -> None:
        """Finish the file."""
        ...


_OPENERS: Mapping[str, Callable[[OutputFile, pa.Schema], PointFile]] = MappingProxyType(
    {".parquet": parquet.ParquetWriter, ".arrow": ipc.new_file, ".csv": csv.CSVWriter}
)
SUFFIXES = tuple(_OPENERS)
WITH_LISTS = (".parquet", ".arrow")
"""Suffixes of files that can hold series."""


def suffix_of(path: Path) -> str:
    """Return the suffix that selects the format; stdout gets CSV."""
    return ".csv" if path == STANDARD_STREAM else path.suffix


@contextmanager
def opened_points(path: Path, sweep: Sweep) -> Iterator[PointFile]:
    """Open a new file in the format of the path's suffix, one of ``SUFFIXES``.

    It is always closed at the end, so that it can be read.

    Raises
    ------
    FileFaultError
        It cannot be opened; every method raises it if the file cannot be written.
    """
    with OutputFile(path) as output:
        points = _OPENERS[suffix_of(path)](output, schema_of(sweep))
        try:
            yield points
        finally:
            points.close()


def schema_of(sweep: Sweep) -> pa.Schema:
    """Return the columns: index, axes by their pointers, kept numbers, outcome, series."""
    numbers = [(name, pa.float64()) for name in (*sweep.pointers, *sweep.keep)]
    series = [(name, pa.list_(pa.float64())) for name in sweep.series_columns]
    return pa.schema([(INDEX, pa.int64()), *numbers, (OUTCOME, pa.string()), *series])


def table_of(sweep: Sweep, first: int, points: ChunkPoints) -> pa.Table:
    """Return the points from ``first`` on; null where a point has no such number or no series."""
    count = len(points.outcomes)
    columns: dict[str, object] = {INDEX: np.arange(first, first + count, dtype=np.int64)}
    columns |= sweep.columns(first, count)
    columns |= {name: pa.array(values, from_pandas=True) for name, values in points.numbers.items()}
    columns[OUTCOME] = pa.array(points.outcomes)
    columns |= {name: _lists(rows) for name, rows in points.series.items()}
    schema = schema_of(sweep)
    return pa.table([columns[name] for name in schema.names], schema=schema)


def _lists(rows: FloatArray) -> pa.Array:
    """Return a list for each row without the NaN behind its last number, null if there is none."""
    known = ~np.isnan(rows)
    lengths = known.shape[1] - np.argmax(known[:, ::-1], axis=1)
    lengths[~known.any(axis=1)] = 0
    used = np.arange(rows.shape[1]) < lengths[:, None]
    offsets = pa.array(np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32))
    return pa.ListArray.from_arrays(offsets, pa.array(rows[used]), mask=pa.array(lengths == 0))


_DONE, _FAILED, _WRONG_USAGE = 0, 1, 2


@dataclass(slots=True)
class Tally:
    """Counts and ranges of the points computed so far."""

    outcomes: Counter[str] = field(default_factory=Counter)
    bounds: dict[str, tuple[float, float]] = field(default_factory=dict)

    def add(self, points: ChunkPoints) -> None:
        """Count points."""
        self.outcomes.update(points.outcomes)
        for name, (low, high) in bounds_of(points.numbers).items():
            known = self.bounds.get(name, (low, high))
            self.bounds[name] = min(low, known[0]), max(high, known[1])

    @property
    def done(self) -> int:
        """Number of points so far."""
        return self.outcomes.total()

    @property
    def refused(self) -> int:
        """Number of points that were not solved."""
        return self.done - self.outcomes[SOLVED]


def sweep_file(file: Path, *, out: Path | None, workers: int | None, as_json: bool) -> int:
    """Compute the sweep of a file; return 0 if all points were computed (solved or refused), else 1."""
    if out is not None and suffix_of(out) not in SUFFIXES:
        known = ", ".join(SUFFIXES)
        return _fail(f"{out}: unknown kind of file; accepted are {known}, and - for CSV", _WRONG_USAGE)
    if out == STANDARD_STREAM and as_json:
        return _fail("--json and --out - both write to stdout; accepted is one of them", _WRONG_USAGE)
    settings = read_settings()
    document = read_document(file)
    try:
        sweep = read_sweep(document, max_points=settings.max_sweep_points)
    except InvalidProblemError as refused:
        lines = (f"{fault.pointer or '/'}: {fault.message} ({fault.code})" for fault in refused.faults)
        return _fail("\n".join(lines), _FAILED)
    if out is not None and sweep.series_columns and suffix_of(out) not in WITH_LISTS:
        return _fail(f"{out}: {suffix_of(out)} has no series; {', '.join(WITH_LISTS)} have", _WRONG_USAGE)
    with ExitStack() as opened:
        points = None if out is None else opened.enter_context(opened_points(out, sweep))
        report = _Report(out, as_json)
        return _run(sweep, document, points, settings, workers or os.cpu_count() or 1, report)


@dataclass(frozen=True, slots=True)
class _Report:
    """The destination of the points, and whether the summary is written as JSON."""

    out: Path | None
    as_json: bool

    def write(self, sweep: Sweep, tally: Tally, seconds: float) -> None:
        """Tell what has come of the sweep, on stderr if stdout has the points."""
        if self.as_json:
            answer(_as_json(sweep, tally, self.out, seconds))
        elif self.out == STANDARD_STREAM:
            say(_described(sweep, tally, self.out, seconds).rstrip())
        else:
            answer(_described(sweep, tally, self.out, seconds))


def _run(
    sweep: Sweep, document: object, file: PointFile | None, settings: Settings, workers: int, report: _Report
) -> int:
    way = _way_of(sweep)
    sandbox = Sandbox(workers, memory_mb=settings.job_memory_mb, preload=["workers.sweeping.rows"])
    pool = LocalPool(sweep, document, sandbox, way=way, workers=workers, seconds=settings.job_seconds)
    stop, tally, began = StopAsked(), Tally(), time.monotonic()
    try:
        with stop, _progress() as progress:
            task = progress.add_task("", total=sweep.points, refused=0)
            for computed in pool.points(lambda: stop.is_asked):
                if computed is not None:
                    first, points = computed
                    tally.add(points)
                    if file is not None:
                        file.write_table(table_of(sweep, first, points))
                progress.update(task, completed=pool.computed, refused=tally.refused)
    finally:
        sandbox.close()
    if file is not None:
        file.close()
    report.write(sweep, tally, time.monotonic() - began)
    if way == "plain" and tally.refused:
        say(f"compiled kernels may solve what was refused without them: {FASTER}")
    missing = pool.missing()
    return _fail(_missing_in_words(sweep, missing), _FAILED) if missing else _DONE


def _way_of(sweep: Sweep) -> Way:
    """Return the way of all points; where that is sooner done, kernels are compiled first."""
    way = fixed_way()
    if way is not None or is_ready(*GROUPS):
        return way or "compiled"
    way = way_of_sweep({"base": sweep.base}, sweep.points, Kernels(0, KERNELS, None, why_no_folder()))
    if way == "plain":
        say(f"computed without compiled kernels, point by point: {FASTER}")
        return way
    say("this is sooner done, or only done, by compiled kernels: they are compiled now")
    return "compiled" if compile_solvers() == 0 else "plain"


class _RateColumn(ProgressColumn):
    """Points a second."""

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:,.0f}/s")


def _progress() -> Progress:
    """Return a bar on stderr, which shows nothing where that is not a terminal."""
    console = Console(stderr=True)
    return Progress(
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[refused]} refused"),
        _RateColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


def _as_json(sweep: Sweep, tally: Tally, out: Path | None, seconds: float) -> str:
    answer = {
        "points": sweep.points,
        "done": tally.done,
        "refused": tally.refused,
        "outcomes": dict(tally.outcomes),
        "bounds": tally.bounds,
        "seconds": seconds,
        "out": None if out is None else str(out),
    }
    return json.dumps(answer, allow_nan=False) + "\n"


def _described(sweep: Sweep, tally: Tally, out: Path | None, seconds: float) -> str:
    """Return the summary: counts of outcomes, the range of each kept number, and the file of the points."""
    rate = tally.done / max(seconds, 1e-9)
    lines = [f"{tally.done:,} of {sweep.points:,} points in {seconds:,.3g} s ({rate:,.0f}/s)"]
    lines += [f"  {count:>12,}  {outcome}" for outcome, count in tally.outcomes.most_common()]
    width = max(map(len, tally.bounds), default=0)
    lines += [f"{name:<{width}}  {low!r} to {high!r}" for name, (low, high) in tally.bounds.items()]
    if out is not None and out.is_file():
        lines.append(f"written to {out} ({out.stat().st_size / 1e6:,.3g} MB)")
    return "\n".join(lines) + "\n"


def _missing_in_words(sweep: Sweep, missing: list[Range]) -> str:
    shown = ", ".join(f"{gap.first} to {gap.first + gap.count - 1}" for gap in missing[:10])
    count = sum(gap.count for gap in missing)
    return f"stopped: {count:,} of {sweep.points:,} points are missing, those with index {shown}" + (
        "" if len(missing) <= 10 else f" and {len(missing) - 10} more ranges"
    )


def _fail(reason: str, code: int) -> int:
    say(reason)
    return code
