"""Reads stored solutions with their arrays, for comparisons."""

from collections.abc import Sequence

from sqlalchemy import Connection, bindparam, select

from service.jobs.records import StoredSolution
from service.storage.tables.base import table_of
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow

_SOLUTIONS, _DENSE, _SAMPLES = table_of(SolutionRow), table_of(DenseOutputRow), table_of(SamplesRow)
_STORED = (
    select(_SOLUTIONS.c.id, _SOLUTIONS.c.problem, _SOLUTIONS.c.summary, _DENSE.c.data, _SAMPLES.c.data)
    .outerjoin(_DENSE, _DENSE.c.solution_id == _SOLUTIONS.c.id)
    .outerjoin(_SAMPLES, _SAMPLES.c.solution_id == _SOLUTIONS.c.id)
    .where(_SOLUTIONS.c.id.in_(bindparam("ids", expanding=True)))
)


def stored_solutions(connection: Connection, solution_ids: Sequence[str]) -> dict[str, StoredSolution]:
    """Return those of the solutions that there are, by their ids."""
    rows = connection.execute(_STORED, {"ids": solution_ids})
    return {
        str(solution_id): StoredSolution(problem, summary, dense or b"", samples)
        for solution_id, problem, summary, dense, samples in rows
    }
