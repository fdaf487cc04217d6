"""The start of a worker process: its command line and its environment."""

import os
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from service.settings import Settings


def worker_command(*arguments: str) -> list[str]:
    """Return the command line of a worker. ``-P``: a ``workers.py`` in the working folder is not imported."""
    return [sys.executable, "-P", "-m", "workers", *arguments]


def worker_environment(settings: "Settings") -> dict[str, str]:
    """Return a worker's environment. URLs may hold passwords, and other users see command-line options."""
    log = {"POLHODE_LOG_FORMAT": settings.log_format, "POLHODE_LOG_LEVEL": settings.log_level}
    chosen = {name: value for name, value in log.items() if value is not None}
    return {**os.environ, "POLHODE_DATABASE_URL": settings.database_url, **chosen}
