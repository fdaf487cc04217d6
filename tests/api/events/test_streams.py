"""What a stream of events begins with, keeps to, and how it ends."""

import asyncio
import threading

import pytest

from service.api.events import watcher
from service.api.events.poller import ChangePoller, Event, id_of_position, position_of_id
from service.api.events.watcher import RecentEvents
from service.api.routes import events as routes
from service.app import create_app
from service.jobs.keys import Role
from service.settings import Settings
from service.storage.jobs.rows import ChangeReader, Followable
from service.storage.keys import KeyStore
from tests.support.api import STATE
from tests.support.keys import make
from tests.support.streams import Stream, get, started

pytestmark = pytest.mark.any_database
PATHS = ("/v1/jobs/{}/events", "/v1/events")


def run(live) -> None:
    asyncio.run(asyncio.wait_for(live(), 120.0))


async def submit(jobs, digest="digest"):
    return await asyncio.to_thread(jobs.submit, STATE, digest)


def make_app(url, verdicts, **settings):
    return create_app(Settings(database_url=url, **settings), sandbox=verdicts)


@pytest.mark.parametrize("template", PATHS)
def test_a_stream_is_never_compressed_or_kept_and_tells_at_once_that_it_is_open(app, jobs, template):
    async def live():
        async with started(app):
            path = template.format((await submit(jobs)).id)
            async with Stream(app, path, **{"accept-encoding": "gzip, zstd"}) as stream:
                assert stream.status == 200
                assert stream.headers["content-type"] == "text/event-stream; charset=utf-8"
                assert stream.headers["cache-control"] == "no-store"
                assert stream.headers["x-accel-buffering"] == "no"
                assert {"etag", "content-encoding", "content-length"}.isdisjoint(stream.headers)
                # Before anything was read.
                assert stream._parts.get_nowait() == b": polhode\nretry: 2000\n\n"

    run(live)


def test_the_event_is_what_get_answers(app, jobs):
    async def live():
        async with started(app):
            job = await submit(jobs)
            async with Stream(app, f"/v1/jobs/{job.id}/events") as stream:
                event = await stream.next()
                assert (event.name, event.data) == ("job", await get(app, f"/v1/jobs/{job.id}"))
            async with Stream(app, "/v1/events") as stream:
                first = await stream.next()
                assert first.name == "status"
                assert first.document.keys() == {"at", "queue", "workers", "rates", "succeeded_by_minute"}
                event = await stream.next()
                assert (event.name, event.data) == ("job", await get(app, f"/v1/jobs/{job.id}"))
                await asyncio.to_thread(jobs.cancel, job.id)
                while (event := await stream.next()).name != "job":
                    pass
                assert event.data == await get(app, f"/v1/jobs/{job.id}")

    run(live)


@pytest.mark.parametrize("path", ["/v1/jobs/{}/events", "/v1/sweeps/{}/events"])
@pytest.mark.parametrize("unknown", ["none", "019f0000-0000-7000-8000-000000000000"])
def test_what_there_is_not_is_refused_before_the_stream_begins(client, path, unknown):
    for answer in (client.get(path.format(unknown)), client.get(path.format(unknown), params={"a": 1})):
        assert answer.headers["content-type"] == "application/problem+json"
        assert answer.status_code in (404, 422)
    assert client.head(path.format(unknown)).status_code == 404


def test_head_answers_and_ends(client, stored):
    for path in (f"/v1/jobs/{stored.job.id}/events", "/v1/events"):
        head = client.head(path)
        assert (head.status_code, head.content) == (200, b"")
        assert head.headers["content-type"].startswith("text/event-stream")


def test_a_finished_job_is_told_once_and_after_its_id_only_the_end(client, stored):
    path = f"/v1/jobs/{stored.job.id}/events"
    text = client.get(path).text
    assert text.count("event: job\n") == text.count("event: end\n") == 1
    (last_id,) = {line for line in text.splitlines() if line.startswith("id: ")}
    again = client.get(path, headers={"Last-Event-ID": last_id.removeprefix("id: ")}).text
    assert (again.count("event: job\n"), again.count("event: end\n")) == (0, 1)
    # An id that is none of ours is that of no event.
    assert client.get(path, headers={"Last-Event-ID": "nonsense"}).text == text


