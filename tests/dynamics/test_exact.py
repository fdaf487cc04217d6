from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.dynamics.errors import InvalidNumberError
from service.dynamics.exact import MAX_DIGITS, MAX_INTEGER_DIGITS, exact_number, exact_text


@given(st.fractions())
def test_what_is_written_reads_back(value: Fraction) -> None:
    assert exact_number(exact_text(value)) == value


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_float_stands_for_its_shortest_decimal(value: float) -> None:
    exact = exact_number(value)
    assert float(exact) == value
    assert exact == Fraction(repr(value))


@given(st.integers(-(10**60), 10**60), st.integers(-60, 60))
def test_decimals_with_exponents_are_exact(digits: int, exponent: int) -> None:
    assert exact_number(f"{digits}e{exponent}") == Fraction(digits) * Fraction(10) ** exponent


@given(st.text(max_size=500))
def test_any_text_is_a_number_or_refused(text: str) -> None:
    try:
        exact = exact_number(text)
    except InvalidNumberError:
        return
    assert isinstance(exact, Fraction)


@pytest.mark.parametrize(
    ("written", "value"),
    [
        ("17/10", Fraction(17, 10)),
        ("-4/6", Fraction(-2, 3)),
        ("0.1", Fraction(1, 10)),
        (" +1.50 ", Fraction(3, 2)),
        (".5", Fraction(1, 2)),
        ("5.", Fraction(5)),
        ("1E-12", Fraction(1, 10**12)),
        (-3, Fraction(-3)),
        (0.1, Fraction(1, 10)),
        (1e22, Fraction(10**22)),
        (np.float64(0.1), Fraction(1, 10)),
        (Fraction(1, 3), Fraction(1, 3)),
    ],
)
def test_accepted_ways_to_write_a_number(written: int | float | str | Fraction, value: Fraction) -> None:
    assert exact_number(written) == value


@pytest.mark.parametrize(
    "written",
    [
        "",
        " ",
        "nan",
        "inf",
        "1/0",
        "1 / 2",
        "1/2/3",
        "1.5/2",
        "--1",
        "1_000",
        "0x10",
        "1e",
        "1e401",
        "1e-401",
        "1e99999",
        "٣",
        "1,5",
        "1\n2",
        "0." + "9" * (MAX_DIGITS + 9),
        "9" * (MAX_INTEGER_DIGITS + 1),
        "1/" + "9" * (MAX_INTEGER_DIGITS + 1),
        "1" * 10_000,
        10**MAX_INTEGER_DIGITS,
        -(10 ** (3 * MAX_DIGITS)),
        float("nan"),
        float("inf"),
        float("-inf"),
        True,
        False,
    ],
)
def test_what_is_no_number_is_refused(written: int | float | str) -> None:
    with pytest.raises(InvalidNumberError) as caught:
        exact_number(written)
    assert caught.value.code == "invalid_number"
    assert len(caught.value.message) < 200


@pytest.mark.parametrize(
    "written",
    [
        "9" * MAX_DIGITS + "e400",
        "." + "9" * MAX_DIGITS + "e-400",
        "-1.23456789e-400",
        "9" * MAX_INTEGER_DIGITS,
        "1/" + "9" * MAX_INTEGER_DIGITS,
        "9" * (MAX_INTEGER_DIGITS - 1) + "7/" + "9" * MAX_INTEGER_DIGITS,
    ],
)
def test_the_largest_and_smallest_numbers_read_back_too(written: str) -> None:
    value = exact_number(written)
    assert exact_number(exact_text(value)) == value


def test_an_integer_too_long_to_be_written_is_refused_all_the_same() -> None:
    with pytest.raises(InvalidNumberError, match="bits"):
        exact_number(10**5000)
