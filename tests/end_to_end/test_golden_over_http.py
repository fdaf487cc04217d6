"""The golden numbers as a client gets them: HTTP, queue, worker process, database, JSON."""

from decimal import Decimal

import pytest

from tests.support.golden import GOLDEN

COLUMNS = ("p", "r", "g1", "g2", "g3")


# The default tier promises 1e-10 and reaches 1e-12; of its period 1e-12 is asked, not promised.
PROMISES = {"standard": ("1e-10", "1e-12"), "high": ("1e-12", "1e-13")}


@pytest.mark.parametrize("tier", PROMISES)
@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden.name)
def test_golden_states_period_and_energy(service, golden, tier):
    of_states, of_period = map(Decimal, PROMISES[tier])
    problem = {
        "body": golden.body,
        "potential": golden.potential,
        "motion": golden.motion,
        "time": {"times": list(golden.states)},
        "accuracy": {"tier": tier},
    }
    solution, trajectory = service.solve(problem)
    columns = trajectory["columns"]
    assert columns["t"] == list(golden.states)
    for row, expected in enumerate(golden.states.values()):
        assert columns["q"][row] == 0.0
        for name, digits in zip(COLUMNS, expected, strict=True):
            gap = abs(Decimal(columns[name][row]) - Decimal(digits))
            assert gap <= Decimal(solution["error"]) <= of_states
            assert gap <= Decimal("1e-12")
    period = Decimal(golden.period)
    gap = abs(Decimal(solution["period"]["value"]) - period)
    assert gap <= Decimal(solution["period"]["error"]) <= of_period * period
    gap = abs(Decimal(solution["energy"]["value"]) - Decimal(golden.energy))
    # The energy is the double next to its enclosure: half an ulp at most.
    assert gap <= Decimal(2) ** -53
