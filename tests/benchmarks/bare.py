"""Writes what jobs leave in our tables and nothing else: ``python -m tests.benchmarks.bare URL NUMBER``.

It prints the seconds that so many empty jobs took.
"""

import sys
import time

from sqlalchemy import text

from service.storage.database.database import Database
from service.storage.database.rows import new_id


def analyze(database: Database) -> None:
    """Bring the statistics of Postgres up to date, as it does by itself once a minute."""
    if database.engine.dialect.name == "postgresql":
        with database.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            connection.execute(text("ANALYZE"))


def _tables(url: str, number: int) -> float:
    """Return how long it takes to take so many rows of a queue and to finish them, by plain statements."""
    database = Database(url)
    with database.write() as session:
        ids = [new_id().replace("-", "") for _ in range(number)]
        rows = [{"id": job_id} for job_id in ids]
        session.execute(
            text(
                "INSERT INTO jobs "
                "(id, state, priority, ready_at, attempt, progress, reused, problem, digest, created_at) "
                "VALUES (:id, 'queued', 0, 0, 0, 0, false, '{}', :id, 0)"
            ),
            rows,
        )
    began = time.perf_counter()
    for _ in range(number):
        with database.write() as session:
            job_id = session.scalar(
                text(
                    "UPDATE jobs SET state = 'running', owner = 'bare', lease_until = 0, attempt = 1 "
                    "WHERE id = (SELECT id FROM jobs WHERE state = 'queued' "
                    "ORDER BY priority DESC, id LIMIT 1) RETURNING id"
                )
            )
        with database.write() as session:
            session.execute(
                text(
                    "UPDATE jobs SET state = 'failed', owner = NULL, lease_until = NULL WHERE id = :id "
                    "AND state = 'running' AND owner = 'bare'"
                ),
                {"id": job_id},
            )
    seconds = time.perf_counter() - began
    database.close()
    return seconds


def main() -> None:
    """Measure it."""
    url, number = sys.argv[1:]
    sys.stdout.write(f"{_tables(url, int(number))}\n")


if __name__ == "__main__":
    main()
