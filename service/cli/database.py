"""``polhode keys``, ``backup``, ``restore`` and ``prune``: the commands that administer a database."""

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from typing import TYPE_CHECKING, Annotated

import typer

from service.cli.common import (
    REFUSED,
    WRONG_USAGE,
    AsJson,
    Command,
    DatabaseUrl,
    fail,
    migrate_database,
    settings_of,
)
from service.jobs.keys import ApiKey, KeyNotFoundError, KeyStanding, Role, key_prefix
from service.logs import one_line
from service.schemas.reading.documents import instant_text
from service.terminal import answer, say

if TYPE_CHECKING:
    from service.settings import Settings
    from service.storage.keys import KeyStore
from pathlib import Path

MEGABYTE = 10**6

_SPAN = re.compile(r"([1-9][0-9]{0,5})([dhm])", re.ASCII)
_SECONDS = {"d": 86400, "h": 3600, "m": 60}

BackupFile = Annotated[Path, typer.Argument(metavar="FILE", show_default=False)]

keys = typer.Typer(help="Create, list and revoke API keys.", no_args_is_help=True, rich_markup_mode=None)


def seconds_of(text: str) -> float:
    """Return the seconds of a span such as 90d, 12h or 30m."""
    match = _SPAN.fullmatch(text)
    if match is None:
        raise typer.BadParameter(f"{text!r}; accepted are days, hours and minutes, such as 90d, 12h, 30m")
    return float(int(match[1]) * _SECONDS[match[2]])


@keys.command(cls=Command)
def create(
    role: Annotated[Role, typer.Option(help="each role includes those before it", show_default=False)],
    name: Annotated[str, typer.Option(help="owner or purpose; up to 128 characters")] = "",
    expires: Annotated[
        float | None,
        typer.Option(parser=seconds_of, metavar="SPAN", help="from now, such as 90d; never if left out"),
    ] = None,
    requests_per_second: Annotated[
        float | None, typer.Option(min=0.001, help="POLHODE_REQUESTS_PER_SECOND if left out")
    ] = None,
    queued_jobs: Annotated[
        int | None,
        typer.Option(
            min=0, max=2**31 - 1, help="of sweeps 100 points as one; POLHODE_MAX_QUEUED_JOBS if left out"
        ),
    ] = None,
    stored_megabytes: Annotated[
        int | None, typer.Option(min=0, max=10**12, help="POLHODE_MAX_STORED_MB if left out")
    ] = None,
    database_url: DatabaseUrl = None,
) -> None:
    """Create a key and print it once: only its hash is stored.

    From the first key on, every request needs one.
    """
    from service.storage.keys import KeyLimits  # noqa: PLC0415

    if len(name) > 128 or not name.isprintable():
        raise typer.BadParameter("up to 128 printable characters are accepted", param_hint="--name")
    limits = KeyLimits(
        requests_per_second=requests_per_second,
        queued_jobs=queued_jobs,
        stored_bytes=None if stored_megabytes is None else stored_megabytes * MEGABYTE,
    )
    with _store(settings_of(database_url=database_url)) as store:
        key, text = store.create(role, name=name, seconds=expires, limits=limits)
    until = "never expires" if key.expires_at is None else f"expires {_instant(key.expires_at)}"
    say(f"key {key.prefix}, role {key.role}, {until}; this is the only time it is shown:")
    answer(f"{text}\n")


@keys.command("list", cls=Command)
def list_keys(as_json: AsJson = False, database_url: DatabaseUrl = None) -> None:
    """List all keys, also expired and revoked ones, oldest first."""
    with _store(settings_of(database_url=database_url)) as store:
        listing = store.all()
    if as_json:
        answer(json.dumps([_document(key, listing.now) for key in listing.keys]) + "\n")
        return
    rows: list[tuple[str, ...]] = [
        ("PREFIX", "ROLE", "STATE", "CREATED", "EXPIRES", "REVOKED", "LAST USED", "STORED", "NAME")
    ]
    rows += [_row(key, listing.now) for key in listing.keys]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        line = "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        answer(f"{line.rstrip()}\n")


@keys.command(cls=Command)
def revoke(
    prefix: Annotated[str, typer.Argument(help="as `polhode keys list` shows it", show_default=False)],
    database_url: DatabaseUrl = None,
) -> None:
    """Revoke a key for good; a running service notices within two seconds."""
    with _store(settings_of(database_url=database_url)) as store:
        try:
            key = store.revoke(key_prefix(prefix) or prefix)
        except KeyNotFoundError as fault:
            fail(str(fault), REFUSED)
    say(f"key {key.prefix} is revoked")


def require_key(settings: "Settings") -> None:
    """Exit unless there is a live key: without one the service may answer this machine only."""
    with _store(settings) as store:
        listing = store.all()
    if not any(key.standing(listing.now) is KeyStanding.LIVE for key in listing.keys):
        fail(
            f"host {settings.host}: other machines could reach the service, and there is no API key that "
            "permits it; `polhode keys create --role ROLE` makes one. Without keys 127.0.0.1, ::1 and "
            "localhost are accepted",
            WRONG_USAGE,
        )


