"""The pauses before a process that died is started again."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.local.workers import (
    EARLY_SECONDS,
    FIRST_PAUSE_SECONDS,
    LONGEST_PAUSE_SECONDS,
    Restarts,
    WorkerStanding,
)

lives = st.lists(st.floats(0.0, 4 * EARLY_SECONDS), max_size=50)


def after(seconds, *, has_worked=False):
    restarts = Restarts()
    for lived in seconds:
        restarts = restarts.after_death(lived, has_worked=has_worked)
    return restarts


@given(lives, st.floats(EARLY_SECONDS, 1e9))
def test_one_that_ran_for_a_while_is_started_again_at_once_whatever_was_before(before, lived):
    assert after([*before, lived]).pause_seconds == 0.0


@given(lives, st.floats(0.0, 1e9))
def test_so_is_one_that_had_worked_however_short(before, lived):
    assert after(before).after_death(lived, has_worked=True).pause_seconds == 0.0


@given(lives)
def test_the_first_early_death_costs_half_a_second_at_most(before):
    restarts = after([*before, EARLY_SECONDS, 0.0])
    assert restarts.pause_seconds == FIRST_PAUSE_SECONDS


@given(st.integers(0, 2000))
def test_pauses_double_with_each_early_death_up_to_the_longest(deaths):
    pauses = [after([0.0] * count).pause_seconds for count in range(min(deaths, 12) + 1)]
    for shorter, longer in itertools.pairwise(pauses[1:]):
        assert longer == min(2 * shorter, LONGEST_PAUSE_SECONDS)
    assert Restarts(deaths, deaths).pause_seconds <= LONGEST_PAUSE_SECONDS


@given(lives)
def test_every_death_is_counted(seconds):
    assert after(seconds).deaths == len(seconds)


@pytest.mark.parametrize(
    ("standing", "said"),
    [
        (WorkerStanding(Restarts(3, 2), -9, None), "ok"),
        (WorkerStanding(Restarts(1, 1), -9, 0.5), "ended with code -9; it is started again in 0.5 s"),
        (WorkerStanding(Restarts(7, 4), 1, 3.25), "ended with code 1, 4 times in a row soon after its start"),
        (WorkerStanding(Restarts(2, 1), None, 1.0), "could not be started"),
    ],
)
def test_a_pause_is_told_with_its_reason(standing, said):
    assert said in str(standing)
