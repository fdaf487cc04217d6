"""People before batches, and batches not for ever behind people: one worker, on a clock of its own."""

import heapq
import itertools
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.jobs.queue import CHUNK_SECONDS, SHARES, Lane, LaneShares


class Worker:
    """Takes jobs of the lanes in which some wait, always, and does nothing but count.

    ``seconds`` says what a job of a lane takes.
    """

    def __init__(self, seconds: dict[Lane, float], slots: int = 1, left: float = 1.0) -> None:
        self.shares, self.seconds, self.slots = LaneShares(left), seconds, slots
        self.now = 0.0
        self.running: list[tuple[float, int, Lane, bool]] = []
        self.order: list[Lane] = []
        self.spent: Counter[Lane] = Counter()
        self._numbers = itertools.count()

    def start(self, waiting: set[Lane]) -> Lane:
        """Start the job that comes next, as the runner does with the store."""
        lane = None
        for starved in self.shares.starved()[:1]:
            if starved in waiting:
                lane = starved
            else:
                self.shares.forget(starved)
        was_starved = lane is not None
        lane = min(waiting) if lane is None else lane
        self.shares.begin(lane)
        heapq.heappush(self.running, (self.now + self.seconds[lane], next(self._numbers), lane, was_starved))
        self.order.append(lane)
        return lane

    def finish(self) -> None:
        self.now, _, lane, was_starved = heapq.heappop(self.running)
        self.shares.end(lane, self.seconds[lane], was_starved=was_starved)
        self.spent[lane] += self.seconds[lane]

    def step(self, waiting: set[Lane]) -> Lane:
        """Wait for a free slot, and start a job in it."""
        if len(self.running) == self.slots:
            self.finish()
        return self.start(waiting)


EVERY = set(Lane)
LENGTHS = st.fixed_dictionaries({lane: st.floats(0.01, 5.0) for lane in Lane})


@settings(deadline=None)
@given(seconds=LENGTHS, slots=st.integers(1, 4))
def test_each_lane_gets_what_it_is_promised_while_jobs_wait_in_all(seconds, slots):
    worker = Worker(seconds, slots)
    # One job on each slot may be under way, and the first has to be earned.
    few = (slots + 1) * (max(seconds.values()) + CHUNK_SECONDS)
    for _ in range(300):
        worker.step(EVERY)
        single, listed, swept = (worker.spent[lane] for lane in Lane)
        assert listed >= SHARES[Lane.LIST] * (single + listed) - few
        assert swept >= SHARES[Lane.SWEEP] * (single + listed + swept) - few


@pytest.mark.parametrize("life", [1.5, 3.0, 6.0])
def test_chunks_have_their_share_though_every_worker_dies_young(life):
    """What is left of their debts is spread evenly, as by chance."""
    lives, seconds = 1000, {Lane.SINGLE: 0.1, Lane.SWEEP: CHUNK_SECONDS}
    begun = 0
    for number in range(lives):
        worker = Worker(seconds, left=(number + 0.5) / lives)
        while worker.now < life:
            begun += worker.step({Lane.SINGLE, Lane.SWEEP}) is Lane.SWEEP
    # One chunk for each debt of seven seconds that single jobs have paid; a job of 0.1 s may be more or less
    # at the end of a life. Chunks take their time out of the lives: they are at least an eighth of it.
    share = SHARES[Lane.SWEEP]
    assert begun * CHUNK_SECONDS >= share * lives * (life - 0.2)


@settings(deadline=None)
@pytest.mark.parametrize("lane", SHARES)
@given(seconds=LENGTHS, slots=st.integers(1, 4), alone=st.lists(st.booleans(), max_size=50))
def test_batches_get_no_more_than_their_share_while_single_jobs_wait(lane, seconds, slots, alone):
    """Whatever was before: batches that have had the worker for themselves, or have waited."""
    worker = Worker(seconds, slots)
    for is_alone in alone:
        worker.step({lane} if is_alone else {Lane.SINGLE, lane})
    while worker.running:
        worker.finish()
    worker.spent.clear()
    few = (slots + 1) * (max(seconds.values()) + CHUNK_SECONDS)
    for _ in range(200):
        worker.step({Lane.SINGLE, lane})
        assert worker.spent[lane] <= SHARES[lane] * worker.spent.total() + few


@settings(deadline=None)
@given(seconds=LENGTHS, slots=st.integers(1, 4), batches=st.integers(0, 100), people=st.integers(0, 3))
def test_a_single_job_comes_next_however_long_batches_have_had_the_worker(seconds, slots, batches, people):
    seconds[Lane.SINGLE] = min(seconds[Lane.SINGLE], 0.1)
    worker = Worker(seconds, slots)
    for _ in range(people):
        worker.step({Lane.SINGLE})
    for _ in range(batches):
        worker.step({Lane.SWEEP})
    assert worker.step(EVERY) is Lane.SINGLE


def test_nobody_saves_up_while_nothing_of_his_waits():
    worker = Worker(dict.fromkeys(Lane, 1.0))
    for _ in range(1000):
        worker.step({Lane.SINGLE})
    first = [worker.step({Lane.SINGLE, Lane.SWEEP}) for _ in range(8)]
    # At most the one that may have been due at this moment.
    assert first.count(Lane.SWEEP) <= 1
    for _ in range(1000):
        worker.step({Lane.SWEEP})
    later = [worker.step({Lane.SINGLE, Lane.SWEEP}) for _ in range(16)]
    assert 1 <= later.count(Lane.SWEEP) <= 2


def test_the_most_neglected_lane_comes_first():
    shares = LaneShares()
    assert shares.starved() == ()
    shares.begin(Lane.LIST)
    shares.end(Lane.LIST, 10.0, was_starved=False)
    assert shares.starved() == (Lane.SWEEP,)
    shares.begin(Lane.SWEEP)
    # What runs is counted before it has ended: another slot does not pay once more.
    assert shares.starved() == ()
    shares.begin(Lane.SINGLE)
    shares.end(Lane.SINGLE, 100.0, was_starved=False)
    assert shares.starved() == (Lane.SWEEP, Lane.LIST)
