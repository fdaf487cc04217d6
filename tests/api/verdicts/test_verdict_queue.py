"""However many ask for verdicts, everybody is answered in time, and nobody else notices."""

import asyncio
import threading
from collections import Counter
from concurrent.futures import Future

import anyio
import pytest
from httpx import ASGITransport, AsyncClient
from starlette.requests import ClientDisconnect, Request

from service.api.middleware.heavy_answers import while_connected
from service.api.replies import ApiError
from service.api.verdicts.verdict_queue import Claimant, VerdictQueue
from service.app import create_app
from service.jobs.keys import Role
from service.sandbox import SandboxTimeoutError
from service.settings import Settings
from service.verdicts.examination import answer_ping, examine_question
from tests.support.api import PLANAR, STATE
from tests.support.keys import make

QUESTION = {name: PLANAR[name] for name in ("body", "potential")}
VERDICT = '{"verdict": {"verdict": "admissible"}}'
A, B = Claimant("a"), Claimant("b")


class Blocked:
    """Stands for the children: a call is at work until it is released, and says its text."""

    def __init__(self, limit=False):
        self.free, self.running, self.order = threading.Event(), [], []
        self.limit = limit
        self._lock = threading.Lock()
        self.is_idle = True

    def run(self, examination, text="ping", *, seconds, crashes=1, submitted=None):
        if text == "ping":
            return "alive"
        attempt = Future()
        attempt.set_running_or_notify_cancel()
        cancelled = threading.Event()
        attempt.cancel = cancelled.set
        submitted(attempt)
        with self._lock:
            self.running.append(text)
            self.order.append(text)
        while not self.free.wait(0.005):
            if cancelled.is_set():
                with self._lock:
                    self.running.remove(text)
                raise RuntimeError("the child was killed")
            if self.limit:
                with self._lock:
                    self.running.remove(text)
                raise SandboxTimeoutError
        with self._lock:
            self.running.remove(text)
        return text


@pytest.fixture
def children():
    return Blocked()


def run(act):
    asyncio.run(act())


async def until(condition):
    with anyio.fail_after(20):
        while not condition():
            await asyncio.sleep(0.002)


def make_queue(children, *, places=8, seconds=60.0, seats=3):
    settings = Settings(verdict_places=places, verdict_seconds=seconds)
    return VerdictQueue(children, settings, children=seats)


def ask(queue, text, claimant):
    return asyncio.create_task(queue.ask(answer_ping, text, claimant))


def test_beyond_its_places_a_call_is_refused_at_once(children):
    async def act():
        queue = make_queue(children, places=2)
        asked = [ask(queue, str(n), Claimant(None)) for n in range(5)]
        await until(lambda: len(children.running) == 3 and queue.waiting == 2)
        with pytest.raises(ApiError) as refused:
            await queue.ask(answer_ping, "one more", Claimant(None))
        assert (refused.value.status, refused.value.code) == (503, "verdicts_busy")
        assert int(refused.value.headers["Retry-After"]) > 0
        children.free.set()
        assert await asyncio.gather(*asked) == [str(n) for n in range(5)]
        queue.close()

    run(act)


def test_a_key_has_neither_all_places_nor_all_children(children):
    async def act():
        queue = make_queue(children, places=4)
        greedy = [ask(queue, f"a{n}", A) for n in range(4)]
        await until(lambda: len(children.running) == 2 and queue.waiting == 2)
        with pytest.raises(ApiError, match="requests of this key wait"):
            await queue.ask(answer_ping, "a4", A)
        modest = ask(queue, "b", B)
        await until(lambda: "b" in children.running)
        children.free.set()
        await asyncio.gather(*greedy, modest)
        queue.close()

    run(act)


def test_keys_take_turns(children):
    async def act():
        queue = make_queue(children, places=50, seats=1)
        first = ask(queue, "first", Claimant("c"))
        await until(lambda: children.running == ["first"])
        asked = [ask(queue, f"a{n}", A) for n in range(3)] + [ask(queue, f"b{n}", B) for n in range(3)]
        await until(lambda: queue.waiting == 6)
        children.free.set()
        await asyncio.gather(first, *asked)
        assert children.order == ["first", "a0", "b0", "a1", "b1", "a2", "b2"]
        queue.close()

    run(act)


