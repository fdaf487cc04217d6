"""``python -m workers calibrate``: measures this installation and stores the table."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from sqlalchemy.exc import SQLAlchemyError

from service.dynamics.accuracy import AccuracyTable
from service.schemas.replies.installation import AccuracyTableModel
from service.settings import read_settings
from service.storage.database.database import Database
from service.storage.solutions.accuracy_store import AccuracyStore
from service.terminal import answer, say
from workers.calibration.measurement import (
    FULL,
    QUICK,
    ClaimExceededError,
    Effort,
    NoReferenceError,
    calibrate,
    steps,
    whole_jobs,
)
from workers.cli.compile import compile_solvers
from workers.computation.compiled_code import GROUPS, way_for


def measure_and_store(*, quick: bool, as_json: bool) -> int:
    """Measure, store and print the table; return 0 on success, else 1.

    What it measures is the compiled way: where kernels are missing they are compiled first.
    """
    if way_for(*GROUPS) == "plain" and compile_solvers() != 0:
        return 1
    effort = QUICK if quick else FULL
    database = Database(read_settings().database_url)
    try:
        with _progress(effort) as step, whole_jobs() as seconds_of:
            table = calibrate(effort, seconds_of, step=step)
        AccuracyStore(database).add(table)
    except (ClaimExceededError, NoReferenceError) as fault:
        say(f"nothing is stored: {fault}")
        return 1
    except SQLAlchemyError as fault:
        reason = str(getattr(fault, "orig", None) or fault).splitlines()[0]
        say(f"the table cannot be stored: {reason}")
        return 1
    finally:
        database.close()
    text = json.dumps(AccuracyTableModel.of(table).model_dump()) if as_json else describe(table)
    answer(text + "\n")
    return 0


def describe(table: AccuracyTable) -> str:
    """Return the table for people: a line for each problem and tier."""
    heads = ("tier", "motion", "family", "error", "claimed", "ms for 1000", "ms per further 1000")
    lines = [f"{table.machine.model or table.machine.system}, {table.machine.cpus} processors", ""]
    lines.append(_line(*heads))
    lines += [
        _line(
            row.tier,
            row.kind,
            row.family,
            f"{row.error:.1e}",
            f"{row.claimed_error:.1e}",
            f"{1e3 * row.seconds:.2f}",
            f"{1e3 * row.seconds_per_1000:.2f}",
        )
        for row in table.rows
    ]
    lines += [_line(lack.tier, lack.kind, lack.family, lack.code) for lack in table.unavailable]
    return "\n".join(lines)


def _line(tier: str, kind: str, family: str, *rest: str) -> str:
    return f"{tier:<10}{kind:<17}{family:<14}{'  '.join(f'{text:>11}' for text in rest)}".rstrip()


@contextmanager
def _progress(effort: Effort) -> Iterator[Callable[[str], None]]:
    """Yield a function to call at the beginning of each step; draws a progress bar on a terminal."""
    console = Console(stderr=True)
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=steps(effort), completed=-1)

        def step(description: str) -> None:
            bar.update(task, description=description, advance=1)

        yield step
