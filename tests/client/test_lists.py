"""Lists of any length: cut into requests, refused one by one, waited for, and found again the next day."""

import asyncio
import json
from collections import Counter
from itertools import count
from types import SimpleNamespace

import httpx
import pytest

import polhode as ph
from polhode import lists
from polhode.lists import submitted
from tests.support.effort import examples


@pytest.fixture
def problems(base):
    """Eight problems, of which number 3 is refused by the service and number 5 cannot be sent."""
    listed = [ph.problem(base, lam=f"{70 + k}/101") for k in range(8)]
    listed[3] = listed[3] | {"body": {"A": -1, "C": 1}}
    listed[5] = {"potential": {1, 2}}
    return listed


class Playing:
    """A service that takes lists: it refuses numbers below 0, and whole requests as it is told."""

    def __init__(self, *whole: httpx.Response, most: int = 1000) -> None:
        self.whole, self.most = list(whole), most
        self.sizes: list[int] = []
        self.made: dict[str, list[int]] = {}
        self.busy = Counter()

    def __call__(self, request: httpx.Request) -> httpx.Response:
        numbers = [each["number"] for each in json.loads(request.content)]
        self.sizes.append(len(numbers))
        if self.whole:
            return self.whole.pop(0)
        if len(numbers) > self.most:
            return refusal(429, "too_many_queued_jobs", exceeds_limit=True)
        if any(number > 10**6 for number in numbers):
            return refusal(413, "body_too_large")
        key = request.headers["Idempotency-Key"]
        taken = [n for n in numbers if n >= 0 and not self.is_busy(n)]
        if key not in self.made:
            self.made[key] = taken
        items = [
            {"status": 202, "job": {"id": f"job-{n}", "state": "queued"}, "problem": None}
            if n in taken
            else {"status": 503 if n >= 0 else 422, "job": None, "problem": {"type": "urn:x:refused"}}
            for n in numbers
        ]
        return httpx.Response(202 if taken else 422, json={"items": items})

    def is_busy(self, number: int) -> bool:
        self.busy[number] += 1
        return number == 100_077 and self.busy[number] < 3


def refusal(status: int, code: str, **extras: object) -> httpx.Response:
    headers = {"Retry-After": "0"} if status in (429, 503) else {}
    return httpx.Response(status, headers=headers, json={"type": f"urn:polhode:problem:{code}", **extras})


@pytest.fixture
def played(monkeypatch):
    """Return a client of a played service."""
    monkeypatch.setattr(lists, "_LONGEST_PAUSE", 0.0)

    def connected(playing: Playing) -> ph.Client:
        def made(kind, terms):
            return kind(base_url=terms.url, transport=httpx.MockTransport(playing))

        monkeypatch.setattr("polhode.transport.carriers._made", made)
        return ph.connect("http://127.0.0.1:9", cache=False, patience=20)

    return connected


def outcomes(client: ph.Client, numbers, **options: object) -> list[str]:
    given = ({"number": number} for number in numbers)
    found = list(submitted(client.carrier, given, **options))
    assert [each.index for each in found] == list(range(len(numbers)))
    return [each.id or each.error.code for each in found]


def test_a_long_list_is_cut_and_a_refusal_does_not_stop_it(played):
    playing = Playing()
    numbers = [*range(1500), -1, *range(1501, 2600)]
    expected = [f"job-{n}" if n >= 0 else "refused" for n in numbers]
    with played(playing) as client:
        assert outcomes(client, numbers) == expected
        assert sorted(playing.sizes) == [600, 1000, 1000]
        # A repeated command: the same keys, and nothing is made again.
        assert outcomes(client, numbers) == expected
        assert len(playing.made) == 3
        assert outcomes(client, numbers, again=True) == expected
        assert len(playing.made) == 6


def test_requests_stay_below_the_limits_of_bytes_and_fields(played, monkeypatch):
    playing = Playing()
    monkeypatch.setattr(lists, "_MOST_BYTES", 1000)
    with played(playing) as client:
        given = [{"number": n, "note": "x" * 400} for n in range(5)]
        assert [each.id for each in submitted(client.carrier, given)] == [f"job-{n}" for n in range(5)]
        assert sorted(playing.sizes) == [1, 2, 2]
        monkeypatch.setattr(lists, "_MOST_FIELDS", 12)
        given = [{"number": n, "deep": [{"a": 1}, {"b": {"c": 2}}]} for n in range(5)]
        assert [each.id for each in submitted(client.carrier, given)] == [f"job-{n}" for n in range(5)]
        assert sorted(playing.sizes[3:]) == [1, 2, 2]


@pytest.mark.parametrize("status", [429, 503])
def test_a_busy_service_is_waited_for(played, status):
    playing = Playing(*(refusal(status, "busy") for _ in range(4)))
    with played(playing) as client:
        client.carrier.terms.patience = 0.0  # waiting for a service that answers is no matter of patience
        assert outcomes(client, [1, 2]) == ["job-1", "job-2"]
    assert playing.sizes == [2] * 5


def test_problems_that_were_refused_for_lack_of_time_are_sent_again_alone(played):
    playing = Playing()
    with played(playing) as client:
        assert outcomes(client, [1, 100_077, -5]) == ["job-1", "job-100077", "refused"]
    assert playing.sizes == [3, 1, 1]