def test_lists_leave_a_child_to_single_problems(children):
    async def act():
        queue = make_queue(children)
        lists = [ask(queue, f"list {n}", Claimant(None, is_list=True)) for n in range(5)]
        await until(lambda: len(children.running) == 2 and queue.waiting == 3)
        single = ask(queue, "single", Claimant(None))
        await until(lambda: "single" in children.running)
        children.free.set()
        await asyncio.gather(*lists, single)
        queue.close()

    run(act)


def test_the_time_limit_includes_the_waiting(children):
    async def act():
        queue = make_queue(children, seconds=0.05, seats=1)
        first = ask(queue, "first", Claimant(None))
        await until(lambda: children.running == ["first"])
        second = ask(queue, "second", Claimant(None))
        with pytest.raises(ApiError, match="no child process for verdicts became free"):
            await second
        # Who had a child at once is told that the formula is at fault.
        with pytest.raises(SandboxTimeoutError):
            await first
        assert "second" not in children.order
        children.free.set()
        queue.close()

    run(act)


def test_a_call_that_nobody_waits_for_leaves_the_queue_and_its_child(children):
    async def act():
        queue = make_queue(children, seats=1)
        first, second, third = (ask(queue, str(n), Claimant(None)) for n in range(3))
        await until(lambda: children.running == ["0"] and queue.waiting == 2)
        second.cancel()
        await until(lambda: queue.waiting == 1)
        first.cancel()
        await until(lambda: children.running == ["2"])
        children.free.set()
        assert await third == "2"
        assert children.order == ["0", "2"]
        queue.close()

    run(act)


def test_a_queue_that_is_closed_answers_those_who_wait(children):
    async def act():
        queue = make_queue(children, seats=1)
        asked = [ask(queue, str(n), Claimant(None)) for n in range(3)]
        await until(lambda: queue.waiting == 2)
        await asyncio.to_thread(queue.close)
        assert [type(fault) for fault in await asyncio.gather(*asked, return_exceptions=True)] == [
            ApiError
        ] * 3
        with pytest.raises(ApiError):
            await queue.ask(answer_ping, "late", Claimant(None))

    run(act)


def test_work_is_given_up_when_the_client_hangs_up():
    async def act():
        gone, cancelled = asyncio.Event(), asyncio.Event()

        async def receive():
            await gone.wait()
            return {"type": "http.disconnect"}

        async def work():
            try:
                await asyncio.Event().wait()
            finally:
                cancelled.set()

        task = asyncio.create_task(while_connected(Request({"type": "http"}, receive), work()))
        await asyncio.sleep(0)
        gone.set()
        with pytest.raises(ClientDisconnect):
            await task
        assert cancelled.is_set()

    run(act)


@pytest.fixture
def blocked_app(sqlite_url, children):
    """An application whose children never answer until they are released."""
    return create_app(
        Settings(database_url=sqlite_url, verdict_places=4, verdict_seconds=60.0), sandbox=children
    )


def browse(app, act):
    async def browsing():
        async with app.router.lifespan_context(app):
            transport = ASGITransport(app, raise_app_exceptions=False)
            async with AsyncClient(transport=transport, base_url="http://127.0.0.1:8000") as client:
                await act(client, app.state.resources)

    asyncio.run(browsing())


