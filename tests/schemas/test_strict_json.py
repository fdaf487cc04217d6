"""What is JSON, and what is not."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.schemas.strict_json import MAX_INTEGER_CHARACTERS, InvalidJsonError, parse_json

SCALARS = (
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text()
)
DOCUMENTS = st.recursive(
    SCALARS, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=20
)


@given(DOCUMENTS)
def test_every_document_is_read_back(document):
    assert parse_json(json.dumps(document).encode()) == document
    assert parse_json(json.dumps(document, ensure_ascii=False).encode()) == document


@pytest.mark.parametrize("content", [b"NaN", b"[Infinity]", b'{"a": -Infinity}'])
def test_numbers_that_are_none_are_refused(content):
    with pytest.raises(InvalidJsonError, match="finite numbers are accepted"):
        parse_json(content)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "line 1, column 1"),
        (b'{"a": 1,\n  "b": }', "line 2, column 8"),
        (b'{"a": 1} 2', "Extra data"),
        (b'"\xff"', "byte 2 is not UTF-8"),
        (b'"\\ud800"', "no character"),
        (b'{"\\udfff": 1}', "no character"),
        (b'{"a": 1, "b": 2, "a": 1}', "'a' is given twice"),
        (b"[" * 100_000, "too deep"),
        (b"1" * (MAX_INTEGER_CHARACTERS + 1), "at most 1000 are accepted"),
    ],
)
def test_the_reason_says_where(content, reason):
    with pytest.raises(InvalidJsonError, match=reason):
        parse_json(content)


def test_a_pair_of_surrogates_is_a_character():
    assert parse_json(b'"\\ud83d\\ude80"') == "\N{ROCKET}"


def test_a_byte_order_mark_is_ignored():
    assert parse_json(b"\xef\xbb\xbf[1]") == [1]
