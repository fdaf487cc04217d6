"""The work of the remote commands: ask by the client, and print tables for people or JSON for programs."""

import json
import shutil
import sys
import time
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self  # Any: documents of a service

import typer

import polhode as ph
from polhode.clients import Resource
from polhode.jobs import Job
from polhode.listings import Item, Listing
from polhode.lists import JobList, submitted
from polhode.motions import Motion
from polhode.sweeps import Sweep
from polhode.transport.carriers import ThreadCarrier
from service.cli.common import REFUSED, WRONG_USAGE, fail
from service.logs import one_line
from service.schemas.replies.text import curve_text, describe_record, potential_text, rounded
from service.terminal import (
    STANDARD_STREAM,
    FileFaultError,
    OutputFile,
    answer,
    check_writable,
    read_document,
    read_items,
    say,
)

_LONGEST = 100
_NARROWEST = 6
LISTED = 50
"""Rows that a list prints."""


def table(rows: Iterable[Iterable[object]], *, width: int | None = None) -> str:
    """Return rows as lines with aligned columns; the widest are cut until they fit into ``width``."""
    cells = [[_cell(each) for each in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    while width is not None and sum(widths) + 2 * (len(widths) - 1) > width and len(widths) > 1:
        # The first one is the id, which people copy; if the others are narrow, the last one is left out.
        widest = max(range(1, len(widths)), key=widths.__getitem__)
        if widths[widest] > _NARROWEST:
            widths[widest] -= 1
        else:
            del widths[-1]
    cells = [
        [c if len(c) <= w else f"{c[: w - 1]}…" for c, w in zip(row, widths, strict=False)] for row in cells
    ]
    lines = ("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in cells)
    return "".join(f"{line.rstrip()}\n" for line in lines)


def report(document: Mapping[str, object]) -> str:
    """Return what is stored as lines for people; all of it is in ``--json``."""
    return "".join(f"{one_line(line)}\n" for line in describe_record(document))


def _pairs(value: Mapping[str, object]) -> str | None:
    return ", ".join(f"{key}={each}" for key, each in value.items() if each is not None) or None


def _cell(value: object) -> str:
    if isinstance(value, dict):
        value = _pairs(value)
    if value is None:
        return "-"
    text = one_line(repr(value) if isinstance(value, float) else str(value))
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


_ENDINGS = {f".{name}": name for name in ("csv", "json", "ndjson", "npz", "arrow", "parquet")}


@contextmanager
def connected(url: str | None, key: str | None) -> Iterator[ph.Client]:
    """Yield a client; what goes wrong ends the command with its reason."""
    try:
        with ph.connect(url, key) as client:
            yield client
    except ph.WrongArgumentError as fault:
        fail(str(fault), WRONG_USAGE)
    except ph.PolhodeError as fault:
        for line in str(fault).splitlines():
            say(line)
        raise typer.Exit(REFUSED) from fault


def submit_file(file: Path, *, wait: bool, url: str | None, key: str | None, as_json: bool) -> None:
    """Submit the document of a file, or all of its list: what is refused does not stop the others."""
    is_list, documents = read_items(file)
    with connected(url, key) as client:
        if is_list:
            _submit_list(client, documents, wait=wait, as_json=as_json)
            return
        document = next(documents)
        if isinstance(document, FileFaultError):
            raise document
        if not isinstance(document, dict):
            fail(f"{file}: a problem is a JSON object, and a list is one of such", REFUSED)
        job = client.submit(document)
        if wait:
            _wait(client, [job.id], None, as_json=as_json)
        elif as_json:
            _print_json([job.document], is_list=False)
        else:
            answer(f"{job.id}\n")


def _submit_list(client: ph.Client, documents: Iterable[object], *, wait: bool, as_json: bool) -> None:
    """Submit a list in pieces; print a line for each problem: its index, and its job or the reason.

    Exits with 1 in the end if any was refused.
    """
    ids: list[str | None] = []
    errors: dict[int, ph.PolhodeError] = {}
    shown: list[Mapping[str, object]] = []
    with Bar("submitted") as bar:
        for outcome in submitted(client.carrier, map(_problem_or_error, documents)):
            ids.append(outcome.id)
            if outcome.error is not None:
                errors[outcome.index] = outcome.error
            elif outcome.job is not None and as_json and not wait:
                shown.append(outcome.job)
            bar.show(len(ids), f"{len(errors)} refused" if errors else "")
            if not (as_json or wait):
                bar.hide()
                answer(_line_of(outcome.index, outcome.id, outcome.error))
    if wait:
        _wait_for_list(client, ids, errors, as_json=as_json)
    elif as_json:
        shown += [_error_document(index, error) for index, error in errors.items()]
        _print_json(shown, is_list=True)
    if errors:
        say(f"{len(errors)} of {len(ids)} problems were refused or failed")
        raise typer.Exit(REFUSED)


def _wait_for_list(
    client: ph.Client, ids: Sequence[str | None], errors: dict[int, ph.PolhodeError], *, as_json: bool
) -> None:
    """Wait for the jobs of a list; print a line for each as it ends, and put what failed into ``errors``."""
    solved: dict[int, Mapping[str, object]] = {}
    with Bar("solved") as bar:
        for index, outcome in JobList(client.carrier, ids, errors).as_completed():
            if isinstance(outcome, Motion):
                solved[index] = outcome.document
            else:
                errors[index] = outcome
            bar.show(len(solved) + len(errors), f"of {len(ids)}")
            if not as_json:
                bar.hide()
                known = outcome.id if isinstance(outcome, Motion) else None
                answer(_line_of(index, known, errors.get(index)))
    if as_json:
        failed = [_error_document(index, error) for index, error in errors.items()]
        _print_json([*(solved[index] for index in sorted(solved)), *failed], is_list=True)


def _problem_or_error(document: object) -> Mapping[str, object] | ph.PolhodeError:
    if isinstance(document, FileFaultError):
        return ph.WrongArgumentError(str(document))
    if not isinstance(document, dict):
        return ph.WrongArgumentError("a problem is a JSON object")
    return document


def _line_of(index: int, thing_id: str | None, error: ph.PolhodeError | None) -> str:
    reason = "" if error is None else " ".join(str(error).split())
    return f"{index}  {thing_id or '-'}{'  ' + one_line(reason) if reason else ''}\n"


def _error_document(index: int, error: ph.PolhodeError) -> dict[str, object]:
    return {"index": index, "problem": getattr(error, "document", None) or {"detail": str(error)}}


class Bar:
    """A line on a terminal that tells how far something is; nothing where nobody watches."""

    _SECONDS = 0.1

    def __init__(self, what: str) -> None:
        self._what, self._shown, self._is_watched = what, 0.0, sys.stderr is not None and sys.stderr.isatty()

    def show(self, done: int, further: str) -> None:
        """Show a number, not more often than eyes follow."""
        now = time.monotonic()
        if self._is_watched and now - self._shown >= self._SECONDS:
            self._shown = now
            sys.stderr.write(f"\r{self._what} {done:,} {further}\x1b[K")
            sys.stderr.flush()

    def hide(self) -> None:
        """Clear the line, for what is printed next."""
        if self._is_watched and self._shown:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.hide()


def judge_file(file: Path, *, url: str | None, key: str | None, as_json: bool) -> None:
    """Print the verdict of a service on the document of a file; exit with 1 if it is not admissible."""
    document = read_document(file)
    if not isinstance(document, dict):
        fail(f"{file}: a question is a JSON object with body and potential", REFUSED)
    with connected(url, key) as client:
        found = client.judge(document).document
    if as_json:
        answer(json.dumps(found) + "\n")
    # Loaded for a verdict only: other commands are there sooner.
    from service.schemas.replies.text import describe_verdict  # noqa: PLC0415
    from service.schemas.replies.verdict import VerdictOut  # noqa: PLC0415

    verdict = VerdictOut.model_validate(found)
    if verdict.verdict is None:
        say("a motion from any state: its potential needs no verdict")
        return
    if not as_json:
        answer(f"{describe_verdict(verdict)}\n")
    if verdict.verdict != "admissible":
        fail(f"the potential is {verdict.verdict}", REFUSED)


def study_file(file: Path, *, url: str | None, key: str | None, as_json: bool) -> None:
    """Print a service's answer to the study of a file."""
    document = read_document(file)
    if not isinstance(document, dict):
        fail(f'{file}: a study is a JSON object with "what"', REFUSED)
    with connected(url, key) as client:
        found = client.study(document).document
    # Loaded for an answer only.
    from service.schemas.replies.study import describe_answer  # noqa: PLC0415

    answer((json.dumps(found) if as_json else describe_answer(found)) + "\n")


def wait_for_all(
    thing_ids: Sequence[str], *, seconds: float | None, url: str | None, key: str | None, as_json: bool
) -> None:
    """Wait for jobs and sweeps."""
    with connected(url, key) as client:
        _wait(client, thing_ids, seconds, as_json=as_json)


def _wait(client: ph.Client, thing_ids: Sequence[str], seconds: float | None, *, as_json: bool) -> None:
    ended: list[Resource[ThreadCarrier]] = []
    failures = 0
    for thing_id in thing_ids:
        thing = client.find(thing_id)
        if isinstance(thing, Job):
            try:
                thing = thing.wait(seconds=seconds)
            except ph.FailedError as fault:
                say(f"{thing_id}: {fault}")
                failures += 1
                continue
        elif isinstance(thing, Sweep):
            thing.wait(seconds=seconds)
        ended.append(thing)
    if as_json:
        _print_json([_document(each) for each in ended], is_list=len(thing_ids) > 1)
    else:
        answer("\n".join(report(_document(each)) for each in ended))
    if failures:
        raise typer.Exit(REFUSED)


def show_thing(thing_id: str, *, url: str | None, key: str | None, as_json: bool) -> None:
    """Print a job, a solution or a sweep."""
    with connected(url, key) as client:
        _print(client.find(thing_id), as_json=as_json)


def write_file(
    thing_id: str,
    out: Path,
    file_format: str | None,
    query: Mapping[str, str | int | None],
    *,
    url: str | None,
    key: str | None,
) -> None:
    """Write samples or points."""
    chosen = file_format or ("csv" if out == STANDARD_STREAM else _ENDINGS.get(out.suffix))
    if chosen is None:
        fail(f"--out {out}: accepted endings are {', '.join(_ENDINGS)}; or give --format", WRONG_USAGE)
    check_writable(out)
    with connected(url, key) as client:
        content = client.download(thing_id, chosen, **query)
    with OutputFile(out) as file:
        file.write(content)


def list_all(
    of: str,
    where: Sequence[str],
    order: str | None,
    columns: Sequence[str] | None,
    limit: int | None,
    *,
    out: Path | None,
    url: str | None,
    key: str | None,
    as_json: bool,
) -> None:
    """Print what meets the conditions, or write it to a file."""
    chosen = _format_of(out, [ending for ending, name in _ENDINGS.items() if name != "npz"])
    with connected(url, key) as client:
        match of:
            case "jobs":
                rows = _listed(client.jobs(*where, order=order), columns, limit, chosen, as_json=as_json)
            case "sweeps":
                rows = _listed(client.sweeps(*where, order=order), columns, limit, chosen, as_json=as_json)
            case _:
                rows = _listed(client.solutions(*where, order=order), columns, limit, chosen, as_json=as_json)
    if isinstance(rows, bytes):
        with OutputFile(out or STANDARD_STREAM) as file:
            file.write(rows)
    elif as_json:
        answer(json.dumps(rows) + "\n")
    elif rows:
        shown = rows if columns is not None else [{k: rounded(v) for k, v in row.items()} for row in rows]
        answer(table([list(rows[0]), *(row.values() for row in shown)], width=_width()))
    else:
        say(f"no {of} meet this")


def _listed(
    listing: Listing[ThreadCarrier, Item],
    columns: Sequence[str] | None,
    limit: int | None,
    file_format: str | None,
    *,
    as_json: bool,
) -> list[dict[str, object]] | bytes:
    """Return the rows of a list, or its file."""
    if file_format is not None:
        return listing.download(file_format, columns, limit=limit)
    most = limit or LISTED
    if as_json or columns is not None or "points" in listing.columns:
        return listing.rows(columns or [*listing.columns, "labels"], limit=most)
    found = listing.all(limit=most)
    return [_row_of(each.document) for each in found if isinstance(each, Job | Motion)]


def _row_of(document: Mapping[str, Any]) -> dict[str, object]:
    """Return what people look for in a list: the problem, its numbers with few digits, and the labels."""
    problem = document["problem"]
    row: dict[str, object] = {
        "id": document["id"],
        "potential": potential_text(problem["potential"]),
        "λ": curve_text(problem.get("motion", {})),
    }
    if "state" in document:
        row |= {"state": document["state"], "solution": document["solution"]}
    else:
        numbers = {name: (document[name] or {}).get("value") for name in ("period", "energy")}
        row |= {name: float(each) if isinstance(each, str) else each for name, each in numbers.items()}
        row |= {"error": f"{document['error']:.0e}", "tier": document["tier"]}
    row["created"] = str(document["created_at"])[:16].replace("T", " ")
    return row | {"labels": _pairs(document["labels"])}


def _width() -> int | None:
    """Return the columns of the terminal; None where nobody looks."""
    return shutil.get_terminal_size().columns if sys.stdout is not None and sys.stdout.isatty() else None


def tag_thing(
    thing_id: str, labels: Sequence[str], note: str | None, *, url: str | None, key: str | None, as_json: bool
) -> None:
    """Change labels and note."""
    changes: dict[str, str | None] = {}
    for label in labels:
        name, mark, value = label.partition("=")
        if not mark or not name:
            fail(f"{label!r}; accepted is NAME=VALUE, or NAME= to take a label away", WRONG_USAGE)
        changes[name] = value or None
    if not changes and note is None:
        fail("neither a label nor a note was given; such as project=thesis is accepted", WRONG_USAGE)
    with connected(url, key) as client:
        _print(client.tag(thing_id, changes, note=note), as_json=as_json)


def cancel_thing(thing_id: str, *, url: str | None, key: str | None) -> None:
    """Cancel a job or a sweep."""
    with connected(url, key) as client:
        thing = client.find(thing_id)
        if isinstance(thing, Motion):
            fail(f"{thing_id} is a solution; jobs and sweeps can be cancelled", REFUSED)
        thing.cancel()
        say(f"{thing_id} is cancelled")


def sweep_file(file: Path, out: Path | None, *, url: str | None, key: str | None, as_json: bool) -> None:
    """Have the sweep of a file computed by a service, and write its points."""
    chosen = _format_of(out, _ENDINGS)
    document = read_document(file)
    if not isinstance(document, dict) or "base" not in document:
        fail(f"{file}: a sweep is a JSON object with base and axes", REFUSED)
    with connected(url, key) as client:
        sweep = client.sweep(document, wait=False)
        say(f"sweep {sweep.id}")
        with going_on(sweep.id):
            sweep.wait()
        if out is not None and chosen is not None:
            content = client.download(sweep.id, chosen)
            with OutputFile(out) as written:
                written.write(content)
        if out != STANDARD_STREAM:
            _print(sweep, as_json=as_json)


def _format_of(out: Path | None, endings: Collection[str]) -> str | None:
    """Return the format of a file that can be written, by its ending; None without a file."""
    if out is None:
        return None
    if out != STANDARD_STREAM and out.suffix not in endings:
        fail(f"--out {out}: accepted endings are {', '.join(endings)}", WRONG_USAGE)
    check_writable(out)
    return "csv" if out == STANDARD_STREAM else _ENDINGS[out.suffix]


@contextmanager
def going_on(sweep_id: str) -> Iterator[None]:
    """Tell whoever interrupts waiting that the sweep goes on, and what can be done with it."""
    try:
        yield
    except KeyboardInterrupt:
        say("\nthe sweep goes on at the service; wait for it, get its points, or cancel it:")
        for line in (f"wait {sweep_id}", f"get {sweep_id} --out points.parquet", f"cancel {sweep_id}"):
            say(f"  polhode {line}")
        raise


def _document(thing: Resource[ThreadCarrier]) -> Mapping[str, object]:
    return thing.state if isinstance(thing, Sweep) else thing.document


def _print(thing: Resource[ThreadCarrier], *, as_json: bool) -> None:
    document = _document(thing)
    answer(json.dumps(document) + "\n" if as_json else report(document))


def _print_json(documents: Sequence[Mapping[str, object]], *, is_list: bool) -> None:
    """Print a list for a list, and a document for one."""
    answer("".join(json.dumps(each) + "\n" for each in ([list(documents)] if is_list else documents)))
