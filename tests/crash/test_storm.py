"""Everything is killed at random, Postgres too: every acknowledged job has exactly one result afterwards."""

import pytest

from tests.crash.client import SWEEP_POINTS
from tests.crash.storm import Figures, Plan, by_procrastinate, on_postgres, on_sqlite

JOBS, SECONDS = 60, 3.0
LONG_JOBS, LONG_SECONDS, LONG_KILLS = 2000, 120.0, 300


def is_weathered(figures: Figures, plan: Plan) -> None:
    said = figures.line()
    assert figures.kills.keys() >= {"api", "worker", "child"}, said
    assert figures.kills.total() >= plan.kills, said
    assert len(figures.acknowledged) == plan.jobs
    assert (figures.unfinished, figures.lost, figures.doubled) == (0, 0, 0), said
    assert figures.points >= SWEEP_POINTS
    assert figures.points % SWEEP_POINTS == 0
    assert figures.left_processes == 0, said
    assert figures.doctor["clean"], figures.doctor
    assert {again["sameness"] for again in figures.doctor["solved_again"]} == {"identical"}


def test_nothing_is_lost_or_doubled_on_sqlite():
    plan = Plan(seed=1, jobs=JOBS, seconds=SECONDS)
    is_weathered(on_sqlite(plan), plan)


def test_nothing_is_lost_or_doubled_on_postgres_that_crashes_as_well():
    plan = Plan(seed=2, jobs=JOBS, seconds=SECONDS)
    is_weathered(on_postgres(plan), plan)


def test_nothing_is_lost_or_doubled_by_two_hosts_with_procrastinate():
    plan = Plan(seed=3, jobs=JOBS, seconds=SECONDS)
    is_weathered(by_procrastinate(plan), plan)


@pytest.mark.long
@pytest.mark.parametrize("run", [on_sqlite, on_postgres, by_procrastinate])
def test_nothing_is_lost_or_doubled_in_a_long_storm_under_load(run):
    plan = Plan(seed=4, jobs=LONG_JOBS, seconds=LONG_SECONDS, kills=LONG_KILLS, pause_seconds=0.2)
    is_weathered(run(plan), plan)
