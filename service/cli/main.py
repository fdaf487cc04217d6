"""The command ``polhode``.

Exit codes: 0 done, 1 refused or failed with the reason on stderr, 2 wrong usage.
Heavy modules are imported by the commands that need them: ``polhode worker``
does not wait for the web framework.
"""

import typer

from service.cli import doctor, documents, keys, serving, storage, sweeps

app = typer.Typer(
    name="polhode",
    help="Motions of a rigid body about a fixed point: verdicts, solutions and their database, as a service.",
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


def main() -> None:
    """Run the command line."""
    app()
