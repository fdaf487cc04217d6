"""Places of heavy reads: few, fair, bounded, and free again whatever becomes of their clients."""

import asyncio
import re
import threading

import pytest
from anyio import CapacityLimiter
from sqlalchemy import text
from sqlalchemy.exc import DBAPIError

from service.api.dependencies import SharedAnswer
from service.api.heavy_reads import WAITING, HeavyReads, Reader
from service.api.keys.access import ACCESS
from service.api.replies import ApiError
from service.dashboard.routes import PAGES
from service.settings import Settings
from service.storage.database.database import Database, NobodyWaitsError
from service.storage.database.rows import new_id
from tests.support.api import NEEDED_QUERY, STATE, solve_job
from tests.support.sweeps import SWEEP

MB = 10**6
ANN, BOB = Reader("ann"), Reader("bob")


def reads_of(**settings):
    make_room = settings.pop("make_room", lambda: False)
    return HeavyReads(Settings(**{"reading_places": 1, **settings}), make_room=make_room)


class Blocked:
    """A read that goes on when it is told, and notes that it was made."""

    def __init__(self, log=None, name=None):
        self.begun, self.goes_on = threading.Event(), threading.Event()
        self._log, self._name = log, name

    def __call__(self):
        self.begun.set()
        assert self.goes_on.wait(60)
        if self._log is not None:
            self._log.append(self._name)
        return self._name


async def begun(blocked):
    await asyncio.to_thread(blocked.begun.wait, 60)


async def settle():
    """Let every task come as far as it can."""
    for _ in range(5):
        await asyncio.sleep(0)


def running(test):
    reads = []

    async def run():
        try:
            await test(lambda **settings: reads.append(reads_of(**settings)) or reads[-1])
        finally:
            for each in reads:
                await asyncio.to_thread(each.close)

    asyncio.run(run())


def test_keys_take_turns_whoever_asks_most():
    async def test(make):
        reads, log, first = make(), [], Blocked()
        holding = asyncio.create_task(reads.begin(ANN, first))
        await begun(first)
        asked = [(ANN, "a1"), (ANN, "a2"), (ANN, "a3"), (BOB, "b1"), (BOB, "b2")]
        tasks = []
        for reader, name in asked:
            tasks.append(asyncio.create_task(reads.begin(reader, lambda name=name: log.append(name))))
            await settle()
        assert reads.waiting == len(asked)
        first.goes_on.set()
        await asyncio.gather(holding, *tasks)
        assert log == ["a1", "b1", "a2", "b2", "a3"]

    running(test)


def test_a_part_of_an_answer_waits_for_its_turn_too_and_is_never_refused():
    async def test(make):
        reads, log, first = make(), [], Blocked()
        holding = asyncio.create_task(reads.begin(ANN, first))
        await begun(first)
        parts = [asyncio.create_task(reads.go_on(ANN, lambda: log.append("a"))) for _ in range(WAITING + 1)]
        await settle()
        new = asyncio.create_task(reads.begin(BOB, lambda: log.append("b")))
        await settle()
        assert reads.waiting == 1
        first.goes_on.set()
        await asyncio.gather(holding, new, *parts)
        assert log.index("b") <= 1
        assert log.count("a") == WAITING + 1

    running(test)


