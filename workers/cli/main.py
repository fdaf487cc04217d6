"""The command line of the workers: ``python -m workers run``.

Commands import what they need when they run: a worker is there before the solvers, which take long to load.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from service.logs import start_logging
from service.settings import SettingsError, read_settings
from service.terminal import FileFaultError, say

_FAILED, _WRONG_USAGE = 1, 2
_TASKS, _TASKS_OF_A_SLOT, _ADDRESS_MB = 10, 4, 1000
"""The needs of a worker, counted: its threads, the processes around its children, two children a slot while
they are replaced; and what a child reserves with all code loaded, 700 MB."""

app = typer.Typer(
    name="python -m workers",
    help="The command line of the workers.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Document = Annotated[Path, typer.Argument(help="a JSON document; - reads stdin", show_default=False)]
AsJson = Annotated[bool, typer.Option("--json", help="print JSON")]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Return 0 for success, 1 if it was refused or failed, 2 for wrong usage, both with the reason on stderr.
    """
    try:
        app(arguments, prog_name="python -m workers")
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else _FAILED
    except SettingsError as fault:
        say(str(fault))
        return _WRONG_USAGE
    except FileFaultError as fault:
        say(str(fault))
        return _FAILED
    return 0


@app.command()
def run(
    slots: Annotated[int | None, typer.Option(min=1, help="jobs at the same time")] = None,
    database_url: Annotated[str | None, typer.Option(help="SQLite or Postgres")] = None,
    wake_fd: Annotated[int | None, typer.Option(help="descriptor of the service's wake-up socket")] = None,
) -> None:
    """Compute queued jobs until stopped."""
    from service.sandbox import lack_of_room  # noqa: PLC0415
    from workers.process.start import run_worker  # noqa: PLC0415
    from workers.process.tasks import COMPUTATIONS, PRELOAD, WARM_UP, WorkerTasks  # noqa: PLC0415

    settings = read_settings(database_url=database_url)
    start_logging(settings.log_format, settings.log_level or "info")
    slots = slots if slots is not None else max(settings.workers, 1)
    if (reason := lack_of_room(tasks=_TASKS + _TASKS_OF_A_SLOT * slots, megabytes=_ADDRESS_MB)) is not None:
        say(reason)
        raise typer.Exit(_FAILED)
    try:
        if wake_fd is None:
            # Started alone. A service that starts workers migrates, and tells them when it has.
            from service.storage.database.migration import migrate_or_explain  # noqa: PLC0415

            migrate_or_explain(settings.database_url, engine_name=settings.engine)
        run_worker(WorkerTasks(COMPUTATIONS, PRELOAD, WARM_UP), settings, slots=slots, wake_fd=wake_fd)
    except _reasons_to_end() as fault:
        say(str(fault))
        raise typer.Exit(_FAILED) from fault


def _reasons_to_end() -> tuple[type[Exception], ...]:
    """Return the faults that a message explains; asked, and loaded, only after a fault."""
    from service.local.worker_process import OtherHostError  # noqa: PLC0415
    from service.storage.database.migration import MigrationError  # noqa: PLC0415
    from service.storage.database.revisions import UnknownRevisionError  # noqa: PLC0415

    return MigrationError, UnknownRevisionError, OtherHostError


@app.command()
def solve(
    file: Document,
    as_json: AsJson = False,
    csv: Annotated[Path | None, typer.Option(metavar="OUT", help="write the samples as CSV")] = None,
) -> None:
    """Solve one problem without a database."""
    from workers.cli.documents import solve_file  # noqa: PLC0415

    raise typer.Exit(solve_file(file, csv=csv, as_json=as_json))


@app.command()
def atlas(
    file: Document,
    as_json: AsJson = False,
    picture: Annotated[Path | None, typer.Option(metavar="OUT", help="write a picture of it (SVG)")] = None,
) -> None:
    """Draw an atlas without a database."""
    from workers.cli.documents import draw_file  # noqa: PLC0415

    raise typer.Exit(draw_file(file, as_json=as_json, picture=picture))


@app.command()
def sweep(
    file: Document,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="write the points: .parquet, .arrow or .csv")
    ] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="processes; one for each processor")] = None,
    as_json: AsJson = False,
) -> None:
    """Compute a sweep without a database."""
    from workers.cli.sweep import sweep_file  # noqa: PLC0415

    raise typer.Exit(sweep_file(file, out=out, workers=workers, as_json=as_json))


@app.command(name="compile")
def compile_now(
    in_background: Annotated[bool, typer.Option("--in-background", hidden=True)] = False,
    is_second: Annotated[bool, typer.Option("--is-second", hidden=True)] = False,
) -> None:
    """Compile the kernels of the fast solvers, where they are missing."""
    from workers.cli.compile import compile_solvers  # noqa: PLC0415

    raise typer.Exit(compile_solvers(in_background=in_background, is_second=is_second))


@app.command()
def calibrate(
    as_json: AsJson = False,
    quick: Annotated[bool, typer.Option("--quick", help="fewer problems, each measured once")] = False,
) -> None:
    """Measure the error and the time of every tier on this machine."""
    from workers.cli.calibrate import measure_and_store  # noqa: PLC0415

    raise typer.Exit(measure_and_store(quick=quick, as_json=as_json))


@app.command()
def doctor(
    fix: Annotated[
        bool, typer.Option("--fix", help="repair what can be repaired without losing anything")
    ] = False,
    sample: Annotated[int, typer.Option(help="solutions that are solved again to compare")] = 3,
    every: Annotated[bool, typer.Option("--all", help="read all stored arrays")] = False,
    seed: Annotated[int | None, typer.Option(help="of the choice among solutions and arrays")] = None,
    as_json: AsJson = False,
) -> None:
    """Check the database."""
    from workers.cli.doctor import examine  # noqa: PLC0415

    raise typer.Exit(examine(fix=fix, sample=sample, every=every, seed=seed, as_json=as_json))
