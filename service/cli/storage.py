"""``polhode backup``, ``restore`` and ``prune``."""

from pathlib import Path
from typing import Annotated

import typer

from service.cli.common import (
    REFUSED,
    WRONG_USAGE,
    DatabaseUrl,
    fail,
    migrate_database,
    settings_of,
)
from service.cli.keys import seconds_of
from service.terminal import say

BackupFile = Annotated[Path, typer.Argument(metavar="FILE", show_default=False)]


def backup(
    file: BackupFile,
    force: Annotated[bool, typer.Option("--force", help="replace a file of that name")] = False,
    database_url: DatabaseUrl = None,
) -> None:
    """Write a checked copy of the database to a file; the service may keep running."""
    from service.storage.upkeep.backup import BackupError, back_up  # noqa: PLC0415

    settings = settings_of(database_url=database_url)
    try:
        contents = back_up(settings.database_url, file, replace=force)
    except BackupError as fault:
        fail(f"no backup: {fault}", REFUSED)
    jobs, solutions = (contents.rows.get(name, 0) for name in ("jobs", "solutions"))
    size = file.stat().st_size / 1e6
    say(f"{file}: {jobs} jobs, {solutions} solutions, {contents.schema}, {size:.1f} MB")


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
