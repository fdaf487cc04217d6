"""Registers the commands of ``polhode`` on one command line.

Exit codes: 0 done, 1 refused or failed with the reason on stderr, 2 wrong usage,
130 interrupted by Ctrl-C. Heavy modules are imported by the commands that need
them, so that ``polhode worker`` does not load the web framework.
"""

from importlib.metadata import version
from typing import Annotated

import typer

from service.cli import doctor, documents, families, keys, serving, storage, sweeps
from service.cli.common import REFUSED
from service.dynamics.numerics import NUMERICS
from service.terminal import FileFaultError, answer, say

app = typer.Typer(
    name="polhode",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)

for _command in (
    serving.serve,
    serving.worker,
    serving.migrate,
    documents.validate,
    documents.solve,
    families.families,
    sweeps.sweep,
    documents.calibrate,
    doctor.doctor,
    storage.backup,
    storage.restore,
    storage.prune,
):
    app.command()(_command)
app.command(name="compile")(documents.compile_solvers)
app.add_typer(keys.app, name="keys")


def _tell_version(is_asked: bool) -> None:
    if is_asked:
        answer(f"polhode {version('polhode')}, numerics {NUMERICS}\n")
        raise typer.Exit


@app.callback()
def options(
    is_version: Annotated[
        bool, typer.Option("--version", callback=_tell_version, is_eager=True, help="print the version")
    ] = False,
) -> None:
    """Motions of a rigid body about a fixed point: verdicts, solutions and their database, as a service."""


def run() -> None:
    """Run the command line."""
    try:
        app()
    except FileFaultError as fault:
        say(str(fault))
        raise SystemExit(REFUSED) from fault
