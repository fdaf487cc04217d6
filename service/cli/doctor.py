"""``polhode doctor``: is everything in the database as it must be."""

from typing import Annotated

import typer

from service.cli.common import AsJson, DatabaseUrl, become_worker, settings_of
from service.local_workers import worker_environment


def doctor(
    fix: Annotated[
        bool, typer.Option("--fix", help="mend what can be mended without losing anything")
    ] = False,
    sample: Annotated[int, typer.Option(min=0, help="solutions that are solved once more")] = 3,
    every: Annotated[
        bool, typer.Option("--all", help="read all stored arrays, not 100 of each kind")
    ] = False,
    seed: Annotated[int | None, typer.Option(help="of the choice among solutions and arrays")] = None,
    as_json: AsJson = False,
    database_url: DatabaseUrl = None,
) -> None:
    """Examine the database; exit code 0 if it is clean, 1 if not.

    It may be in use meanwhile. SQLite's own check reads the whole file.
    """
    settings = settings_of(database_url=database_url)
    options = [name for name, given in (("--fix", fix), ("--all", every), ("--json", as_json)) if given]
    if seed is not None:
        options += ["--seed", str(seed)]
    become_worker(["doctor", "--sample", str(sample), *options], worker_environment(settings))