def test_a_deleted_job_ends_its_stream(app, jobs):
    async def live():
        async with started(app):
            job = await submit(jobs)
            async with Stream(app, f"/v1/jobs/{job.id}/events") as stream:
                assert (await stream.next()).name == "job"
                app.state.resources.events._poller._changes.of = lambda kind, ids: {}
                (end,) = await stream.rest()
                assert (end.name, end.document) == ("end", {"reason": "deleted"})

    run(live)


def test_ids_are_good_in_another_process_and_tell_only_what_is_new(app, jobs, verdicts, url, monkeypatch):
    async def live():
        async with started(app):
            old = await submit(jobs, "old")
            async with Stream(app, "/v1/events") as stream:
                while (event := await stream.next()).name != "job":
                    pass
        new = [await submit(jobs, f"new {k}") for k in range(5)]
        # All transactions have ended: what is older need not be sent again.
        monkeypatch.setattr(watcher, "SETTLED_SECONDS", 0.0)
        async with (
            started(make_app(url, verdicts)) as other,
            Stream(other, "/v1/events", last_id=event.id) as stream,
        ):
            assert (await stream.next()).name == "status"
            sent = [(await stream.next()).document["id"] for _ in new]
        assert old.id not in sent
        assert sent == [job.id for job in new]

    run(live)


def test_a_slow_reader_gets_the_latest_state_and_no_backlog(app, jobs, monkeypatch):
    monkeypatch.setattr(watcher, "POLL_SECONDS", 0.01)

    async def live():
        async with started(app):
            job = await submit(jobs)
            async with Stream(app, f"/v1/jobs/{job.id}/events", is_slow=True) as stream:
                assert (await stream.next()).document["attempt"] == 0
                for _ in range(5):
                    claim = await asyncio.to_thread(jobs.claim, "worker", lease_seconds=60.0)
                    await asyncio.sleep(0.1)
                    await asyncio.to_thread(jobs.give_back, claim)
                    await asyncio.sleep(0.1)
                await asyncio.to_thread(jobs.cancel, job.id)
                await asyncio.sleep(0.3)
                sent = await stream.rest()
            # One state may have been on its way when the client stopped to read.
            assert [event.name for event in sent][-2:] == ["job", "end"]
            assert len(sent) <= 3
            assert sent[-2].document["state"] == "cancelled"

    run(live)


def test_a_reader_of_the_installation_that_is_far_behind_misses_no_final_state(app, jobs, monkeypatch):
    """More changes than are kept: they are read from the database, in their present states."""
    monkeypatch.setattr(watcher, "POLL_SECONDS", 0.01)
    monkeypatch.setattr(watcher, "PAGE", 3)

    async def live():
        async with started(app):
            app.state.resources.events._recent = RecentEvents(most_events=2)
            async with Stream(app, "/v1/events", is_slow=True) as stream:
                assert (await stream.next()).name == "status"
                made = [await submit(jobs, f"digest {k}") for k in range(20)]
                for job in made:
                    await asyncio.to_thread(jobs.cancel, job.id)
                await asyncio.sleep(0.2)
                ended, count = set(), 0
                while ended != {job.id for job in made}:
                    event = await stream.next()
                    count += event.name == "job"
                    if event.name == "job" and event.document["state"] == "cancelled":
                        ended.add(event.document["id"])
            # Each a few times at most: what is not settled is read again, states of the past are not.
            assert count <= 3 * len(made)

    run(live)


def test_a_stream_does_not_go_back_to_a_state_that_a_look_had_read_before(app, jobs, monkeypatch):
    has_polled, has_read, may_pass = threading.Event(), threading.Event(), threading.Event()
    poll, page = ChangePoller.poll, ChangePoller.page
    late = []

    def slow_poll(poller):
        seen = poll(poller)
        if has_polled.is_set() and seen.events and not has_read.is_set():
            has_read.set()
            assert may_pass.wait(60.0)
        return seen

    def late_page(poller, after, limit):
        if not late:
            has_polled.set()
            late.append(jobs.submit(STATE, "digest of the late one").id)
            assert has_read.wait(60.0)
            jobs.cancel(late[0])
        try:
            return page(poller, after, limit)
        finally:
            may_pass.set()

    monkeypatch.setattr(watcher, "POLL_SECONDS", 0.01)
    monkeypatch.setattr(watcher, "GAP_SECONDS", 0.001)
    monkeypatch.setattr(ChangePoller, "poll", slow_poll)
    monkeypatch.setattr(ChangePoller, "page", late_page)

    async def live():
        async with started(app), Stream(app, "/v1/events") as stream:
            states = []
            while not states:
                if (event := await stream.next()).name == "job":
                    states.append(event.document["state"])
            last = await submit(jobs, "another digest")
            while (event := await stream.next()).name != "job" or event.document["id"] != last.id:
                if event.name == "job":
                    states.append(event.document["state"])
            assert set(states) == {"cancelled"}

    run(live)


