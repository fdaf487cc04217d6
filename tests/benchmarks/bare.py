"""Bare engines with an empty job, each in a process of its own: ``python -m tests.benchmarks.bare``.

``procrastinate URL NUMBER PLACES`` runs Procrastinate's own worker; ``tables URL NUMBER`` writes what a
job leaves in our tables and nothing else. Both print the seconds it took.
"""

import asyncio
import sys
import time

from procrastinate import App, PsycopgConnector
from sqlalchemy import make_url, text

from service.storage.database.database import Database
from service.storage.database.rows import new_id


def analyze(database: Database) -> None:
    """Bring the statistics of Postgres up to date, as it does by itself once a minute."""
    if database.engine.dialect.name == "postgresql":
        with database.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            connection.execute(text("ANALYZE"))


async def _procrastinate(url: str, number: int, places: int) -> float:
    """Return how long Procrastinate's worker takes for so many empty jobs that wait already."""
    address = make_url(url)
    connector = PsycopgConnector(
        kwargs={"host": address.query["host"], "user": address.username, "dbname": address.database}
    )
    app = App(connector=connector)

    @app.task(name="nothing", queue="bare")
    async def nothing(number: int) -> None:
        """Compute nothing."""

    async with app.open_async():
        await nothing.batch_defer_async(*({"number": k} for k in range(number)))
        database = Database(url)
        analyze(database)
        database.close()
        began = time.perf_counter()
        await app.run_worker_async(
            queues=["bare"],
            wait=False,
            concurrency=places,
            delete_jobs="always",
            install_signal_handlers=False,
        )
        return time.perf_counter() - began


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
                "VALUES (:id, 'queued', 0, 0, 0, 0, 0, '{}', :id, 0)"
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
    """Run one of them."""
    engine, url, number, *places = sys.argv[1:]
    if engine == "procrastinate":
        seconds = asyncio.run(_procrastinate(url, int(number), int(places[0])))
    else:
        seconds = _tables(url, int(number))
    sys.stdout.write(f"{seconds}\n")


if __name__ == "__main__":
    main()