def test_a_list_that_gets_on_is_waited_for_and_one_that_does_not_says_so(played, monkeypatch):
    """Each request takes 15 s of a patience of 20 s."""
    playing = Playing()
    monkeypatch.setattr(lists, "time", SimpleNamespace(monotonic=count(step=15).__next__))
    monkeypatch.setattr(playing, "is_busy", lambda number: number > len(playing.sizes))
    with played(playing) as client:
        assert outcomes(client, range(6)) == [f"job-{n}" for n in range(6)]
        assert playing.sizes == [6, 4, 3, 2, 1]
        assert outcomes(client, [0, 1000]) == ["job-0", "refused"]


def test_one_problem_that_makes_a_request_unreadable_is_found(played):
    playing = Playing()
    numbers = [*range(9), 10**7, *range(10, 16)]
    with played(playing) as client:
        assert outcomes(client, numbers) == [f"job-{n}" if n < 10**6 else "body_too_large" for n in numbers]


def test_a_limit_below_a_request_is_kept_by_halves_and_none_is_waited_for(played):
    playing = Playing(most=4)
    with played(playing) as client:
        assert outcomes(client, range(10)) == [f"job-{n}" for n in range(10)]
        assert max(map(len, playing.made.values())) <= 4
        playing.most = 0
        with pytest.raises(ph.RefusedError, match="too_many_queued_jobs"):
            outcomes(client, [1])
        playing.whole = [refusal(429, "storage_limit")]
        with pytest.raises(ph.RefusedError, match="storage_limit"):
            outcomes(client, [1])


def test_what_was_submitted_is_yielded_before_what_stops_it(played):
    playing = Playing()
    with played(playing) as client:
        yielded = submitted(client.carrier, ({"number": n} for n in range(3000)))
        assert [next(yielded).id for _ in range(2000)] == [f"job-{n}" for n in range(2000)]
        playing.whole = [refusal(401, "key_missing")]
        with pytest.raises(ph.RefusedError, match="key_missing"):
            next(yielded)


def test_a_list_is_submitted_today_and_fetched_tomorrow(connected, problems, tmp_path):
    listed = connected.submit_all(iter(problems))
    assert (len(listed), sorted(listed.errors)) == (8, [3, 5])
    assert (listed.errors[3].pointer, listed.ids[3]) == ("/body/A", None)
    assert isinstance(listed.errors[5], ph.WrongArgumentError)
    assert connected.submit_all(problems).ids == listed.ids
    later = connected.stored_list(listed.save(tmp_path / "list.json"))
    assert (later.ids, sorted(later.errors)) == (listed.ids, [3, 5])
    ends = dict(later.as_completed())
    assert sorted(ends) == list(range(8))
    assert {
        index: each.problem["motion"]["lambda"] for index, each in ends.items() if index not in (3, 5)
    } == {index: problems[index]["motion"]["lambda"] for index in (0, 1, 2, 4, 6, 7)}
    assert later.states() == {"succeeded": 6, "refused": 2}
    with pytest.raises(ph.SomeFailedError) as some:
        later.wait()
    assert (sorted(some.value.errors), sorted(some.value.motions)) == ([3, 5], [0, 1, 2, 4, 6, 7])
    by_ids = connected.stored_list([listed.ids[0], None, listed.ids[0]])
    assert [motion.id for motion in by_ids.wait(seconds=60)] == [ends[0].id] * 2


def test_a_deleted_job_is_told_and_not_waited_for(connected, base):
    listed = connected.stored_list(["01a2093c-94c9-70fd-9ade-9dd8a9a0e28b"])
    ((index, error),) = listed.as_completed()
    assert (index, type(error)) == (0, ph.MissingError)


def test_a_bar_follows_a_list_and_an_event_loop_has_it_too(service, base):
    told = []
    problems = [ph.problem(base, lam=f"{80 + k}/103") for k in range(5)]
    with ph.connect(service.address, progress=told.append) as client:
        ids = [motion.id for motion in client.solve_all(problems)]
    assert [each.what for each in told if each.is_over] == ["problems submitted", "jobs"]
    assert (told[-1].done, told[-1].total) == (5, 5)

    async def solve():
        async with ph.connect_async(service.address) as client:
            listed = await client.submit_all(problems)
            ends = {index: motion.id async for index, motion in listed.as_completed()}
            return [ends[index] for index in range(5)], [each.id for each in await client.solve_all(problems)]

    assert asyncio.run(solve()) == (ids, ids)


@pytest.mark.long
def test_thousands_of_problems_with_one_that_is_refused(connected, base):
    count = examples(800, 20_000)
    bad = count - 789
    problems = [ph.problem(base, lam=f"{60_000 + k}/50021") for k in range(count)]
    problems[bad] = problems[bad] | {"body": {"A": -1, "C": 1}}
    listed = connected.submit_all(problems)
    assert sorted(listed.errors) == [bad]
    with pytest.raises(ph.SomeFailedError) as some:
        listed.wait()
    assert (sorted(some.value.errors), len(some.value.motions)) == ([bad], count - 1)
    some_place = some.value.motions[count - 1]
    assert some_place.problem["motion"] == problems[-1]["motion"]
