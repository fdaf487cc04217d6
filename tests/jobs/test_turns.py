"""Keys take turns: whatever they submit, and whenever, none waits for the backlog of another."""

from collections import Counter
from dataclasses import dataclass, field

from hypothesis import given, settings
from hypothesis import strategies as st

from service.jobs.queue import LARGEST_GAP, LEAST_GAP, gap_for, turns

KEYS = "abcd"


@dataclass
class Waiting:
    turn: float
    number: int
    key: str
    seconds: float


@dataclass
class Queue:
    """One lane without a database: jobs get turns when they come, and are taken by turn, key and age."""

    waiting: list[Waiting] = field(default_factory=list)
    taken: list[Waiting] = field(default_factory=list)
    number: int = 0

    def submit(self, key: str, seconds: list[float]) -> list[Waiting]:
        own = [job.turn for job in [*self.waiting, *self.taken] if job.key == key]
        given = turns(
            max((job.turn for job in self.taken), default=0.0),
            max(own, default=None),
            [*map(gap_for, seconds)],
        )
        new = [
            Waiting(turn, self.number + k, key, each)
            for k, (turn, each) in enumerate(zip(given, seconds, strict=True))
        ]
        self.number += len(new)
        self.waiting += new
        return new

    def take(self) -> Waiting:
        job = min(self.waiting, key=lambda each: (each.turn, each.key, each.number))
        self.waiting.remove(job)
        self.taken.append(job)
        return job

    def keys(self) -> set[str]:
        return {job.key for job in self.waiting}


SUBMISSIONS = st.lists(
    st.one_of(st.tuples(st.sampled_from(KEYS), st.integers(1, 30)), st.none()), min_size=1, max_size=60
)
"""A key and how many jobs it submits; None takes a job."""


def run(queue, steps, seconds=lambda key: 1.0):
    """Submit and take; yield before each job that is taken."""
    for step in steps:
        if step is not None:
            key, count = step
            queue.submit(key, [seconds(key)] * count)
        elif queue.waiting:
            yield


@settings(deadline=None)
@given(before=SUBMISSIONS, after=SUBMISSIONS)
def test_keys_that_wait_get_one_job_each_in_turn(before, after):
    """Over any time in which two keys always have a job waiting their numbers differ by one at most."""
    queue = Queue()
    for _ in run(queue, before):
        queue.take()
    busy = queue.keys()
    counts = Counter()
    for _ in run(queue, [*after, *[None] * 200]):
        busy &= queue.keys()
        if len(busy) < 2:
            return
        job = queue.take()
        counts[job.key] += 1
        of_busy = [counts[key] for key in busy]
        assert max(of_busy) - min(of_busy) <= 1


@settings(deadline=None)
@given(before=SUBMISSIONS, after=SUBMISSIONS, key=st.sampled_from(KEYS), count=st.integers(1, 5))
def test_no_job_waits_for_more_than_its_share(before, after, key, count):
    """For each job of its own key before it, a job waits for one of every other key, and for two besides."""
    queue = Queue()
    for _ in run(queue, before):
        queue.take()
    *_, job = queue.submit(key, [1.0] * count)
    own = sum(other.key == key for other in queue.waiting) - 1
    first = len(queue.taken)
    for _ in run(queue, [*after, *[None] * 10_000]):
        if queue.take() is job:
            break
    started = Counter(other.key for other in queue.taken[first:-1])
    assert started.pop(key, 0) == own
    assert all(number <= own + 2 for number in started.values())


@settings(deadline=None)
@given(
    backlog=st.dictionaries(st.sampled_from(KEYS[:3]), st.integers(1, 1000), min_size=1),
    taken=st.integers(0, 50),
)
def test_who_comes_anew_waits_for_one_job_of_every_other_key_at_most(backlog, taken):
    queue = Queue()
    for key, count in backlog.items():
        queue.submit(key, [1.0] * count)
    for _ in range(min(taken, len(queue.waiting))):
        queue.take()
    others = queue.keys()
    (job,) = queue.submit("new", [1.0])
    place = next(k for k in range(10_000) if queue.take() is job)
    assert place <= len(others)


@settings(deadline=None)
@given(lengths=st.tuples(st.floats(1.0, 300.0), st.floats(1.0, 300.0)), number=st.integers(2, 200))
def test_long_jobs_are_shared_out_by_what_they_take(lengths, number):
    """Neither of two keys that always wait has more than a job of each kind before the other."""
    queue = Queue()
    for key, seconds in zip("ab", lengths, strict=True):
        queue.submit(key, [seconds] * number)
    had = Counter({"a": 0.0, "b": 0.0})
    while queue.keys() == {"a", "b"}:
        job = queue.take()
        had[job.key] += job.seconds
        # 1e-9 of the sums is far above the rounding of their terms.
        assert abs(had["a"] - had["b"]) <= sum(lengths) * (1 + 1e-9) + 1e-9 * had["a"]


@settings(deadline=None)
@given(st.one_of(st.none(), st.floats(allow_nan=False)))
def test_a_gap_is_a_second_at_least_whatever_a_clock_has_measured(seconds):
    assert LEAST_GAP <= gap_for(seconds) <= LARGEST_GAP


def test_nothing_submitted_takes_no_turn():
    assert turns(3.0, 5.0, []) == []
