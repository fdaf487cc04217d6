"""A digit that changes is a new version of the numerics: solutions of the old one must not be reused.

``digits.json`` holds what the declared version computes. If a number here
differs, and the change is meant, raise ``NUMERICS``, write the file anew with
``python -m tests.golden.write`` and say so in the changelog.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from service.dynamics.numerics import NUMERICS
from tests.golden.documents import DOCUMENTS
from tests.golden.write import FILE, computed

ULPS = 16.0
"""What another processor's sine, or another order of summation in its matrix products, may change."""


@pytest.fixture(scope="module")
def stored():
    return json.loads(Path(FILE).read_text(encoding="utf-8"))


def test_the_digits_belong_to_the_declared_numerics(stored):
    assert stored["numerics"] == NUMERICS
    assert list(stored["digits"]) == list(DOCUMENTS)


@pytest.mark.parametrize("name", DOCUMENTS)
def test_no_digit_has_changed(stored, name):
    found, expected = computed(DOCUMENTS[name]), stored["digits"][name]
    # Periods, energies and proven decimals come from balls: the same on every machine.
    assert found["exact"] == expected["exact"]
    assert found["columns"].keys() == expected["columns"].keys()
    integrated = "state" in name
    for column, values in expected["columns"].items():
        gap = np.abs(np.array(found["columns"][column]) - values)
        # An integration's steps depend on the last bits; a thousandth of its tolerance is the same digits.
        assert gap.max() <= (
            1e-13 if integrated else ULPS * np.finfo(float).eps * max(1.0, np.abs(values).max())
        )