@contextmanager
def _store(settings: "Settings") -> Iterator["KeyStore"]:
    from service.storage.database.database import Database  # noqa: PLC0415
    from service.storage.keys import KeyStore  # noqa: PLC0415

    migrate_database(settings)
    database = Database(settings.database_url)
    try:
        yield KeyStore(database)
    finally:
        database.close()


def _document(key: ApiKey, now: datetime) -> dict[str, object]:
    return {
        "prefix": key.prefix,
        "role": key.role.value,
        "state": key.standing(now).value,
        "name": key.name,
        "created_at": instant_text(key.created_at),
        "expires_at": key.expires_at and instant_text(key.expires_at),
        "revoked_at": key.revoked_at and instant_text(key.revoked_at),
        "last_used_at": key.last_used_at and instant_text(key.last_used_at),
        "requests_per_second": key.requests_per_second,
        "max_queued_jobs": key.max_queued_jobs,
        "max_stored_bytes": key.max_stored_bytes,
        "stored_bytes": key.stored_bytes,
    }


def _row(key: ApiKey, now: datetime) -> tuple[str, ...]:
    return (
        key.prefix,
        key.role.value,
        key.standing(now).value,
        _instant(key.created_at),
        _instant(key.expires_at),
        _instant(key.revoked_at),
        _instant(key.last_used_at),
        f"{key.stored_bytes / MEGABYTE:.1f} MB",
        one_line(key.name) or "-",
    )


def _instant(instant: datetime | None) -> str:
    return "-" if instant is None else instant.strftime("%Y-%m-%d %H:%MZ")


def backup(
    file: BackupFile,
    force: Annotated[bool, typer.Option("--force", help="replace a file of that name")] = False,
    database_url: DatabaseUrl = None,
) -> None:
    """Write a checked copy of the database to a file; the service may keep running."""
    from service.storage.upkeep.backup import BackupError, back_up  # noqa: PLC0415

    settings = settings_of(database_url=database_url)
    try:
        contents = back_up(settings.database_url, file, force=force)
    except BackupError as fault:
        fail(f"no backup: {fault}", REFUSED)
    jobs, solutions = (contents.rows.get(name, 0) for name in ("jobs", "solutions"))
    size = file.stat().st_size / 1e6
    by = f", by {contents.made_by}" if contents.made_by else ""
    say(f"{file}: {jobs} jobs, {solutions} solutions, {contents.schema}, {size:.1f} MB{by}")


def restore(
    file: BackupFile,
    force: Annotated[bool, typer.Option("--force", help="replace a database that has jobs")] = False,
    database_url: DatabaseUrl = None,
) -> None:
    """Replace the database by a backup and migrate it to this version; the service must be stopped."""
    from sqlalchemy.exc import SQLAlchemyError  # noqa: PLC0415

    from service.storage.upkeep.backup import BackupError  # noqa: PLC0415
    from service.storage.upkeep.backup import restore as restore_database  # noqa: PLC0415

    settings = settings_of(database_url=database_url)
    try:
        contents = restore_database(settings.database_url, file, force=force)
    except (BackupError, SQLAlchemyError) as fault:
        fail(f"not restored: {getattr(fault, 'orig', None) or fault}", REFUSED)
    jobs, solutions = (contents.rows.get(name, 0) for name in ("jobs", "solutions"))
    say(f"restored {jobs} jobs, {solutions} solutions")


def prune(
    samples_older_than: Annotated[
        float | None,
        typer.Option(parser=seconds_of, metavar="SPAN", help="such as 30d. POLHODE_SAMPLES_DAYS if left out"),
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="only report what would be deleted")] = False,
    database_url: DatabaseUrl = None,
) -> None:
    """Delete old samples and surplus examinations, which are recomputed on request.

    The service may keep running.
    """
    from sqlalchemy.exc import SQLAlchemyError  # noqa: PLC0415

    from service.storage.database.database import Database  # noqa: PLC0415
    from service.storage.examinations import ExaminationStore  # noqa: PLC0415
    from service.storage.upkeep.retention import DAY_SECONDS, prune_samples  # noqa: PLC0415

    settings = settings_of(database_url=database_url)
    seconds = samples_older_than
    if seconds is None and settings.samples_days is not None:
        seconds = settings.samples_days * DAY_SECONDS
    if seconds is None:
        fail("the age is missing; give --samples-older-than 30d, or set POLHODE_SAMPLES_DAYS=30", WRONG_USAGE)
    migrate_database(settings)
    database = Database(settings.database_url)
    try:
        pruned = prune_samples(database, older_than_seconds=seconds, dry_run=dry_run)
        trimmed = ExaminationStore(database).trim(dry_run=dry_run)
    except SQLAlchemyError as fault:
        fail(f"not finished: {getattr(fault, 'orig', None) or fault}", REFUSED)
    finally:
        database.close()
    done = "would be deleted" if dry_run else "deleted"
    samples = f"samples of {pruned.solutions} solutions, {pruned.data_bytes / 1e6:.1f} MB"
    say(f"{samples}, and {trimmed} kept examinations {done}")