def test_recent_events_are_bounded_in_number_and_in_bytes():
    recent = RecentEvents(most_events=3, most_bytes=100)
    for k in range(5):
        recent.add(Event("job", float(k), b"x" * 10))
    assert [recent.at(k) and recent.at(k).at for k in range(5)] == [None, None, 2.0, 3.0, 4.0]
    recent.add(Event("sweep", 5.0, b"x" * 85))
    assert [recent.at(k) is None for k in range(6)] == [True] * 4 + [False] * 2
    recent.skip()
    assert (recent.at(5), recent.at(6), recent.end) == (None, None, 7)


def test_streams_are_limited_and_take_no_thread(url, verdicts, jobs):
    async def live():
        async with started(make_app(url, verdicts, event_streams=40)) as app:
            job = await submit(jobs)
            path = f"/v1/jobs/{job.id}/events"
            async with Stream(app, path) as first:
                await first.next()
                before = threading.active_count()
                streams = [Stream(app, path if k % 2 else "/v1/events") for k in range(39)]
                for each in streams:
                    await each.__aenter__()
                sent = [await each.next() for each in streams]
                assert {event.name for event in sent} == {"job", "status"}
                # The reader of pages is the only new one, and those of the first requests.
                assert threading.active_count() <= before + 5
                async with Stream(app, path) as refused:
                    assert refused.status == 503
                    assert refused.headers["retry-after"] == "5"
                for each in streams:
                    await each.__aexit__()
            async with Stream(app, path) as again:
                assert again.status == 200

    run(live)


@pytest.mark.parametrize("template", PATHS)
def test_streams_end_when_the_service_stops(app, jobs, template):
    async def live():
        async with started(app):
            path = template.format((await submit(jobs)).id)
            async with Stream(app, path) as stream:
                await stream.next()
                app.state.resources.wake_up.close()
                names = [event.name for event in await stream.rest()]
        # The end of a job is sent when the job has ended: its stream only breaks off.
        assert names[-1:] == (["end"] if path == "/v1/events" else [])

    run(live)


def test_a_message_of_a_worker_is_told_at_once(app, jobs, monkeypatch):
    monkeypatch.setattr(watcher, "POLL_SECONDS", 3600.0)

    async def live():
        async with started(app):
            job = await submit(jobs)
            async with Stream(app, f"/v1/jobs/{job.id}/events") as stream:
                await stream.next()
                await asyncio.to_thread(jobs.cancel, job.id)
                app.state.resources.wake_up.announce(job.id)
                assert [event.name for event in await stream.rest()] == ["job", "end"]

    run(live)


def test_a_stream_ends_with_its_key(url, verdicts, jobs, database, monkeypatch):
    monkeypatch.setattr(routes, "HEARTBEAT_SECONDS", 0.05)
    monkeypatch.setattr(watcher, "WAIT_SECONDS", 0.02)

    async def live():
        key, sent = await asyncio.to_thread(make, database, Role.READ)
        async with started(make_app(url, verdicts)) as app:
            async with Stream(app, "/v1/events") as refused:
                assert refused.status == 401
            async with Stream(app, "/v1/events", **sent) as stream:
                assert (await stream.next()).name == "status"
                await asyncio.to_thread(KeyStore(database).revoke, key.prefix)
                await stream.rest()
                assert "still here" in stream.comments

    run(live)


@pytest.mark.parametrize("at", [0.0, 1.7e9, 1795451328.756009])
def test_a_position_is_read_from_its_id(at):
    assert position_of_id(id_of_position(at)) == at


@pytest.mark.parametrize("text", [None, "", "7", "zz" * 8, "7ff8000000000000", "bff0000000000000", "00" * 9])
def test_what_is_no_id_has_no_position(text):
    assert position_of_id(text) is None


def test_a_clock_that_was_set_back_hides_nothing(jobs, database):
    reader = ChangeReader(database)
    job = jobs.submit(STATE, "digest")
    _, found = reader.since(reader.now() + 7200.0)
    assert [(each.kind, each.id) for each in found] == [(Followable.JOB, job.id)]