def test_while_all_children_are_at_work_everything_else_is_answered(blocked_app, children):
    async def act(client, inside):
        children.is_idle = False
        asked = [asyncio.create_task(client.post("/v1/validations", json=QUESTION)) for _ in range(60)]
        await until(lambda: len(children.running) == 3 and inside.verdicts.waiting == 4)
        await until(lambda: sum(task.done() for task in asked) == 53)
        busy = [task.result() for task in asked if task.done()]
        assert {answer.json()["type"] for answer in busy} == {"urn:polhode:problem:verdicts_busy"}
        assert {answer.status_code for answer in busy} == {503}
        assert all(int(answer.headers["retry-after"]) > 0 for answer in busy)
        for path, status in (("/livez", 200), ("/readyz", 200), ("/v1/jobs", 200), ("/nowhere", 404)):
            assert (await client.get(path)).status_code == status
        assert (await client.post("/v1/jobs", json=STATE)).status_code == 202
        assert (await client.post("/v1/jobs", json=PLANAR)).status_code == 503
        listed = await client.post("/v1/jobs", json=[PLANAR, PLANAR])
        assert (listed.status_code, listed.headers["retry-after"]) == (503, "60")
        mixed = (await client.post("/v1/jobs", json=[PLANAR, STATE])).json()["items"]
        assert [item["status"] for item in mixed] == [503, 202]
        for task in asked:
            task.cancel()

    browse(blocked_app, act)


def test_without_a_free_thread_the_process_still_says_that_it_lives_and_what_is_wrong(blocked_app):
    """Every thread for the database is taken: as by 40 writers that wait for a lock."""

    async def act(client, inside):
        taken = anyio.to_thread.current_default_thread_limiter()
        for borrower in range(int(taken.total_tokens)):
            taken.acquire_on_behalf_of_nowait(borrower)
        waiting = asyncio.create_task(client.get("/v1/jobs"))
        expected = {
            ("GET", "/livez"): 200,
            ("GET", "/livez?a=1"): 422,
            ("GET", "/readyz"): 200,
            ("GET", "/nowhere"): 404,
            ("DELETE", "/v1/jobs"): 405,
            ("GET", "/v1/jobs?limit=x"): 422,
            ("POST", "/v1/jobs"): 415,
        }
        answers = {asked: (await client.request(*asked)).status_code for asked in expected}
        assert answers == expected
        assert (await client.post("/v1/validations", json={})).status_code == 422
        assert not waiting.done()
        for borrower in range(int(taken.total_tokens)):
            taken.release_on_behalf_of(borrower)
        assert (await waiting).status_code == 200

    browse(blocked_app, act)


def test_waiting_for_jobs_holds_no_thread(sqlite_url, children):
    settings = Settings(database_url=sqlite_url, waiting_places=100)

    async def act(client, inside):
        wait = {"Prefer": "wait=60"}
        asked = [asyncio.create_task(client.post("/v1/jobs", json=STATE, headers=wait)) for _ in range(60)]
        await until(lambda: len(inside.wake_up._waiting) == 60)
        # More than there are threads; and others are served.
        assert (await client.get("/v1/jobs")).json()["total"] == 60
        inside.wake_up.close()
        answers = await asyncio.gather(*asked)
        assert Counter(answer.status_code for answer in answers) == {202: 60}
        assert inside.waiting._value == 100

    browse(create_app(settings, sandbox=children), act)


def test_a_key_that_asks_for_too_much_is_refused_and_others_are_served(blocked_app, children, sqlite_url):
    async def act(client, inside):
        (_, greedy), (_, modest) = (make(inside.database, Role.SUBMIT) for _ in range(2))
        asked = [
            asyncio.create_task(client.post("/v1/validations", json=QUESTION, headers=greedy))
            for _ in range(5)
        ]
        await until(lambda: sum(task.done() for task in asked) == 1 and len(children.running) == 2)
        other = asyncio.create_task(client.post("/v1/validations", json=QUESTION, headers=modest))
        await until(lambda: len(children.running) == 3)
        for task in [*asked, other]:
            task.cancel()

    browse(blocked_app, act)


def test_a_verdict_comes_back(client):
    """Real children compute it."""
    answers = [client.post("/v1/validations", json=QUESTION) for _ in range(2)]
    assert [answer.json()["verdict"] for answer in answers] == ["admissible"] * 2
    assert examine_question.__module__ == "service.verdicts.examination"
