"""``polhode doctor``: checks the database, and repairs it if asked."""

from typing import Annotated

import typer

from service.cli.common import AsJson, DatabaseUrl, become_worker, settings_of
from service.local.worker_command import worker_environment


def doctor(
    fix: Annotated[
        bool, typer.Option("--fix", help="repair what can be repaired without losing anything")
    ] = False,
    sample: Annotated[int, typer.Option(min=0, help="solutions that are solved again to compare")] = 3,
    every: Annotated[
        bool, typer.Option("--all", help="read all stored arrays instead of 100 of each kind")
    ] = False,
    seed: Annotated[int | None, typer.Option(help="seed for choosing solutions and arrays")] = None,
    as_json: AsJson = False,
    database_url: DatabaseUrl = None,
) -> None:
    """Check the database; exit code 0 if nothing is wrong, else 1.

    The database may be in use. SQLite's own check reads the whole file.
    """
    settings = settings_of(database_url=database_url)
    options = [name for name, given in (("--fix", fix), ("--all", every), ("--json", as_json)) if given]
    if seed is not None:
        options += ["--seed", str(seed)]
    become_worker(["doctor", "--sample", str(sample), *options], worker_environment(settings))
