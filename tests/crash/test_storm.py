"""Everything is killed at random, Postgres too: every acknowledged job has exactly one result afterwards."""

import pytest

from tests.crash.client import SWEEP_POINTS
from tests.crash.storm import Figures, by_procrastinate, on_postgres, on_sqlite

STORMS = pytest.mark.parametrize(
    ("jobs", "seconds"), [(60, 3.0), pytest.param(200, 6.0, marks=pytest.mark.long)]
)


def is_weathered(figures: Figures, jobs: int) -> None:
    said = figures.line()
    assert figures.kills.keys() >= {"api", "worker", "child"}, said
    assert len(figures.acknowledged) == jobs
    assert (figures.unfinished, figures.lost, figures.doubled) == (0, 0, 0), said
    assert figures.points >= SWEEP_POINTS
    assert figures.points % SWEEP_POINTS == 0
    assert figures.left_processes == 0, said
    assert figures.doctor["clean"], figures.doctor
    assert {again["sameness"] for again in figures.doctor["solved_again"]} == {"identical"}


@STORMS
def test_nothing_is_lost_or_doubled_on_sqlite(jobs, seconds):
    is_weathered(on_sqlite(seed=1, jobs=jobs, seconds=seconds), jobs)


@STORMS
def test_nothing_is_lost_or_doubled_on_postgres_that_crashes_as_well(jobs, seconds):
    is_weathered(on_postgres(seed=2, jobs=jobs, seconds=seconds), jobs)


@STORMS
def test_nothing_is_lost_or_doubled_by_two_hosts_with_procrastinate(jobs, seconds):
    is_weathered(by_procrastinate(seed=3, jobs=jobs, seconds=seconds), jobs)
