"""What is JSON, and what is not."""

import json
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.schemas.problem.potentials import read_angle
from service.schemas.problem.problem import read_problem
from service.schemas.reading.documents import (
    MAX_INTEGER_CHARACTERS,
    InvalidJsonError,
    InvalidProblemError,
    parse_json,
)

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


PROBLEM = """{
  "body": {"A": <A>, "B": "3/2", "C": 1},
  "potential": {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": <a>, "b": "1/20"}},
  "motion": {"type": "planar", "lambda": <lambda>},
  "time": {"start": <start>, "stop": 10, "samples": <samples>},
  "accuracy": {"tolerance": <tolerance>}
}"""
GOOD = {"A": "2", "a": "-1", "lambda": "1", "start": "0", "samples": "3", "tolerance": "1e-9"}
BEYOND_DOUBLES = (
    "1e-400",
    "-1e-400",
    "1E-324",
    "1e-9999999",
    f"0.{'0' * 330}1",
    "1e400",
    "-1.5e309",
    "1e999999",
)


def faults_of(**numbers):
    content = re.sub(r"<(\w+)>", lambda found: (GOOD | numbers)[found[1]], PROBLEM)
    with pytest.raises(InvalidProblemError) as caught:
        read_problem(parse_json(content.encode()))
    return caught.value.faults


@pytest.mark.parametrize("name", GOOD)
@pytest.mark.parametrize("number", BEYOND_DOUBLES)
def test_a_number_that_no_double_is_near_is_refused_as_its_text_is(name, number):
    assert faults_of(**{name: number}) == faults_of(**{name: f'"{number}"'})


@pytest.mark.parametrize("number", ["0.0", "-0", "0e-400", "0.000E999", "0." + "0" * 400])
def test_a_zero_is_a_zero_however_it_is_written(number):
    assert parse_json(number.encode()) == 0
    assert type(parse_json(number.encode())) in (int, float)


def test_an_angle_has_the_limits_of_numbers_whether_it_is_text_or_not():
    for content in (b"1e-400", b'"1e-400"', b"1e-310", b'"1e-310"'):
        with pytest.raises(ValueError, match="1e-300 to 1e300"):
            read_angle(parse_json(content))
