"""The invariant of API keys: a key is charged for exactly the bytes stored for it."""

from collections.abc import Iterator

from sqlalchemy import ColumnElement, func, select, update

from service.storage.database.database import Database
from service.storage.inspection.invariants import Invariant, Remedy
from service.storage.inspection.repairs import Broken
from service.storage.tables.atlases import AtlasRow
from service.storage.tables.jobs import JobRow
from service.storage.tables.operations import ApiKeyRow
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow
from service.storage.tables.sweeps import SweepChunkRow, SweepRow


def invariants_of_keys() -> Iterator[Invariant]:
    """Yield the invariants of keys."""
    yield Invariant(
        "stored_bytes",
        "a key is charged for the arrays of its results, and for its atlases, that are stored",
        select(ApiKeyRow.id).where(ApiKeyRow.stored_bytes != _stored()),
        Remedy("the bytes are counted again", _recharge),
    )


def _recharge(database: Database, broken: Broken) -> int:
    with database.read() as session:
        found = session.scalars(broken).all()
    for key_id in found:
        with database.write() as session:
            # Lock the key first: a transaction that stores for it charges the key last, so it waits here
            # or was committed before the count.
            session.scalar(select(ApiKeyRow.id).where(ApiKeyRow.id == key_id).with_for_update())
            statement = update(ApiKeyRow).where(ApiKeyRow.id == key_id).values(stored_bytes=_stored())
            session.execute(statement.execution_options(synchronize_session=False))
    return len(found)


def _stored() -> ColumnElement[int]:
    """Return the number of bytes that are stored for a key."""
    total: ColumnElement[int] = _of_chunks() + _of_atlases()
    for table in (DenseOutputRow, SamplesRow):
        total = total + _of_solutions(table)
    return total


def _of_solutions(table: type[DenseOutputRow] | type[SamplesRow]) -> ColumnElement[int]:
    return (
        select(func.coalesce(func.sum(func.length(table.data)), 0))
        .join(SolutionRow, SolutionRow.id == table.solution_id)
        .join(JobRow, JobRow.id == SolutionRow.job_id)
        .where(JobRow.key_id == ApiKeyRow.id)
        .correlate(ApiKeyRow)
        .scalar_subquery()
    )


def _of_atlases() -> ColumnElement[int]:
    return (
        select(func.coalesce(func.sum(func.length(AtlasRow.data)), 0))
        .join(JobRow, JobRow.id == AtlasRow.job_id)
        .where(JobRow.key_id == ApiKeyRow.id)
        .correlate(ApiKeyRow)
        .scalar_subquery()
    )


def _of_chunks() -> ColumnElement[int]:
    return (
        select(func.coalesce(func.sum(func.length(SweepChunkRow.data)), 0))
        .join(SweepRow, SweepRow.id == SweepChunkRow.sweep_id)
        .where(SweepRow.key_id == ApiKeyRow.id)
        .correlate(ApiKeyRow)
        .scalar_subquery()
    )
