"""The golden numbers as a client gets them: HTTP, queue, worker process, database, JSON."""

from decimal import Decimal

import pytest

from tests.support.golden import GOLDEN

COLUMNS = ("p", "r", "g1", "g2", "g3")


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden.name)
def test_golden_states_period_and_energy(service, golden):
    problem = {
        "body": golden.body,
        "potential": golden.potential,
        "motion": golden.motion,
        "time": {"times": list(golden.states)},
    }
    solution, trajectory = service.solve(problem)
    columns = trajectory["columns"]
    assert columns["t"] == list(golden.states)
    for row, expected in enumerate(golden.states.values()):
        assert columns["q"][row] == 0.0
        for name, digits in zip(COLUMNS, expected, strict=True):
            # 1e-12 is promised; the claim that comes along is kept too.
            gap = abs(Decimal(columns[name][row]) - Decimal(digits))
            assert gap <= Decimal(solution["error"]) <= Decimal("1e-12")
    period = Decimal(golden.period)
    gap = abs(Decimal(solution["period"]["value"]) - period)
    assert gap <= Decimal(solution["period"]["error"]) <= Decimal("1e-13") * period
    gap = abs(Decimal(solution["energy"]["value"]) - Decimal(golden.energy))
    # The energy is the double next to its enclosure: half an ulp at most.
    assert gap <= Decimal(2) ** -53
