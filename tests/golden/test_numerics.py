"""A digit that changes is a new version of the numerics: solutions of the old one must not be reused.

``digits.json`` holds what the declared version computes. Every processor must
find the same numbers within the errors that are claimed; a processor whose bits
are in the file, by its features and the versions of the libraries, must find
these bits. If a number differs, and the change is meant, raise ``NUMERICS``,
write the file anew with ``python -m tests.golden.write`` and say so in the
changelog. The same command adds the bits of another processor.
"""

import json
from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.numerics import NUMERICS
from tests.golden.documents import DOCUMENTS
from tests.golden.write import FILE, bits_of, computed, key

ESTIMATES = 2.0
"""Errors are estimates that rest on doubles, hence on the processor; they are of one size everywhere."""


@pytest.fixture(scope="module")
def stored():
    return json.loads(FILE.read_text(encoding="utf-8"))


@pytest.fixture(scope="module", params=DOCUMENTS)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def found(name):
    return computed(DOCUMENTS[name])


def error_of(number):
    return Fraction(number["radius"] if "radius" in number else number["error"])


def test_the_digits_belong_to_the_declared_numerics(stored):
    assert stored["numerics"] == NUMERICS
    assert list(stored["digits"]) == list(DOCUMENTS)
    assert all(bits.keys() <= DOCUMENTS.keys() for bits in stored["bits"].values())


def test_every_processor_finds_the_same_numbers_within_their_errors(stored, name, found):
    expected = stored["digits"][name]
    assert found["numbers"].keys() == expected["numbers"].keys()
    for quantity in ("period", "energy"):
        number, other = found["numbers"][quantity], expected["numbers"][quantity]
        assert (number is None) == (other is None)
        if number is not None:
            gap = abs(Fraction(number["value"]) - Fraction(other["value"]))
            assert gap <= error_of(number) + error_of(other), quantity
    error = found["numbers"]["error"] + expected["numbers"]["error"]
    assert found["columns"].keys() == expected["columns"].keys()
    for column, values in expected["columns"].items():
        assert np.abs(np.array(found["columns"][column]) - values).max() <= error, column


def test_errors_are_of_the_same_size_on_every_processor(stored, name, found):
    """One that grows a thousandfold is a change of the numerics, though every number is within it."""
    numbers, others = found["numbers"], stored["digits"][name]["numbers"]
    pairs = [
        (error_of(numbers[each]), error_of(others[each])) for each in ("period", "energy") if others[each]
    ]
    for error, other in [*pairs, (numbers["error"], others["error"])]:
        assert error <= ESTIMATES * other
        assert other <= ESTIMATES * error


def test_a_processor_whose_bits_are_known_finds_these_bits(stored, name, found):
    known = stored["bits"].get(key(), {}).get(name)
    # Of another processor nothing but the two tests above is promised.
    assert known is None or bits_of(found) == known
    # Whatever the processor is, it finds its own bits again.
    assert bits_of(computed(DOCUMENTS[name])) == bits_of(found)
