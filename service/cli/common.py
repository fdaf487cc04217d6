"""Options, settings and failure handling that several commands share."""

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer
from typer.core import TyperCommand

from service.local.workers import worker_command
from service.startup import hold_signals
from service.terminal import say

if TYPE_CHECKING:
    from service.settings import Settings

REFUSED, WRONG_USAGE = 1, 2

DatabaseUrl = Annotated[
    str | None, typer.Option(help="SQLite or Postgres. POLHODE_DATABASE_URL, else sqlite:///polhode.db")
]
Document = Annotated[Path, typer.Argument(help="a JSON document; - reads stdin", show_default=False)]
AsJson = Annotated[bool, typer.Option("--json", help="print JSON")]


class Command(TyperCommand):
    """A command that help lists with the whole first line of its docstring, wrapped instead of cut."""

    def get_short_help_str(self, limit: int = 45) -> str:
        """Return that line."""
        return (self.help or "").partition("\n")[0]


def settings_of(**options: object) -> "Settings":
    """Return the settings; options of the command line override the environment."""
    from service.settings import SettingsError, read_settings  # noqa: PLC0415

    try:
        return read_settings(**options)
    except SettingsError as fault:
        fail(str(fault), WRONG_USAGE)


def migrate_database(settings: "Settings") -> None:
    """Migrate the database to this version, or exit with the reason why not."""
    from service.storage.database.migration import MigrationError, migrate_or_explain  # noqa: PLC0415

    try:
        migrate_or_explain(settings.database_url)
    except MigrationError as fault:
        fail(str(fault), REFUSED)


def become_worker(name: str, environment: Mapping[str, str], **options: object) -> NoReturn:
    """Replace this process by a command of the workers, which the service does not import."""
    hold_signals()
    os.execve(sys.executable, worker_command(name, **options), dict(environment))


def fail(reason: str, code: int) -> NoReturn:
    """Exit with the reason on stderr."""
    say(reason)
    raise typer.Exit(code)
