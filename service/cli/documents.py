"""``polhode validate``, ``solve``, ``atlas``, ``compile`` and ``calibrate``: they need no service."""

import os
from pathlib import Path
from typing import Annotated

import typer

from service.cli.common import AsJson, DatabaseUrl, Document, become_worker, migrate_database, settings_of
from service.local.worker_command import worker_environment


def validate(
    file: Document,
    as_json: AsJson = False,
    formulas: Annotated[
        str | None,
        typer.Option(metavar="FORMATS", help="the formulas as text,latex,mathml, simplified where possible"),
    ] = None,
) -> None:
    """Tell whether a potential admits planar motions, or whether a whole problem can be solved."""
    from service.cli.validation import validate_file  # noqa: PLC0415

    validate_file(file, as_json=as_json, formulas=formulas)


def solve(
    file: Document,
    as_json: AsJson = False,
    csv: Annotated[
        Path | None, typer.Option(metavar="OUT", help="write the samples as CSV; - is stdout")
    ] = None,
) -> None:
    """Solve one problem in this terminal, without a database: 2 s, also where nothing is compiled."""
    options = ["--json"] if as_json else []
    if csv is not None:
        options.append(f"--csv={csv}")
    become_worker(["solve", *options, "--", str(file)], os.environ)


def atlas(
    file: Document,
    as_json: AsJson = False,
    picture: Annotated[
        Path | None, typer.Option(metavar="OUT", help="write a picture of it (SVG); - is stdout")
    ] = None,
) -> None:
    """Tell for which λ of a range there are planar motions, of which kind, and where that changes."""
    options = ["--json"] if as_json else []
    if picture is not None:
        options.append(f"--picture={picture}")
    become_worker(["atlas", *options, "--", str(file)], os.environ)


def compile_solvers() -> None:
    """Compile the fast solvers now: minutes, once on a machine. Services do it in the background."""
    become_worker(["compile"], os.environ)


def calibrate(
    quick: Annotated[bool, typer.Option("--quick", help="fewer problems, each measured once")] = False,
    as_json: AsJson = False,
    database_url: DatabaseUrl = None,
) -> None:
    """Measure the error and the time of every tier on this machine, and store the table."""
    settings = settings_of(database_url=database_url)
    migrate_database(settings)
    options = [name for name, given in (("--quick", quick), ("--json", as_json)) if given]
    become_worker(["calibrate", *options], worker_environment(settings))
