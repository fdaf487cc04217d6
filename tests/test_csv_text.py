"""Columns as CSV: another reader gets back the same doubles, whatever they are."""

import csv
import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.csv_text import CRLF, LF, csv_blocks


@pytest.mark.parametrize("line_end", [CRLF, LF])
@given(rows=st.lists(st.tuples(st.floats(allow_nan=False), st.integers(-(2**63), 2**63 - 1))))
def test_another_reader_gets_the_same_numbers_back(line_end, rows):
    numbers = np.array([number for number, _ in rows], dtype=np.float64)
    counts = np.array([count for _, count in rows], dtype=np.int64)
    blocks = [[numbers[:1], counts[:1]], [numbers[1:], counts[1:]]]
    text = b"".join(csv_blocks(["t", "index"], blocks, line_end)).decode()
    assert text.endswith(line_end)
    names, *found = csv.reader(io.StringIO(text, newline=""), lineterminator=line_end)
    assert names == ["t", "index"]
    assert [int(count) for _, count in found] == counts.tolist()
    assert np.array([float(number) for number, _ in found]).tobytes() == numbers.tobytes()


def test_a_missing_number_is_empty_and_a_word_stays_itself():
    words = np.array(["solved", "refused"], dtype=object)
    _, rows = csv_blocks(["t", "outcome"], [[np.array([0.1, np.nan]), words]], LF)
    assert rows == b"0.1,solved\n,refused\n"


def test_columns_of_different_lengths_are_refused():
    with pytest.raises(ValueError, match="shorter"):
        list(csv_blocks(["t", "x"], [[np.zeros(2), np.zeros(1)]], LF))
