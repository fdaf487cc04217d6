"""Estimates: how they grow with what is asked, and what they call slow."""

from dataclasses import replace

import pytest

from service.schemas.problem.problem import read_problem
from service.schemas.sweep.estimates import (
    ExaminedPoint,
    estimate_of_jobs,
    estimate_of_sweep,
    sampled_points,
    scale_of,
)
from service.schemas.sweep.reading import read_sweep
from service.storage.solutions.shipped_accuracy import shipped_table
from tests.benchmarks.whole.points import OUTPUTS, axis, sweep_of

TABLE = shipped_table()
PERIODIC = ExaminedPoint({"kind": "periodic", "ends": ["rest", "equator"]}, 0.01)
APERIODIC = ExaminedPoint({"kind": "separatrix", "ends": ["equilibrium", "equator"]}, 0.01)
REFUSED = ExaminedPoint(None, 0.01, is_refused=True)
STATE = {"type": "state", "omega": ["1/2", "1/10", 1], "gamma": ["3/5", 0, "4/5"]}
OMEGA = axis("/motion/omega/0", "1/10", "9/10")


def estimate(document, found=PERIODIC, table=TABLE):
    sweep = read_sweep(document, max_points=10**8)
    sampled = [(read_problem(sweep.document(index)), found) for index in sampled_points(sweep)]
    return estimate_of_sweep(sweep, sampled, table, TABLE)


def linear(count, **fields):
    return sweep_of(axes=[{"pointer": "/motion/lambda", "linspace": ["6/10", 2, count]}], **fields)


def pointers(found):
    return {each.pointer for each in found.slow}


def test_the_cost_of_a_sweep_is_proportional_to_its_points():
    few, many = estimate(linear(100)), estimate(linear(100_000))
    # The same five kinds of points, a thousand times as many; sums of doubles.
    assert many.seconds == pytest.approx(1000 * few.seconds, rel=1e-12)
    assert many.bytes == pytest.approx(1000 * few.bytes, rel=1e-12)
    assert (few.points, many.points, few.tier) == (100, 100_000, "standard")


def test_a_slower_machine_takes_longer_by_the_ratio_of_its_table():
    rows = tuple(replace(row, seconds=7.0 * row.seconds) for row in TABLE.rows)
    slower = replace(TABLE, rows=rows)
    assert scale_of(slower, TABLE) == pytest.approx(7.0, rel=1e-12)
    assert estimate(linear(100), table=slower).seconds == pytest.approx(
        7.0 * estimate(linear(100)).seconds, rel=1e-12
    )


def test_a_point_of_a_block_is_far_cheaper_than_its_own_job():
    problem = read_problem(linear(2)["base"])
    alone = estimate_of_jobs({None: (problem, PERIODIC)}, TABLE, TABLE)
    # The issue of a user who multiplied: forty times too much. A block saves request, queue and storing.
    assert 1000 * alone.seconds > 20 * estimate(linear(1000)).seconds


@pytest.mark.parametrize(
    ("document", "pointer"),
    [
        (linear(100, accuracy={"tier": "certified"}), "/base/accuracy"),
        (linear(100, method="both"), "/base/method"),
        (linear(100, outputs=[*OUTPUTS, "stability"], accuracy={"tier": "high"}), "/base/outputs"),
        (sweep_of(axes=[axis("/time/stop", 1, 20)]), "/axes/0"),
        (sweep_of(axes=[axis("/body/A", "3/2", "5/2")]), "/axes/0"),
        (sweep_of(axes=[OMEGA], motion=STATE, time={"stop": 100, "samples": 101}), "/base/time"),
        ({**linear(100, time={"stop": 10, "samples": 1000}), "series": True}, "/series"),
    ],
)
def test_what_is_slow_is_named_and_costs_more(document, pointer):
    found = estimate(document)
    plain = sweep_of(axes=[OMEGA], motion=STATE) if document["base"]["motion"] is STATE else linear(100)
    usual = estimate(plain)
    assert pointer in pointers(found)
    assert pointer not in pointers(usual)
    assert found.seconds / found.points > 2.0 * usual.seconds / usual.points


def test_motions_that_are_not_periodic_are_slow():
    found = estimate(linear(100), APERIODIC)
    assert pointers(found) == {"/base/motion"}
    assert found.seconds > 10.0 * estimate(linear(100)).seconds


def test_points_without_a_motion_cost_less_and_store_nothing():
    found, usual = estimate(linear(100), REFUSED), estimate(linear(100))
    assert found.bytes == 0
    assert 0.0 < found.seconds < usual.seconds


CERTIFIED = {"accuracy": {"tier": "certified"}, "time": {"stop": 10, "samples": 1001}}


def test_a_list_is_the_sum_of_its_problems():
    base = linear(2)["base"]
    quick, slow = read_problem(base), read_problem({**base, **CERTIFIED})
    given = {0: (quick, PERIODIC), 2: (slow, PERIODIC)}
    both = estimate_of_jobs(given, TABLE, TABLE)
    parts = [estimate_of_jobs({index: each}, TABLE, TABLE) for index, each in given.items()]
    assert both.seconds == pytest.approx(sum(part.seconds for part in parts), rel=1e-12)
    assert (both.points, both.tier) == (2, None)
    # The index is the place in the list as it was sent, where a refused problem may stand between.
    assert pointers(both) == {"/2/accuracy"}
