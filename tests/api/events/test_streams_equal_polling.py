"""What a stream tells equals what polling tells, through random lives of jobs, on both databases."""

import asyncio
from collections.abc import Sequence

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from service.api.events import watcher
from service.jobs.records import Refused, Solved
from tests.support.api import STATE
from tests.support.effort import examples
from tests.support.streams import Event, Stream, get, started
from tests.support.sweeps import SWEEP, finish_sweep

SUCCESS = Solved({"method": "quadrature"}, b"dense", b"samples")
FAILURE = Refused({"code": "no_motion", "detail": "there is none"})
STEPS = ("submit", "claim", "beat", "lose", "return", "succeed", "fail", "cancel", "wait", "reconnect")


@pytest.fixture(autouse=True)
def _often(monkeypatch):
    """Poll so often that a poll falls between most steps."""
    monkeypatch.setattr(watcher, "POLL_SECONDS", 0.01)
    monkeypatch.setattr(watcher, "GAP_SECONDS", 0.001)
    monkeypatch.setattr(watcher, "POLL_SHARE", 0.0)


class Lives:
    """Some jobs, what polling got of each after each step, and the claims that hold."""

    def __init__(self, app, jobs):
        self._app, self._jobs = app, jobs
        self.polled: dict[str, list[bytes]] = {}
        self._claims = []
        self.sweep_id = None

    async def step(self, name: str, place: int, number: int) -> None:
        await asyncio.to_thread(getattr(self, f"_{name}"), place, number)
        for job_id, states in self.polled.items():
            document = await get(self._app, f"/v1/jobs/{job_id}")
            if not states or states[-1] != document:
                states.append(document)

    def is_final(self, job_id: str) -> bool:
        return b'"finished_at": null' not in self.polled[job_id][-1]

    def _submit(self, place, number):
        # Some are equal, so that some are reused.
        job = self._jobs.submit(STATE, f"digest {number % 3}")
        self.polled[job.id] = []

    def _claim(self, place, number):
        claim = self._jobs.claim("worker", lease_seconds=60.0)
        if claim is not None:
            self._claims.append(claim)

    def _with_claim(self, place, use):
        if self._claims:
            use(self._claims.pop(place % len(self._claims)))

    def _beat(self, place, number):
        for claim in self._claims:
            self._jobs.heartbeat([claim], lease_seconds=60.0)

    def _lose(self, place, number):
        self._with_claim(place, lambda claim: self._jobs.lose(claim, "it died", max_attempts=3))

    def _return(self, place, number):
        self._with_claim(place, self._jobs.give_back)

    def _succeed(self, place, number):
        self._with_claim(place, lambda claim: self._jobs.finish(claim, SUCCESS))

    def _fail(self, place, number):
        self._with_claim(place, lambda claim: self._jobs.finish(claim, FAILURE))

    def _cancel(self, place, number):
        live = [each for each in self.polled if not self.is_final(each)]
        if live:
            self._jobs.cancel(live[place % len(live)])

    def _wait(self, place, number):
        pass


async def told_about(app, job_id: str, breaks: asyncio.Semaphore) -> list[Event]:
    """Follow a job to its end; disconnect whenever that is asked for, and come back with the last id."""
    events: list[Event] = []
    while True:
        last_id = events[-1].id if events else None
        async with Stream(app, f"/v1/jobs/{job_id}/events", last_id=last_id) as stream:
            while (event := await stream.next()) is not None:
                if event.name == "end":
                    assert event.document == {"reason": "finished"}
                    assert await stream.next() is None
                    return events
                assert event.name == "job"
                events.append(event)
                if not breaks.locked():
                    await breaks.acquire()
                    break


def places_in(sent: Sequence[bytes], life: Sequence[bytes]) -> list[int]:
    """Return where in a life each of these states is; each must be in it."""
    return [life.index(each) for each in sent]


