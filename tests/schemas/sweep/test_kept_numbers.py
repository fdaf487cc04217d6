"""The numbers that a sweep keeps are those of the solution, each with its error where it has one."""

import math
from fractions import Fraction

from service.schemas.sweep.sweep import NUMBERS, kept_numbers
from tests.support.api import SUMMARY

STABILITY = {"trace": 1.5, "error": 1e-9, "exponent": 0.0, "exponent_error": 1e-8, "trusted_time": None}
EVERYTHING = {
    **SUMMARY,
    "invariants": {
        "energy": {"drift": 1e-15},
        "geometric": {"drift": 2e-15},
        "areas": {"drift": 3e-15},
        "kovalevskaya": {"value": 4.0, "drift": 4e-15, "kind": "general"},
    },
    "stability": STABILITY,
    "precession": {"psi1": {"value": 5.0, "error": 5e-12}, "psi3": {"value": 6.0, "error": 6e-12}},
    "cross_check": {"method": "integration", "disagreement": 7e-9, "horizon": 10.0, "agrees": True},
}


def kept(solution, name):
    (number,) = kept_numbers(solution, [name])
    return number


def test_numbers_are_found_where_the_solution_has_them():
    names = [
        "period", "period.error", "energy", "error", "invariants.areas.drift", "invariants.kovalevskaya",
        "stability.trace", "stability.trace.error", "stability.exponent.error", "precession.psi3",
        "precession.psi3.error", "cross_check.disagreement",
    ]  # fmt: skip
    expected = [2.0, 1e-16, 0.5, 3e-13, 3e-15, 4.0, 1.5, 1e-9, 1e-8, 6.0, 6e-12, 7e-9]
    assert kept_numbers(EVERYTHING, names) == expected


def test_what_a_solution_has_not_is_not_a_number():
    aperiodic = {**SUMMARY, "period": None}
    assert math.isnan(kept(aperiodic, "period"))
    assert math.isnan(kept(aperiodic, "period.error"))
    assert math.isnan(kept(SUMMARY, "stability.trace"))
    assert math.isnan(kept(EVERYTHING, "stability.trusted_time"))
    assert math.isnan(kept(EVERYTHING, "invariants.goriachev"))


def test_every_number_has_its_error_beside_it_unless_it_says_how_far_something_is_off():
    alone = {name for name in NUMBERS if not name.endswith(".error") and f"{name}.error" not in NUMBERS}
    drifts = {name for name in NUMBERS if name.endswith(".drift")}
    with_drift = {name.removesuffix(".drift") for name in drifts} & set(NUMBERS)
    assert alone - drifts - with_drift == {"error", "stability.trusted_time", "cross_check.disagreement"}
    assert {name.removesuffix(".error") for name in NUMBERS if name.endswith(".error")} <= set(NUMBERS)


def test_the_error_of_a_certified_number_covers_its_rounding():
    solution = {**SUMMARY, "period": {"value": "0.1000000000000000000000000000001", "radius": "1e-30"}}
    value, error = kept_numbers(solution, ["period", "period.error"])
    assert value == 0.1
    exact = abs(Fraction("0.1000000000000000000000000000001") - Fraction(0.1)) + Fraction("1e-30")
    # Rounded upwards: by two units in the last place at most.
    assert exact <= Fraction(error) <= exact * (1 + Fraction(1, 2**51))
