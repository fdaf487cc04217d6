"""The commands of ``polhode``: their options, help and examples.

Exit codes: 0 done, 1 refused or failed with the reason on stderr, 2 wrong usage,
130 interrupted by Ctrl-C. Commands import what they need when they run: help and a refused
option are there at once, and ``polhode worker`` does not load the web framework.
"""

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated

import typer

from service.cli import database
from service.cli.common import (
    REFUSED,
    WRONG_USAGE,
    AsJson,
    Command,
    DatabaseUrl,
    Document,
    become_worker,
    fail,
    migrate_database,
    settings_of,
)
from service.cli.remote import commands as remote
from service.cli.remote.commands import Key, Url
from service.dynamics.numerics import NUMERICS
from service.local.workers import worker_environment
from service.logs import LOG_LEVELS
from service.terminal import FileFaultError, answer, say
from service.versions import version_of

app = typer.Typer(
    name="polhode",
    add_completion=True,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain text: loading rich takes longer than everything else that help needs
)

_ID = "01a20942-d407-7053-8f52-16b05c137715"
_EXAMPLES = {
    "serve": ("polhode serve --port 8000 --workers 4",),
    "worker": ("POLHODE_ENGINE=postgres polhode worker --slots 8",),
    "migrate": ("polhode migrate",),
    "validate": ("polhode validate examples/first.json", "polhode validate - --json < problem.json"),
    "solve": ("polhode solve examples/first.json --csv samples.csv", "polhode solve problem.json --json"),
    "atlas": ("polhode atlas problem.json --picture atlas.png",),
    "study": ("polhode study examples/search.json", "polhode study search.json --json"),
    "families": ("polhode families", "polhode families rational --json"),
    "sweep": (
        "polhode sweep examples/sweep.json --out points.parquet",
        "polhode sweep examples/sweep.json --remote --out points.csv",
    ),
    "calibrate": ("polhode calibrate --quick",),
    "compile": ("polhode compile",),
    "doctor": ("polhode doctor --sample 20",),
    "backup": ("polhode backup /backups/polhode-1.db",),
    "restore": ("polhode restore /backups/polhode-1.db",),
    "prune": ("polhode prune --samples-older-than 90d --dry-run",),
    "submit": ("polhode submit problem.json --wait", "sed s/-1/-2/ problem.json | polhode submit -"),
    "wait": (f"polhode wait {_ID} --seconds 60",),
    "show": (f"polhode show {_ID} --json",),
    "get": (
        f"polhode get {_ID} --out samples.parquet",
        f"polhode get {_ID} --start 1e6 --stop 1000010 --samples 11",
    ),
    "list": ("polhode list 'period<5, tier=high' --order -energy", "polhode list state=failed --of jobs"),
    "tag": (f"polhode tag {_ID} project=thesis figure=3",),
    "cancel": (f"polhode cancel {_ID}",),
}


def examples_of(name: str) -> str:
    """Return what the help of a command ends with; the mark keeps its lines as they are."""
    return "\b\nExamples:\n" + "\n".join(f"  {line}" for line in _EXAMPLES[name])


def serve(
    host: Annotated[
        str | None, typer.Option(help="Others than loopback need keys. POLHODE_HOST, else 127.0.0.1")
    ] = None,
    port: Annotated[int | None, typer.Option(help="0: any free one. POLHODE_PORT, else 8000")] = None,
    workers: Annotated[
        int | None, typer.Option(help="Jobs at the same time; 0: API only. POLHODE_WORKERS, else 1")
    ] = None,
    database_url: DatabaseUrl = None,
    log_level: Annotated[
        str | None, typer.Option(help=f"{' | '.join(LOG_LEVELS)}. POLHODE_LOG_LEVEL, else warning")
    ] = None,
) -> None:
    """Migrate the database, serve the API and run local workers until SIGTERM or SIGINT."""
    settings = settings_of(
        host=host, port=port, workers=workers, database_url=database_url, log_level=log_level
    )
    from service.cli.server import run_service  # noqa: PLC0415

    run_service(settings)


def worker(
    slots: Annotated[
        int | None, typer.Option(min=1, help="Jobs at the same time. POLHODE_WORKERS, else 1")
    ] = None,
    database_url: DatabaseUrl = None,
) -> None:
    """Compute queued jobs until SIGTERM or SIGINT."""
    settings = settings_of(workers=slots, database_url=database_url)
    become_worker("run", worker_environment(settings), slots=max(settings.workers, 1))


def migrate(database_url: DatabaseUrl = None) -> None:
    """Create the tables, or upgrade them to this version."""
    migrate_database(settings_of(database_url=database_url))