@settings(max_examples=examples(6, 100), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    steps=st.lists(
        st.tuples(st.sampled_from(STEPS), st.integers(0, 9), st.sampled_from((0, 0, 0.005, 0.03))),
        min_size=4,
        max_size=25,
    )
)
def test_streams_of_jobs_tell_what_polling_tells(app, jobs, steps):
    async def live() -> None:
        async with started(app):
            lives, breaks = Lives(app, jobs), asyncio.Semaphore(0)
            following: dict[str, asyncio.Task[list[Event]]] = {}
            all_told: list[Event] = []
            watching = asyncio.create_task(watch(app, all_told, breaks))
            submit = ("submit", 0, 0.0)
            cancel = ("cancel", 0, 0.0)
            for number, (name, place, pause) in enumerate([submit, *steps, *[cancel] * (len(steps) + 1)]):
                if name == "reconnect":
                    breaks.release()
                    name = "wait"
                await lives.step(name, place, number)
                for job_id in lives.polled:
                    if job_id not in following:
                        following[job_id] = asyncio.create_task(told_about(app, job_id, breaks))
                await asyncio.sleep(pause)
            for job_id, task in following.items():
                life = lives.polled[job_id]
                assert lives.is_final(job_id)
                sent = [event.data for event in await task]
                places = places_in(sent, life)
                assert places == sorted(set(places)), "in the order of its life, none of them twice"
                assert sent[-1] == life[-1]
            finals = {job_id: life[-1] for job_id, life in lives.polled.items()}
            while not finals.items() <= latest(all_told).items():
                await asyncio.sleep(0.01)
            watching.cancel()
            await asyncio.gather(watching, return_exceptions=True)
            for job_id, life in lives.polled.items():
                sent = [
                    each.data for each in all_told if each.name == "job" and each.document["id"] == job_id
                ]
                places = places_in(sent, life)
                assert places == sorted(places)

    asyncio.run(asyncio.wait_for(live(), 120.0))


async def watch(app, events: list[Event], breaks: asyncio.Semaphore) -> None:
    """Follow the installation, as :func:`told_about` follows a job."""
    while True:
        last_id = events[-1].id if events else None
        async with Stream(app, "/v1/events", last_id=last_id) as stream:
            while (event := await stream.next()) is not None:
                events.append(event)
                if not breaks.locked():
                    await breaks.acquire()
                    break


def latest(events: Sequence[Event]) -> dict[str, bytes]:
    return {event.document["id"]: event.data for event in events if event.name == "job"}


def test_a_stream_of_a_sweep_tells_its_progress_and_its_end(app, jobs):
    async def live() -> None:
        async with started(app):
            inside = app.state.resources
            sweep = await asyncio.to_thread(inside.sweeps.submit, SWEEP, points=6, most=2)
            path = f"/v1/sweeps/{sweep.id}"
            async with Stream(app, f"{path}/events") as stream:
                first = await stream.next()
                assert first.data == await get(app, path)
                sent = [first.document["done"]]
                while (await stream_progress(app, jobs, path))["state"] != "succeeded":
                    event = await stream.next()
                    assert event.name == "sweep"
                    sent.append(event.document["done"])
                *states, end = await stream.rest()
                sent += [event.document["done"] for event in states]
                last = states[-1] if states else event
                assert last.data == await get(app, path)
                assert (end.name, end.document) == ("end", {"reason": "finished"})
                assert sent == sorted(sent)
                assert (sent[0], sent[-1]) == (0, 6)
            async with Stream(app, f"{path}/events", last_id=last.id) as again:
                assert [event.name for event in await again.rest()] == ["end"]

    asyncio.run(asyncio.wait_for(live(), 120.0))


async def stream_progress(app, jobs, path: str) -> dict:
    """Do the work of one chunk, and poll."""
    await asyncio.to_thread(finish_sweep, jobs, 1)
    return Event("", "", await get(app, path)).document
