"""The certified tier over HTTP: decimals with proven radii."""

from decimal import Decimal, localcontext
from fractions import Fraction

import pytest

from tests.support.api import PLANAR, solve_job
from tests.support.golden import GOLDEN

pytestmark = pytest.mark.any_database

ROWS = ("p", "r", "g1", "g2", "g3")


@pytest.mark.parametrize(("name", "bits"), [("G4", 128), ("G1", 64), ("G10", 64)])
def test_the_golden_digits_are_inside_the_enclosures(client, jobs, name, bits):
    golden = next(each for each in GOLDEN if each.name == name)
    accuracy = {"tier": "certified", "bits": bits}
    solution = solve_job(
        client,
        jobs,
        {
            "body": golden.body,
            "potential": golden.potential,
            "motion": golden.motion,
            "time": {"times": list(golden.states)},
            "accuracy": accuracy,
        },
    )
    assert (solution["tier"], solution["problem"]["accuracy"]) == ("certified", accuracy)
    with localcontext() as context:
        context.prec = 120
        period = solution["period"]
        # The golden digits end after 33 places or more.
        gap = abs(Decimal(period["value"]) - Decimal(golden.period))
        assert gap <= Decimal(period["radius"]) + Decimal("1e-32")
        assert Decimal(period["radius"]) <= Decimal(2) ** (8 - bits) * Decimal(period["value"])
        response = client.get(f"/v1/solutions/{solution['id']}/enclosures")
        assert response.status_code == 200, response.json()
        columns = response.json()["columns"]
        for row, expected in enumerate(golden.states.values()):
            for variable, digits in zip(ROWS, expected, strict=True):
                found = columns[variable][row]
                gap = abs(Decimal(found["value"]) - Decimal(digits))
                assert gap <= Decimal(found["radius"]) + Decimal("1e-32")
                assert Decimal(found["radius"]) <= Decimal(2) ** (9 - bits)
    # The doubles of the trajectory are those numbers rounded.
    trajectory = client.get(f"/v1/solutions/{solution['id']}/trajectory").json()
    assert set(trajectory["columns"]) == {"t", "p", "q", "r", "g1", "g2", "g3"}
    assert trajectory["error"] <= 3e-16


def test_the_enclosures_tell_the_exact_times(client, jobs):
    asked = {"time": {"times": ["1/3", "7/2", 0.1]}, "accuracy": {"tier": "certified", "bits": 128}}
    solution = solve_job(client, jobs, {**PLANAR, **asked})
    found = client.get(f"/v1/solutions/{solution['id']}/enclosures").json()
    assert found["t"] == [1 / 3, 3.5, 0.1]
    exact = [Fraction(1, 3), Fraction(7, 2), Fraction(1, 10)]
    for ball, time in zip(found["times"], exact, strict=True):
        assert abs(Fraction(ball["value"]) - time) <= Fraction(ball["radius"]) <= Fraction(2) ** -120
    asked["time"] = {"periods": 3, "samples": 4}
    solution = solve_job(client, jobs, {**PLANAR, **asked})
    found = client.get(f"/v1/solutions/{solution['id']}/enclosures").json()
    period, last = solution["period"], found["times"][3]
    gap = abs(3 * Fraction(period["value"]) - Fraction(last["value"]))
    assert gap <= 3 * Fraction(period["radius"]) + Fraction(last["radius"])
    assert found["times"][0] == {"value": "0", "radius": "0"}
    # After whole periods the motion is where it was, whatever their length.
    for balls in found["columns"].values():
        gap = abs(Fraction(balls[3]["value"]) - Fraction(balls[0]["value"]))
        assert gap <= Fraction(balls[3]["radius"]) + Fraction(balls[0]["radius"])


def test_other_tiers_have_no_enclosures(client, jobs):
    solution = solve_job(client, jobs, PLANAR)
    response = client.get(f"/v1/solutions/{solution['id']}/enclosures")
    assert (response.status_code, response.json()["type"]) == (404, "urn:polhode:problem:no_enclosures")
