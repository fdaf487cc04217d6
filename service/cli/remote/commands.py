"""``polhode submit``, ``wait``, ``show``, ``get``, ``list``, ``tag`` and ``cancel``: they ask a service."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Literal

import typer

from service.cli.common import AsJson, Document

Url = Annotated[str | None, typer.Option(help="of the service. POLHODE_URL, else http://127.0.0.1:8000")]
Key = Annotated[str | None, typer.Option(help="API key. POLHODE_KEY, else none", show_default=False)]
ThingId = Annotated[
    str, typer.Argument(metavar="ID", help="of a job, a solution or a sweep", show_default=False)
]
Kind = Literal["solutions", "jobs", "sweeps"]
FileFormat = Literal["csv", "json", "ndjson", "npz", "arrow", "parquet"]


def submit(
    file: Document,
    wait: Annotated[bool, typer.Option("--wait", help="and wait until it is solved")] = False,
    url: Url = None,
    key: Key = None,
    as_json: AsJson = False,
) -> None:
    """Submit a problem, or a list of any length (JSON, NDJSON), to a service, and print the ids of the jobs.

    Of a list there is a line for each problem: its index, and its job or the reason of its refusal, which
    does not stop the others. A list that is submitted again within a day has the same jobs.
    """
    from service.cli.remote.work import submit_file  # noqa: PLC0415

    submit_file(file, wait=wait, url=url, key=key, as_json=as_json)


def wait_for(
    thing_ids: Annotated[
        list[str], typer.Argument(metavar="ID...", help="of jobs and sweeps", show_default=False)
    ],
    seconds: Annotated[float | None, typer.Option(min=0.0, help="wait no longer; they go on")] = None,
    url: Url = None,
    key: Key = None,
    as_json: AsJson = False,
) -> None:
    """Wait until jobs and sweeps have ended; exit with 1 if one of them failed."""
    from service.cli.remote.work import wait_for_all  # noqa: PLC0415

    wait_for_all(thing_ids, seconds=seconds, url=url, key=key, as_json=as_json)


def show(thing_id: ThingId, url: Url = None, key: Key = None, as_json: AsJson = False) -> None:
    """Show a job, a solution or a sweep."""
    from service.cli.remote.work import show_thing  # noqa: PLC0415

    show_thing(thing_id, url=url, key=key, as_json=as_json)


def get(
    thing_id: ThingId,
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="its ending names the format; - is CSV to stdout")
    ] = Path("-"),
    file_format: Annotated[FileFormat | None, typer.Option("--format", help="if the ending does not")] = None,
    start: Annotated[str | None, typer.Option(help="first time; 0 if left out")] = None,
    stop: Annotated[str | None, typer.Option(help="last time; the stored samples if left out")] = None,
    samples: Annotated[int | None, typer.Option(min=1, help="number of times")] = None,
    columns: Annotated[str | None, typer.Option(help="such as t,g1,g3")] = None,
    where: Annotated[str | None, typer.Option(help="points of a sweep, such as period<5")] = None,
    url: Url = None,
    key: Key = None,
) -> None:
    """Write the samples of a solution, or the points of a sweep, to a file."""
    from service.cli.remote.work import write_file  # noqa: PLC0415

    query = {"start": start, "stop": stop, "samples": samples, "columns": columns, "where": where}
    write_file(thing_id, out, file_format, query, url=url, key=key)


def list_things(
    where: Annotated[
        list[str] | None, typer.Argument(help="conditions, such as 'period<5'", show_default=False)
    ] = None,
    of: Annotated[Kind, typer.Option(help="what is listed")] = "solutions",
    order: Annotated[str | None, typer.Option(help="such as -energy; newest first if left out")] = None,
    columns: Annotated[str | None, typer.Option(help="such as id,period,/motion/lambda")] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="at most so many; 50, or all with --out")] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="write .csv, .parquet, .arrow or .ndjson; - is CSV"),
    ] = None,
    url: Url = None,
    key: Key = None,
    as_json: AsJson = False,
) -> None:
    """List solutions, jobs or sweeps that meet conditions."""
    from service.cli.remote.work import list_all  # noqa: PLC0415

    names = None if columns is None else columns.split(",")
    list_all(of, where or [], order, names, limit, out=out, url=url, key=key, as_json=as_json)


def tag(
    thing_id: ThingId,
    labels: Annotated[
        list[str] | None,
        typer.Argument(metavar="NAME=VALUE...", help="NAME= takes a label away", show_default=False),
    ] = None,
    note: Annotated[str | None, typer.Option(help="text beside the labels")] = None,
    url: Url = None,
    key: Key = None,
    as_json: AsJson = False,
) -> None:
    """Change the labels and the note of a job, a solution or a sweep."""
    from service.cli.remote.work import tag_thing  # noqa: PLC0415

    tag_thing(thing_id, labels or [], note, url=url, key=key, as_json=as_json)


def cancel(thing_id: ThingId, url: Url = None, key: Key = None) -> None:
    """Cancel a job or a sweep; computed points stay."""
    from service.cli.remote.work import cancel_thing  # noqa: PLC0415

    cancel_thing(thing_id, url=url, key=key)


COMMANDS: Mapping[str, Callable[..., None]] = {
    "submit": submit,
    "wait": wait_for,
    "show": show,
    "get": get,
    "list": list_things,
    "tag": tag,
    "cancel": cancel,
}
