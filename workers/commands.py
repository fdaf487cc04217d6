"""The command line of the workers: ``python -m workers run``."""

import argparse
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path

from service.jobs.hosts import OtherHostError
from service.logs import start_logging
from service.settings import SettingsError, read_settings
from service.storage.migration import MigrationError, migrate_or_explain
from service.storage.revisions import NewerSchemaError
from service.terminal import FileFaultError, say
from workers.engines.worker import run_worker
from workers.tasks import COMPUTATIONS, PRELOAD

_FAILED, _WRONG_USAGE = 1, 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Return 0 if it is done, 1 if it was refused or failed, 2 for wrong usage, both with the reason on stderr.
    """
    parser = argparse.ArgumentParser(prog="python -m workers", description=__doc__)
    commands = parser.add_subparsers(required=True)
    _add_run(commands)
    _add_solve(commands)
    _add_sweep(commands)
    _add_compile(commands)
    _add_calibrate(commands)
    _add_doctor(commands)
    options = parser.parse_args(arguments)
    try:
        code: int = options.command(options)
    except SettingsError as fault:
        say(str(fault))
        return _WRONG_USAGE
    except FileFaultError as fault:
        say(str(fault))
        return _FAILED
    return code


def _add_run(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    parser = commands.add_parser("run", help="compute queued jobs until stopped")
    parser.add_argument("--slots", type=_positive, default=None, help="jobs at the same time")
    parser.add_argument("--database-url", default=None)
    parser.add_argument("--wake-fd", type=int, default=None, help="descriptor of the service's bell")
    parser.set_defaults(command=run)


def _add_solve(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    parser = commands.add_parser("solve", help="solve one problem here and now")
    parser.add_argument("file", type=Path)
    parser.add_argument("--json", action="store_true", help="print the solution as JSON")
    parser.add_argument("--csv", type=Path, metavar="OUT", help="write the samples as CSV")
    parser.set_defaults(command=_loaded_later("workers.solving", "solve"))


def _add_sweep(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    parser = commands.add_parser("sweep", help="compute a sweep here and now")
    parser.add_argument("file", type=Path)
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the points: .parquet, .arrow or .csv")
    parser.add_argument("--workers", type=_positive, default=None, help="processes; one for each processor")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    parser.set_defaults(command=_loaded_later("workers.sweeping.command", "sweep"))


def _add_compile(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    parser = commands.add_parser("compile", help="compile the fast solvers now")
    parser.set_defaults(command=_loaded_later("workers.preparation", "compile_solvers"))


def _add_calibrate(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    parser = commands.add_parser("calibrate", help="measure what every tier reaches and costs here")
    parser.add_argument("--json", action="store_true", help="print the table as JSON")
    parser.add_argument("--quick", action="store_true", help="fewer problems, each measured once")
    parser.set_defaults(command=_loaded_later("workers.calibration.command", "run"))


def _add_doctor(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    parser = commands.add_parser("doctor", help="examine the database")
    parser.add_argument("--fix", action="store_true", help="mend what loses nothing")
    parser.add_argument("--sample", type=int, default=3, help="solutions that are solved once more")
    parser.add_argument("--all", action="store_true", help="read all stored arrays")
    parser.add_argument("--seed", type=int, default=None)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(command=_loaded_later("workers.doctor", "examine"))


def _loaded_later(module: str, name: str) -> Callable[[argparse.Namespace], int]:
    """Return a command whose module is loaded when it runs: a worker needs no solvers, which take long."""

    def command(options: argparse.Namespace) -> int:
        code: int = getattr(import_module(module), name)(options)
        return code

    return command


def run(options: argparse.Namespace) -> int:
    """Compute queued jobs until stopped."""
    settings = read_settings(database_url=options.database_url)
    start_logging(settings.log_format, settings.log_level or "info")
    slots = options.slots if options.slots is not None else max(settings.workers, 1)
    try:
        if options.wake_fd is None:
            # Started alone. A service that starts workers has migrated before.
            migrate_or_explain(settings.database_url, engine_name=settings.engine)
        run_worker(COMPUTATIONS, settings, slots=slots, wake_fd=options.wake_fd, preload=PRELOAD)
    except (MigrationError, NewerSchemaError, OtherHostError) as fault:
        say(str(fault))
        return _FAILED
    return 0


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"must be at least 1, not {number}")
    return number
