"""Registers the commands of ``polhode`` on one command line.

Exit codes: 0 done, 1 refused or failed with the reason on stderr, 2 wrong usage,
130 interrupted by Ctrl-C. Commands import what they need when they run: help and a refused
option are there at once, and ``polhode worker`` does not load the web framework.
"""

from typing import Annotated

import typer

from service.cli import doctor, documents, families, keys, serving, storage, sweeps
from service.cli.common import REFUSED, Command
from service.cli.examples import examples_of
from service.cli.remote import commands as remote
from service.dynamics.numerics import NUMERICS
from service.terminal import FileFaultError, answer, say
from service.versions import version_of

app = typer.Typer(
    name="polhode",
    add_completion=True,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain text: loading rich takes longer than everything else that help needs
)

for _command in (
    serving.serve,
    serving.worker,
    serving.migrate,
    documents.validate,
    documents.solve,
    documents.atlas,
    families.families,
    sweeps.sweep,
    documents.calibrate,
    doctor.doctor,
    storage.backup,
    storage.restore,
    storage.prune,
):
    app.command(cls=Command, epilog=examples_of(_command.__name__))(_command)
for _name, _other in {**remote.COMMANDS, "compile": documents.compile_solvers}.items():
    app.command(name=_name, cls=Command, epilog=examples_of(_name))(_other)
app.add_typer(keys.app, name="keys")


def _tell_version(is_asked: bool) -> None:
    if is_asked:
        answer(f"polhode {version_of('polhode')}, numerics {NUMERICS}\n")
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
    except ModuleNotFoundError as fault:
        if fault.name != "polhode":
            raise
        say("this command needs the Python client, which is not installed: pip install ./service/client")
        raise SystemExit(REFUSED) from fault
