"""Everything is killed at random, Postgres too: every acknowledged job has exactly one result afterwards."""

import pytest

from tests.crash.client import SWEEP_POINTS
from tests.crash.storm import (
    Figures,
    Plan,
    on_cluster,
    on_cluster_and_postgres,
    on_postgres,
    on_sqlite,
    on_two_hosts,
)
from tests.support.effort import examples


def is_weathered(figures: Figures, plan: Plan) -> None:
    said = figures.line()
    parts = {"scheduler", "nanny", "Dask worker"} if figures.stalls else set()
    assert figures.kills.keys() >= {"api", "worker", "child", *parts}, said
    assert figures.kills.total() >= plan.kills, said
    assert len(figures.acknowledged) == plan.jobs
    assert (figures.unfinished, figures.lost, figures.doubled) == (0, 0, 0), said
    assert figures.points >= SWEEP_POINTS
    assert figures.points % SWEEP_POINTS == 0
    assert figures.left_processes == 0, said
    assert figures.doctor["clean"], figures.doctor
    assert {again["sameness"] for again in figures.doctor["solved_again"]} == {"identical"}


@pytest.mark.parametrize("jobs", [12, pytest.param(60, marks=pytest.mark.long)])
def test_nothing_is_lost_or_doubled_in_a_short_storm(jobs):
    plan = Plan(seed=1, jobs=jobs, seconds=3.0)
    is_weathered(on_sqlite(plan), plan)


@pytest.mark.long
@pytest.mark.parametrize("run", [on_sqlite, on_postgres, on_cluster, on_cluster_and_postgres])
def test_nothing_is_lost_or_doubled_in_a_long_storm_under_load(run):
    plan = Plan(
        seed=4,
        jobs=examples(60, 2000),
        seconds=float(examples(5, 120)),
        kills=examples(8, 300),
        pause_seconds=0.2,
    )
    is_weathered(run(plan), plan)


@pytest.mark.long
def test_nothing_is_lost_or_doubled_by_two_hosts():
    plan = Plan(seed=3, jobs=200, seconds=6.0)
    is_weathered(on_two_hosts(plan), plan)