@pytest.mark.parametrize(("reader", "most"), [(ANN, WAITING // 2), (Reader(None, "a connection"), WAITING)])
def test_so_many_wait_and_no_more(reader, most):
    async def test(make):
        reads, first = make(), Blocked()
        holding = asyncio.create_task(reads.begin(BOB, first))
        await begun(first)
        tasks = [asyncio.create_task(reads.begin(reader, lambda: None)) for _ in range(most)]
        await settle()
        with pytest.raises(ApiError) as refusal:
            await reads.begin(reader, lambda: None)
        assert (refusal.value.status, refusal.value.code) == (503, "busy")
        assert int(refusal.value.headers["Retry-After"]) >= 1
        first.goes_on.set()
        await asyncio.gather(holding, *tasks)
        assert reads.waiting == 0

    running(test)


def test_a_turn_that_does_not_come_in_time_is_a_refusal(monkeypatch):
    monkeypatch.setattr("service.api.heavy_reads.WAIT_SECONDS", 0.01)

    async def test(make):
        reads, first = make(), Blocked()
        holding = asyncio.create_task(reads.begin(ANN, first))
        await begun(first)
        with pytest.raises(ApiError, match="no turn in time"):
            await reads.begin(BOB, lambda: None)
        first.goes_on.set()
        await holding
        assert await reads.begin(BOB, lambda: "made") == "made"

    running(test)


def test_whoever_leaves_the_line_takes_no_place_with_him():
    async def test(make):
        reads, first = make(), Blocked()
        holding = asyncio.create_task(reads.begin(ANN, first))
        await begun(first)
        waiting = [asyncio.create_task(reads.begin(BOB, lambda: None)) for _ in range(3)]
        await settle()
        waiting[0].cancel()
        first.goes_on.set()
        await holding
        waiting[1].cancel()  # perhaps in the moment in which it is given the place
        await asyncio.gather(*waiting, return_exceptions=True)
        assert await reads.begin(ANN, lambda: "made") == "made"
        assert reads.waiting == 0

    running(test)


def test_what_nobody_waits_for_reads_nothing_more_and_holds_its_place_until_then(database):
    async def test(make):
        reads, first, ends = make(), Blocked(), []

        def long():
            with database.read():
                first()
            try:
                with database.read():
                    ends.append("read")
            except NobodyWaitsError:
                ends.append("stopped")
                raise

        reading = asyncio.create_task(reads.begin(ANN, long))
        await begun(first)
        reading.cancel()
        await asyncio.gather(reading, return_exceptions=True)
        next_one = asyncio.create_task(reads.begin(BOB, lambda: ends.append("next")))
        await settle()
        assert ends == []
        first.goes_on.set()
        await next_one
        assert ends == ["stopped", "next"]

    running(test)


ENDLESS = {
    "sqlite": "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT max(i) FROM n",
    "postgresql": "SELECT pg_sleep(1e6)",
}


@pytest.mark.parametrize("opened", [Database.read, Database.read_rows])
def test_a_statement_that_nobody_waits_for_ends_in_its_midst(database, opened):
    async def test(make):
        reads, begins, ends = make(), threading.Event(), []

        def endless():
            with opened(database) as connection:
                connection.execute(text("SELECT 1"))
                begins.set()
                try:
                    connection.execute(text(ENDLESS[database.engine.dialect.name]))
                except DBAPIError as fault:
                    ends.append(fault)
                    raise

        reading = asyncio.create_task(reads.begin(ANN, endless))
        await asyncio.to_thread(begins.wait, 60)
        reading.cancel()
        await asyncio.gather(reading, return_exceptions=True)

        def count():
            with database.read() as session:
                return session.scalar(text("SELECT 2"))

        # The one place is free, and whoever gets the connection is not interrupted.
        assert await reads.begin(BOB, count) == 2
        assert len(ends) == 1

    running(test)


def test_what_waits_to_be_sent_has_a_budget_of_which_a_key_gets_half():
    async def test(make):
        reads = make(reading_mb=10)
        of_ann = await reads.hold(ANN, 4 * MB)
        with pytest.raises(ApiError, match="waits to be sent"):
            await reads.hold(ANN, 2 * MB)
        of_bob = await reads.hold(BOB, 5 * MB)
        with pytest.raises(ApiError):
            await reads.hold(Reader("carl"), 2 * MB)
        assert reads.held == 9 * MB
        of_bob()
        of_bob()  # once is enough
        assert reads.held == 4 * MB
        of_ann()
        # Whatever is large is accepted if nothing else waits.
        (await reads.hold(ANN, 1000 * MB))()
        assert reads.held == 0

    running(test)


def test_those_who_do_not_read_make_room_in_the_budget():
    async def test(make):
        held = []

        def close_one():
            if held:
                held.pop()()
                return True
            return False

        reads, one = make(reading_mb=10, make_room=close_one), Reader(None, "a connection")
        held += [await reads.hold(one, 5 * MB) for _ in range(2)]
        kept = await reads.hold(one, 6 * MB)
        assert (len(held), reads.held) == (0, 6 * MB)
        with pytest.raises(ApiError):
            await reads.hold(one, 6 * MB)
        kept()

    running(test)


def test_a_fault_of_a_read_is_that_of_its_request_and_frees_the_place():
    async def test(make):
        reads = make()

        def fail():
            raise ValueError("a fault of ours")

        with pytest.raises(ValueError, match="a fault of ours"):
            await reads.begin(ANN, fail)
        assert await reads.begin(ANN, lambda: "made") == "made"

    running(test)


def test_what_monitors_ask_for_is_made_once_for_all_who_ask_together():
    made, first = [], Blocked()

    def make():
        first()
        made.append(len(made))
        if len(made) == 2:
            raise ValueError("a fault of ours")
        return made[-1]

    async def test(_):
        shared = SharedAnswer(make, CapacityLimiter(2))
        asking = [asyncio.create_task(shared.get()) for _ in range(10)]
        await begun(first)
        asking[0].cancel()  # the others still wait for it
        first.goes_on.set()
        assert await asyncio.gather(*asking[1:]) == [0] * 9
        with pytest.raises(ValueError, match="a fault of ours"):
            await shared.get()
        assert await shared.get() == 2

    running(test)


LIGHT = {
    **dict.fromkeys(PAGES, "a page: a file that is kept in memory"),
    **dict.fromkeys((path for path in ACCESS if path.startswith(("/docs", "/static/"))), "a file"),
    "/openapi.json": "written once",
    "/livez": "never busy",
    "/readyz": "never busy, made once for all that ask",
    "/metrics": "never busy, made once for all that ask",
    "/v1/accuracy": "one row",
    "/v1/families": "made once",
    "/v1/status": "numbers that statements tell by their indexes",
    "/v1/events": "no thread: one looks for all",
    "/v1/jobs/{job_id}/events": "no thread: one looks for all",
    "/v1/sweeps/{sweep_id}/events": "no thread: one looks for all",
    "/v1/jobs": "a page, if it is by age: see below",
    "/v1/atlases": "a page, if it is by age: see below",
    "/v1/solutions": "a page, if it is by age: see below",
    "/v1/sweeps": "a page, if it is by age: see below",
    "/v1/sweeps/{sweep_id}/jobs": "a page, if it is by age: see below",
    "/v1/problems/{digest}/solutions": "a page of the few of one problem",
    "/v1/jobs/{job_id}": "one row",
    "/v1/jobs/{job_id}/attempts": "few rows",
    "/v1/solutions/{solution_id}": "one row",
    "/v1/solutions/{solution_id}/audits": "a page, if it is by age: see below",
    "/v1/solutions/{solution_id}/audits/{audit_id}": "one row",
    "/v1/solutions/{solution_id}/citation": "text of one row",
    "/v1/solutions/{solution_id}/provenance": "text of one row and its attempts",
    "/v1/sweeps/{sweep_id}": "one row",
    "/v1/sweeps/{sweep_id}/provenance": "text of one row",
}
"""What computes and builds nothing to speak of, and why. Whatever else there is is made in a place."""
ASKED = [path for path, roles in ACCESS.items() if "GET" in roles]


@pytest.fixture
def reads_begun(monkeypatch):
    """The reads that were made in a place."""
    found, begin = [], HeavyReads.begin

    async def noted(reads, reader, work):
        found.append(reader)
        return await begin(reads, reader, work)

    monkeypatch.setattr(HeavyReads, "begin", noted)
    return found


def test_there_are_routes_of_both_kinds_and_none_is_listed_in_vain():
    assert set(LIGHT) < set(ASKED)
    assert len(ASKED) - len(LIGHT) >= 13


@pytest.mark.any_database
def test_every_route_that_computes_or_builds_is_made_in_a_place(client, reads_begun):
    for path in ASKED:
        place = re.sub("{.*?}", new_id(), path) + NEEDED_QUERY.get(path, "")
        # A stream has no end.
        response = client.head(place) if path.endswith("/events") else client.get(place)
        assert response.status_code < 500, path
        assert bool(reads_begun) is (path not in LIGHT), path
        del reads_begun[:]


@pytest.mark.any_database
@pytest.mark.parametrize(
    ("path", "is_heavy"),
    [
        ("/v1/solutions?where=period<5", True),
        ("/v1/solutions?sort=period", True),
        ("/v1/jobs?where=/body/A>1", True),
        ("/v1/jobs?offset=1000000", True),
        ("/v1/sweeps?order=points", True),
        ("/v1/atlases?where=/body/A>1", True),
        ("/v1/jobs?count=exact", True),
        ("/v1/jobs", False),
        ("/v1/jobs?state=queued&limit=200", False),
        ("/v1/sweeps?state=running", False),
    ],
)
def test_a_page_that_may_take_long_is_made_in_a_place(client, reads_begun, path, is_heavy):
    assert client.get(path).status_code < 500
    assert len(reads_begun) == is_heavy


@pytest.mark.any_database
@pytest.mark.parametrize(
    ("query", "is_heavy"), [("", False), ("?where=attempt>1", True), ("?order=state", True)]
)
def test_lists_of_audits_and_of_chunks_are_made_in_a_place_as_all_lists(
    client, jobs, reads_begun, query, is_heavy
):
    sweep_id = client.post("/v1/sweeps", json=SWEEP).json()["id"]
    assert client.get(f"/v1/sweeps/{sweep_id}/jobs{query}").status_code == 200
    assert len(reads_begun) == is_heavy
    client.post(f"/v1/sweeps/{sweep_id}/cancel")
    solution = solve_job(client, jobs, STATE)
    del reads_begun[:]
    assert client.get(f"/v1/solutions/{solution['id']}/audits{query}").status_code == 200
    assert len(reads_begun) == is_heavy
