"""``polhode sweep``: computes the points of a sweep, here or by a service."""

import os
from pathlib import Path
from typing import Annotated

import typer

from service.cli.common import WRONG_USAGE, AsJson, Document, become_worker, fail
from service.cli.remote.commands import Key, Url


def sweep(
    file: Document,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="write the points: .parquet, .arrow or .csv; - is CSV to stdout"),
    ] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="processes; one for each processor")] = None,
    remote: Annotated[bool, typer.Option("--remote", help="by a service, which keeps the points")] = False,
    url: Url = None,
    key: Key = None,
    as_json: AsJson = False,
) -> None:
    """Compute a sweep, here without a database or by a service; Ctrl-C keeps the points computed so far."""
    if remote or url is not None or key is not None:
        if workers is not None:
            fail("--workers is of this machine; a service has its own", WRONG_USAGE)
        from service.cli.remote.work import sweep_file  # noqa: PLC0415

        sweep_file(file, out, url=url, key=key, as_json=as_json)
        return
    options = ["--json"] if as_json else []
    if out is not None:
        options.append(f"--out={out}")
    if workers is not None:
        options += ["--workers", str(workers)]
    become_worker(["sweep", *options, "--", str(file)], os.environ)
