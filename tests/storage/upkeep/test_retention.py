"""Old samples go, whatever can be asked of a solution stays."""

from concurrent.futures import ThreadPoolExecutor

from sqlalchemy import delete, func, insert, select, text, update

from service.app import create_app
from service.jobs.keys import Role
from service.settings import Settings
from service.storage.database.rows import first_id, new_id
from service.storage.inspection.inspect import inspect
from service.storage.keys import KeyLimits, KeyStore
from service.storage.tables.jobs import JobRow
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow
from service.storage.upkeep.retention import BATCH, Pruned, prune_samples
from tests.support.api import TestClient
from tests.support.databases import PROBLEM, SUMMARY
from tests.support.finishing import finish_success
from tests.support.waiting import wait_until

DAY = 86400.0


def prune(database, days=30.0, **options):
    return prune_samples(database, older_than_seconds=days * DAY, pause=lambda _: None, **options)


def solve(jobs, *, samples=b"samples", **summary):
    job = jobs.submit(PROBLEM, new_id())
    claim = jobs.claim("worker", lease_seconds=60.0)
    found = {**SUMMARY, "tier": "standard", **summary}
    assert finish_success(jobs, claim, found, dense=b"dense", samples=samples)
    return jobs.get(job.id).solution_id


def age(database, solution_id, days):
    """Make a solution that much older, and return its new id: ids grow out of the time as well."""
    with database.write() as session:
        row = session.get(SolutionRow, solution_id)
        copied = {column.name: getattr(row, column.name) for column in SolutionRow.__table__.columns}
        created_at = row.created_at - days * DAY
        older = first_id(created_at)[:18] + solution_id[18:]
        # No two solutions are of one job, not even for a moment.
        session.execute(update(SolutionRow).where(SolutionRow.id == solution_id).values(job_id=new_id()))
        session.execute(insert(SolutionRow).values({**copied, "id": older, "created_at": created_at}))
        for table in (DenseOutputRow, SamplesRow, JobRow):
            session.execute(update(table).where(table.solution_id == solution_id).values(solution_id=older))
        session.execute(delete(SolutionRow).where(SolutionRow.id == solution_id))
    return older


def kept(database):
    with database.read() as session:
        return set(session.scalars(select(SamplesRow.solution_id)))


def test_old_samples_are_deleted_and_young_ones_are_not(jobs, solutions, database):
    old, young = age(database, solve(jobs, samples=b"x" * 70), 31), solve(jobs)
    assert prune(database) == Pruned(1, 70)
    assert kept(database) == {young}
    assert solutions.dense(old) == b"dense"
    assert solutions.get(old).summary["tier"] == "standard"
    assert prune(database) == Pruned()


def test_enclosures_are_kept_for_ever(jobs, database):
    certified = age(database, solve(jobs, tier="certified"), 1000)
    assert prune(database) == Pruned()
    assert kept(database) == {certified}


def test_samples_better_than_their_function_of_time_are_kept_for_ever(jobs, database):
    proven = age(database, solve(jobs, evidence={"proven_samples": "elliptic", "nodes": 3}), 1000)
    age(database, solve(jobs, evidence={"nodes": 3}), 1000)
    assert prune(database).solutions == 1
    assert kept(database) == {proven}


def test_a_dry_run_only_counts(jobs, database):
    olds = {age(database, solve(jobs), 40) for _ in range(3)}
    assert prune(database, dry_run=True) == Pruned(3, 3 * len(b"samples"))
    assert kept(database) == olds


def many(jobs, database, count):
    with database.write() as session:
        for _ in range(count):
            solution_id = first_id(1e9)[:18] + new_id()[18:]
            job_id = new_id()
            session.execute(
                SolutionRow.__table__.insert().values(
                    id=solution_id, job_id=job_id, digest="d", problem={}, summary={}, created_at=1e9
                )
            )
            session.add(SamplesRow(solution_id=solution_id, data=b"12345"))


def test_many_are_deleted_in_small_transactions_with_pauses_between(jobs, database):
    many(jobs, database, 2 * BATCH + 7)
    pauses = []
    total = prune_samples(database, older_than_seconds=DAY, pause=pauses.append)
    assert total == Pruned(2 * BATCH + 7, 5 * (2 * BATCH + 7))
    assert len(pauses) == 3
    assert kept(database) == set()


def test_what_several_delete_at_once_is_counted_once(jobs, database):
    many(jobs, database, 4 * BATCH)
    with ThreadPoolExecutor(3) as pool:
        totals = list(pool.map(lambda _: prune(database), range(3)))
    assert sum(total.solutions for total in totals) == 4 * BATCH
    assert kept(database) == set()


def test_keys_are_charged_for_what_is_left(jobs, database):
    keys = KeyStore(database)
    mine, _ = keys.create(Role.SUBMIT, name="", seconds=None, limits=KeyLimits())
    ids = []
    for size in (100, 1000):
        job = jobs.submit(PROBLEM, new_id(), key_id=mine.id)
        claim = jobs.claim("worker", lease_seconds=60.0)
        assert finish_success(jobs, claim, SUMMARY, dense=b"d" * 10, samples=b"s" * size)
        ids.append(jobs.get(job.id).solution_id)
    age(database, ids[1], 31)
    prune(database)
    with database.read() as session:
        assert session.scalar(text("SELECT stored_bytes FROM api_keys")) == 120
    assert [finding.code for finding in inspect(database) if not finding.is_clean] == []


def test_a_service_prunes_by_itself_if_it_is_told_a_limit(jobs, database, url):
    old, young = age(database, solve(jobs), 2), solve(jobs)
    assert old != young
    with TestClient(create_app(Settings(database_url=url, samples_days=1.0))):
        wait_until(lambda: kept(database) == {young})


def test_ids_of_an_instant_come_after_all_earlier_ones():
    earlier = new_id()
    milliseconds = int(earlier.replace("-", "")[:12], 16)
    assert first_id((milliseconds + 1) / 1000) > earlier > first_id((milliseconds - 1) / 1000)


def test_solutions_without_samples_are_not_looked_at_again(jobs, database):
    age(database, solve(jobs), 31)
    prune(database)
    with database.read() as session:
        assert session.scalar(select(func.count()).select_from(SamplesRow)) == 0
        assert session.scalar(select(func.count()).select_from(SolutionRow)) == 1
