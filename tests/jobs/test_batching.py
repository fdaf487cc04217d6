"""How many jobs share a call of a child: one until they are known to be short, and one again if not."""

import math

from hypothesis import given
from hypothesis import strategies as st

from service.jobs.queue import BATCH_SECONDS, MOST_TOGETHER, BatchSize

CALLS = st.lists(
    st.tuples(st.integers(1, MOST_TOGETHER), st.floats(0.0, 10.0, allow_subnormal=False)), max_size=20
)


@given(CALLS)
def test_a_call_is_never_expected_to_take_longer_than_its_time(calls):
    size = BatchSize()
    assert size.most == 1
    for number, seconds in calls:
        before = size.most
        size.learn(number, seconds)
        assert 1 <= size.most <= MOST_TOGETHER
        if number < before and seconds <= BATCH_SECONDS:
            assert size.most == before
        else:
            # One rounding of each of the three operations.
            assert size.most == 1 or size.most * seconds / number <= BATCH_SECONDS * (1.0 + 1e-15)


@given(CALLS)
def test_a_long_job_and_a_batch_that_was_broken_up_end_batches_at_once(calls):
    for end in (lambda size: size.learn(1, 1.001 * BATCH_SECONDS), BatchSize.reset):
        size = BatchSize()
        for number, seconds in calls:
            size.learn(number, seconds)
        end(size)
        assert size.most == 1


def test_short_jobs_are_soon_taken_by_many():
    size, steps = BatchSize(), 0
    while size.most < MOST_TOGETHER:
        size.learn(size.most, 1e-3 * size.most)
        steps += 1
    assert steps <= math.ceil(math.log2(MOST_TOGETHER))
