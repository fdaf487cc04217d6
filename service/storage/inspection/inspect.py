"""Checks a whole database: every invariant, and the database's own integrity check."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from sqlalchemy import func, select, text
from sqlalchemy.orm import Session

from service.storage.database.database import Database
from service.storage.database.revisions import fault_of, newest_revision, stored_revision
from service.storage.inspection.invariants import Invariant, invariants_of_jobs, invariants_of_keys
from service.storage.inspection.sweep_checks import invariants_of_sweeps

EXAMPLES = 5
"""Largest number of ids of violating rows that are listed for each invariant."""


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of checking one invariant."""

    code: str
    says: str
    broken: int = 0
    """Number of rows that violate it."""
    examples: tuple[str, ...] = ()
    """The ids of some of them."""
    is_warning: bool = False
    remedy: str | None = None
    """The effect of the repair, in words; None if only a person can repair it."""
    mended: int = 0

    @property
    def is_clean(self) -> bool:
        """Nothing is wrong, though work may have stalled."""
        return self.is_warning or self.broken == 0


def inspect(database: Database) -> Iterator[Finding]:
    """Yield the finding about the schema and, if it is that of this version, one for every invariant."""
    schema = check_schema(database)
    yield schema
    if not schema.is_clean:
        return
    yield from _check_file(database)
    for invariant in invariants():
        yield check(database, invariant)


def invariants() -> Sequence[Invariant]:
    """Return every invariant: references first, since their repair violates others, repaired later."""
    return [*invariants_of_jobs(), *invariants_of_sweeps(), *invariants_of_keys()]


def repair(database: Database) -> Iterator[Finding]:
    """Repair what can be repaired; yield each violated invariant with the number of repaired rows."""
    for invariant in invariants():
        finding = check(database, invariant)
        if finding.broken and invariant.remedy is not None:
            yield replace(finding, mended=invariant.remedy.apply(database, invariant.broken))


def check(database: Database, invariant: Invariant) -> Finding:
    """Count the rows that violate an invariant."""
    finding = Finding(
        invariant.code,
        invariant.says,
        is_warning=invariant.is_warning,
        remedy=None if invariant.remedy is None else invariant.remedy.says,
    )
    with database.read() as session:
        # Almost always there are none; then the count is not needed.
        examples = session.scalars(invariant.broken.limit(EXAMPLES)).all()
        if not examples:
            return finding
        broken = session.scalar(select(func.count()).select_from(invariant.broken.subquery()))
    return replace(finding, broken=broken or len(examples), examples=tuple(map(str, examples)))


def check_schema(database: Database) -> Finding:
    """Return the finding about the schema version."""
    with database.read() as session:
        stored = stored_revision(session.connection())
    law, fault = f"the schema is that of this version, {newest_revision()}", fault_of(stored)
    if fault is None:
        return Finding("schema", law)
    return Finding("schema", f"{law}: {fault}", broken=1, examples=(str(stored),))


def _check_file(database: Database) -> Iterator[Finding]:
    """Run SQLite's own integrity check; Postgres has page checksums instead."""
    if database.engine.dialect.name != "sqlite":
        return
    with database.read() as session:
        faults = [line for line in _lines(session, "PRAGMA integrity_check") if line != "ok"]
    finding = Finding("file", "the pages and indexes of the file are sound")
    yield replace(finding, broken=len(faults), examples=tuple(faults[:EXAMPLES]))
    if database.file is not None:
        says = "the file and those beside it are private to their owner"
        warning = database.file.mode_warning()
        yield Finding(
            "file_mode",
            says,
            broken=int(warning is not None),
            examples=() if warning is None else (warning,),
            is_warning=True,
        )


def _lines(session: Session, statement: str) -> list[str]:
    return [str(line) for line in session.scalars(text(statement))]