def validate(
    file: Document,
    as_json: AsJson = False,
    formulas: Annotated[
        str | None,
        typer.Option(metavar="FORMATS", help="the formulas as text,latex,mathml, simplified where possible"),
    ] = None,
    url: Annotated[str | None, typer.Option(help="ask the service there, which is quicker")] = None,
    key: Key = None,
) -> None:
    """Tell whether a potential admits planar motions, or whether a whole problem can be solved."""
    if url is not None or key is not None:
        if formulas is not None:
            fail("--formulas is of this machine; a service is asked without it", WRONG_USAGE)
        from service.cli.remote.work import judge_file  # noqa: PLC0415

        judge_file(file, url=url, key=key, as_json=as_json)
        return
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
    become_worker("solve", os.environ, file=file, csv=csv, as_json=as_json)


def atlas(
    file: Document,
    as_json: AsJson = False,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="OUT", help="write a picture: .svg or .png; - is SVG to stdout"),
    ] = None,
) -> None:
    """Tell for which λ of a range there are planar motions, of which kind, and where that changes."""
    become_worker("atlas", os.environ, file=file, picture=picture, as_json=as_json)


def study(
    file: Document,
    as_json: AsJson = False,
    url: Annotated[str | None, typer.Option(help="ask the service there")] = None,
    key: Key = None,
) -> None:
    """Answer a question about numbers of a problem: a document with "what"."""
    if url is not None or key is not None:
        from service.cli.remote.work import study_file  # noqa: PLC0415

        study_file(file, url=url, key=key, as_json=as_json)
        return
    become_worker("study", os.environ, file=file, as_json=as_json)


def compile_solvers() -> None:
    """Compile the fast solvers now: minutes, once on a machine. Services do it in the background."""
    become_worker("compile", os.environ)


def calibrate(
    quick: Annotated[bool, typer.Option("--quick", help="fewer problems, each measured once")] = False,
    as_json: AsJson = False,
    database_url: DatabaseUrl = None,
) -> None:
    """Measure the error and the time of every tier on this machine, and store the table."""
    settings = settings_of(database_url=database_url)
    migrate_database(settings)
    become_worker("calibrate", worker_environment(settings), quick=quick, as_json=as_json)


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
    become_worker("sweep", os.environ, file=file, out=out, workers=workers, as_json=as_json)


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
    options = {"fix": fix, "sample": sample, "every": every, "seed": seed, "as_json": as_json}
    become_worker("doctor", worker_environment(settings), **options)


_WIDTH = 28


def families(
    name: Annotated[
        str | None, typer.Argument(help="a family or a case; all in one line each if left out")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the families of potentials and the cases, or tell all of one, with a problem that runs."""
    groups = dict(_groups())
    rows = [row for group in groups.values() for row in group]
    if name is None:
        if as_json:
            answer(json.dumps([row for _, row in rows]) + "\n")
            return
        for place, (heading, group) in enumerate(groups.items()):
            lines = "".join(f"  {key:<{_WIDTH}}{_line(row)}\n" for key, row in group)
            answer(f"{'' if place == 0 else chr(10)}{heading}\n{lines}")
        return
    matches = [row for key, row in rows if key == name]
    if not matches:
        fail(
            f"there is no family and no case {name!r}; there are {', '.join(key for key, _ in rows)}", REFUSED
        )
    answer(json.dumps(matches[0]) + "\n" if as_json else "".join(f"{line}\n" for line in _all_of(matches[0])))


Row = tuple[str, Mapping[str, object]]


def _groups() -> Iterator[tuple[str, list[Row]]]:
    from service import catalogue  # noqa: PLC0415

    families: list[Row] = [(family.type, family.model_dump()) for family in catalogue.families()]
    yield "Families of potentials: potential.type of a problem", families
    # One word names a potential here and a motion below: the motion has the plain one.
    named: list[Row] = [
        (case.name if case.name not in _CLASSICAL else f"{case.name}-potential", case.model_dump())
        for case in catalogue.cases()
    ]
    yield "Named potentials with a further integral", named
    classical: list[Row] = [(case.case, case.model_dump()) for case in catalogue.classical()]
    yield "Classical cases of the heavy body: motion.case of a problem", classical


_CLASSICAL = ("chaplygin",)


def _line(row: Mapping[str, object]) -> str:
    year = row.get("year")
    return f"{row['title']}{f', {year}' if year else ''}"


def _all_of(row: Mapping[str, object]) -> Iterator[str]:
    for field, content in row.items():
        if field == "example":
            continue
        parts = [f"{k}: {v}" for k, v in content.items()] if isinstance(content, dict) else content
        lines = parts if isinstance(parts, list) else ["not known" if parts is None else str(parts)]
        for number, line in enumerate(lines):
            yield f"{field if number == 0 else '':<14}{line}"
    if row["example"] is not None:
        yield "example"
        yield json.dumps(row["example"], indent=2)


for _command in (
    serve,
    worker,
    migrate,
    validate,
    solve,
    atlas,
    study,
    families,
    sweep,
    calibrate,
    doctor,
    database.backup,
    database.restore,
    database.prune,
):
    app.command(cls=Command, epilog=examples_of(_command.__name__))(_command)
for _name, _other in {**remote.COMMANDS, "compile": compile_solvers}.items():
    app.command(name=_name, cls=Command, epilog=examples_of(_name))(_other)
app.add_typer(database.keys, name="keys")


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
