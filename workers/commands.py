"""The command line of the workers: ``python -m workers run``."""

import argparse
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from pydantic import ValidationError

from service.settings import Settings
from service.storage.migration import migrate
from workers.calibration.command import run as calibrate
from workers.computation import solve_document
from workers.engines.local import run_worker
from workers.solving import solve


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return 0 if it is done, 1 if it was refused or failed, with the reason on stderr."""
    parser = argparse.ArgumentParser(prog="python -m workers", description=__doc__)
    commands = parser.add_subparsers(required=True)
    _add_run(commands)
    _add_solve(commands)
    _add_calibrate(commands)
    options = parser.parse_args(arguments)
    code: int = options.command(options)
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
    parser.set_defaults(command=solve)


def _add_calibrate(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    parser = commands.add_parser("calibrate", help="measure what every tier reaches and costs here")
    parser.add_argument("--json", action="store_true", help="print the table as JSON")
    parser.add_argument("--quick", action="store_true", help="fewer problems, each measured once")
    parser.set_defaults(command=calibrate)


def run(options: argparse.Namespace) -> int:
    """Compute queued jobs until stopped."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    # It says nothing but that it is there, at every start.
    logging.getLogger("alembic").setLevel(logging.WARNING)
    given = {} if options.database_url is None else {"database_url": options.database_url}
    try:
        settings = Settings(**given)
    except ValidationError as fault:
        sys.stderr.write(f"{fault}\n")
        return 1
    if options.wake_fd is None:
        # Started alone. A service that starts workers has migrated before.
        migrate(settings.database_url)
    slots = options.slots if options.slots is not None else max(settings.workers, 1)
    run_worker(solve_document, settings, slots=slots, wake_fd=options.wake_fd)
    return 0


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"must be at least 1, not {number}")
    return number
