"""Laws of the table of legal moves."""

import pytest

from service.jobs.records import (
    ALLOWED,
    FINISHED,
    JITTER,
    LONGEST_PAUSE_SECONDS,
    JobState,
    after_loss,
    pause_after,
    sources,
)


def test_every_state_has_its_moves():
    assert set(ALLOWED) == set(JobState)


def test_sources_is_the_inverse_of_allowed():
    moves = {(start, end) for start, ends in ALLOWED.items() for end in ends}
    assert {(start, end) for end in JobState for start in sources(end)} == moves


def test_nothing_leaves_a_finished_state():
    assert {JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED} == FINISHED


def test_every_state_can_be_reached_from_queued():
    reached, border = {JobState.QUEUED}, {JobState.QUEUED}
    while border:
        border = {end for start in border for end in ALLOWED[start]} - reached
        reached |= border
    assert reached == set(JobState)


@pytest.mark.parametrize("state", [JobState.SUCCEEDED, JobState.FAILED])
def test_only_a_running_job_succeeds_or_fails(state):
    assert sources(state) == (JobState.RUNNING,)


@pytest.mark.parametrize(
    ("losses", "state"),
    [(1, JobState.QUEUED), (2, JobState.QUEUED), (3, JobState.FAILED), (4, JobState.FAILED)],
)
def test_a_job_that_loses_its_workers_is_given_up(losses, state):
    assert after_loss(losses, max_attempts=3) is state


def test_a_pause_doubles_up_to_a_minute_and_never_comes_at_the_same_moment():
    pauses = [pause_after(losses, 1.0, 0.0) for losses in range(1, 10)]
    assert pauses == [0, 1, 2, 4, 8, 16, 32, 60, 60]
    assert pause_after(10**6, 1.0, 0.0) == LONGEST_PAUSE_SECONDS
    assert pause_after(2, 0.0, 1.0) == 0.0
    assert pause_after(4, 1.0, -1.0) == 4 * (1 - JITTER)
    assert pause_after(4, 1.0, 1.0) == 4 * (1 + JITTER)
