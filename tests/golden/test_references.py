"""Pinned numbers against ``references.json``, which was computed without the service and says how."""

import copy
import json
import math
from collections.abc import Iterator
from fractions import Fraction

import pytest

from tests.golden import write
from tests.golden.documents import DOCUMENTS
from tests.golden.motions import SAME
from tests.golden.references import FILE
from tests.support.golden import GOLDEN

NAMES = ("p", "q", "r", "g1", "g2", "g3")
STORED = json.loads(FILE.read_text(encoding="utf-8"))
DIGITS = json.loads(write.FILE.read_text(encoding="utf-8"))["digits"]
KNOWN = {"an integral": Fraction(1, 10**45), "pole passed by convention": Fraction(1, 10**45)}
BALLS = Fraction(1, 10**60)
"""How right a reference is: the integration was checked to 1e-64 and is written with 62 decimals."""
LITERATURE = Fraction(1, 10**27)
"""The golden numbers of the literature are written with 28 decimals or more."""


def rounding(value: float | str) -> Fraction:
    """Half a unit in the last place of a double; decimals of the certified tier have a radius instead."""
    return Fraction(math.ulp(value)) / 2 if isinstance(value, float) else Fraction(0)


def wrong(name: str, pinned: dict) -> Iterator[str]:
    """Yield what is further from the reference than its claim, its rounding and the reference's own error."""
    reference = STORED[SAME.get(name, name)]
    known = KNOWN.get(name, BALLS)
    numbers, columns = pinned["numbers"], pinned["columns"]
    for quantity in ("period", "energy"):
        number, exact = numbers[quantity], reference[quantity]
        if (number is None) != (exact is None):
            yield quantity
        elif number is not None:
            claim = Fraction(number["radius"] if "radius" in number else number["error"])
            gap = abs(Fraction(number["value"]) - Fraction(exact))
            if gap > claim + rounding(number["value"]) + known:
                yield quantity
    for k, t in enumerate(DOCUMENTS[name]["time"]["times"]):
        for column, exact in zip(NAMES, reference["states"][str(Fraction(t))], strict=True):
            value = columns[column][k]
            if abs(Fraction(value) - Fraction(exact)) > Fraction(numbers["error"]) + rounding(value) + known:
                yield f"{column} at {t}"
            if f"{column}.radius" in columns:
                whole = sum(Fraction(columns[each][k]) for each in (column, f"{column}.1", f"{column}.2"))
                if abs(whole - Fraction(exact)) > Fraction(columns[f"{column}.radius"][k]) + known:
                    yield f"enclosure of {column} at {t}"


@pytest.mark.parametrize("name", DOCUMENTS)
def test_pinned_digits_are_those_of_an_independent_computation(name):
    assert list(wrong(name, DIGITS[name])) == []


@pytest.mark.parametrize("name", DOCUMENTS)
def test_any_wrong_pinned_number_is_found(name):
    """Moved by three times what is allowed, each is reported: the test above can fail for every number."""
    pinned = DIGITS[name]
    numbers = pinned["numbers"]
    for quantity in ("period", "energy"):
        if numbers[quantity] is not None:
            moved = copy.deepcopy(pinned)
            number = moved["numbers"][quantity]
            value = number["value"]
            claim = Fraction(number["radius"] if "radius" in number else number["error"])
            away = Fraction(value) + 3 * (claim + rounding(value) + KNOWN.get(name, BALLS))
            number["value"] = away if isinstance(value, str) else float(away)
            assert quantity in list(wrong(name, moved))
    for column in NAMES:
        for k, value in enumerate(pinned["columns"][column]):
            moved = copy.deepcopy(pinned)
            away = 3 * (Fraction(numbers["error"]) + rounding(value))
            moved["columns"][column][k] = float(Fraction(value) + away)
            assert any(each.startswith(column) for each in wrong(name, moved)), (column, k)


def test_every_reference_says_how_it_was_computed():
    assert all(each["provenance"] for each in STORED.values())
    assert {SAME.get(name, name) for name in DOCUMENTS} | {each.name for each in GOLDEN} == set(STORED)


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda each: each.name)
def test_golden_numbers_are_those_of_the_integration(golden):
    assert golden.provenance
    reference = STORED[golden.name]
    assert abs(Fraction(golden.period) - Fraction(reference["period"])) < LITERATURE
    assert abs(Fraction(golden.energy) - Fraction(reference["energy"])) < LITERATURE
    for t, (p, r, *g) in golden.states.items():
        exact = [Fraction(each) for each in reference["states"][str(t)]]
        for value, other in zip((p, 0, r, *g), exact, strict=True):
            assert abs(Fraction(value) - other) < LITERATURE, t
