"""The command line of the workers, which ``polhode`` uses: ``python -m workers NAME OPTIONS``.

NAME is one of COMMANDS, and OPTIONS are a JSON object; ``polhode`` declares and explains them. Commands
import what they need when they run: a worker is there before the solvers, which take long to load.
"""

import json
import logging
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from service.local.workers import why_no_folder
from service.logs import start_logging
from service.settings import SettingsError, read_settings
from service.terminal import FileFaultError, say

logger = logging.getLogger(__name__)

_FAILED, _WRONG_USAGE = 1, 2
_TASKS, _TASKS_OF_A_SLOT, _ADDRESS_MB = 10, 4, 1000
"""The needs of a worker, counted: its threads, the processes around its children, two children a slot while
they are replaced; and what a child reserves with all code loaded, 700 MB."""

COMMANDS = ("run", "children", "solve", "atlas", "study", "sweep", "compile", "calibrate", "doctor")
_PATHS = ("file", "out", "csv", "picture")
"""Options that are paths."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Return 0 for success, 1 if it was refused or failed, 2 for wrong usage, both with the reason on stderr.
    """
    words = sys.argv[1:] if arguments is None else arguments
    if not words or words[0] not in COMMANDS:
        say(f"usage: python -m workers NAME OPTIONS; names are {', '.join(COMMANDS)}. People use polhode")
        return _WRONG_USAGE
    try:
        options = json.loads(words[1]) if len(words) > 1 else {}
        paths = {name: Path(text) for name, text in options.items() if name in _PATHS and text is not None}
        return _command(words[0])(**{**options, **paths})
    except SettingsError as fault:
        say(str(fault))
        return _WRONG_USAGE
    except FileFaultError as fault:
        say(str(fault))
        return _FAILED


def _command(name: str) -> Callable[..., int]:
    """Return the function of a command; it returns the exit code."""
    match name:
        case "children":
            from workers.process.remote import serve_children  # noqa: PLC0415

            return serve_children
        case "solve":
            from workers.cli.documents import solve_file  # noqa: PLC0415

            return solve_file
        case "atlas":
            from workers.cli.documents import draw_file  # noqa: PLC0415

            return draw_file
        case "study":
            from workers.cli.documents import study_file  # noqa: PLC0415

            return study_file
        case "sweep":
            from workers.cli.sweep import sweep_file  # noqa: PLC0415

            return sweep_file
        case "compile":
            from workers.cli.compile import compile_solvers  # noqa: PLC0415

            return compile_solvers
        case "calibrate":
            from workers.cli.calibrate import measure_and_store  # noqa: PLC0415

            return measure_and_store
        case "doctor":
            from workers.cli.doctor import examine  # noqa: PLC0415

            return examine
    return run


def run(*, slots: int | None = None, wake_fd: int | None = None) -> int:
    """Compute queued jobs until stopped.

    ``slots`` are jobs at the same time, ``wake_fd`` is the descriptor of the service's wake-up socket.
    """
    from service.sandbox import lack_of_room  # noqa: PLC0415
    from workers.process.start import run_worker  # noqa: PLC0415
    from workers.process.tasks import TASKS  # noqa: PLC0415

    settings = read_settings()
    start_logging(settings.log_format, settings.log_level or "info")
    slots = slots if slots is not None else max(settings.workers, 1)
    if (reason := lack_of_room(tasks=_TASKS + _TASKS_OF_A_SLOT * slots, megabytes=_ADDRESS_MB)) is not None:
        say(reason)
        return _FAILED
    if (reason := why_no_folder()) is not None:
        logger.warning("compiled code cannot be kept, and jobs are solved without it: %s", reason)
    try:
        if wake_fd is None:
            # Started alone. A service that starts workers migrates, and tells them when it has.
            from service.storage.database.migration import migrate_or_explain  # noqa: PLC0415

            migrate_or_explain(settings.database_url)
        run_worker(TASKS, settings, slots=slots, wake_fd=wake_fd)
    except _reasons_to_end() as fault:
        say(str(fault))
        return _FAILED
    return 0


def _reasons_to_end() -> tuple[type[Exception], ...]:
    """Return the faults that a message explains; asked, and loaded, only after a fault."""
    from service.local.workers import OtherHostError  # noqa: PLC0415
    from service.storage.database.migration import MigrationError, UnknownRevisionError  # noqa: PLC0415

    return MigrationError, UnknownRevisionError, OtherHostError
