"""``polhode sweep``: computes the points of a sweep without a service."""

import os
from pathlib import Path
from typing import Annotated

import typer

from service.cli.common import AsJson, Document, become_worker


def sweep(
    file: Document,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="write the points: .parquet, .arrow or .csv; - is CSV to stdout"),
    ] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="processes; one for each processor")] = None,
    as_json: AsJson = False,
) -> None:
    """Compute a sweep without a database; Ctrl-C keeps the points computed so far."""
    options = ["--json"] if as_json else []
    if out is not None:
        options.append(f"--out={out}")
    if workers is not None:
        options += ["--workers", str(workers)]
    become_worker(["sweep", *options, "--", str(file)], os.environ)
