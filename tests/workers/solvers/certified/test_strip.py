"""Series on a strip against complex balls in it, and what they refuse."""

from fractions import Fraction

import numpy as np
import pytest
from flint import acb, arb, ctx
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests.support.effort import examples
from workers.solvers.certified.strip_functions import Series, Strip

HEIGHT = 0.5
KINDS = pytest.mark.parametrize("is_even", [True, False])


def series(strip: Strip, *coefficients: float) -> Series:
    """Return a_0 + a_1 cos θ + …, or for functions that are not even a_0 + a_1 cos(θ + 1) + …."""
    phase = 1.0 if strip.is_even else np.exp(1j)
    upper = np.array([0.5 * a * phase**k for k, a in enumerate(coefficients) if k])
    middle = np.array([coefficients[0]])
    return strip.series(np.concatenate((upper[::-1].conj(), middle, upper)), 0.0)


def value(found: Series, theta: acb) -> acb:
    """Return the ball of the series at a place in the strip: the rest bounds what is left there."""
    reach = len(found.coefficients) // 2
    total = sum(
        (acb(complex(c).real, complex(c).imag) * (acb(0, 1) * k * theta).exp())
        for k, c in enumerate(found.coefficients, start=-reach)
    )
    return total + acb(arb(0, found.rest), arb(0, found.rest))


def places() -> list[acb]:
    return [acb(x, y) for x in (0.0, 0.7, 2.0, 3.14, 4.4) for y in (HEIGHT, 0.2, 0.0, -HEIGHT)]


FUNCTIONS = {
    "1/f": (lambda strip, f: strip.inverse(f), lambda f: 1 / f),
    "f/f²": (lambda strip, f: strip.divide(f, f * f), lambda f: 1 / f),
    "f^(1/2)": (lambda strip, f: strip.power(f, Fraction(1, 2)), lambda f: f.sqrt()),
    "f^(7/10)": (lambda strip, f: strip.power(f, Fraction(7, 10)), lambda f: f ** acb("0.7")),
    "f^(-5/3)": (lambda strip, f: strip.power(f, Fraction(-5, 3)), lambda f: f ** (acb(-5) / 3)),
    "f^(71/70)": (lambda strip, f: strip.power(f, Fraction(71, 70)), lambda f: f ** (acb(71) / 70)),
    "f^-3": (lambda strip, f: strip.power(f, Fraction(-3)), lambda f: f**-3),
    "f^f": (lambda strip, f: strip.general_power(f, f), lambda f: f**f),
    "exp": (lambda strip, f: strip.call("exp", f), lambda f: f.exp()),
    "log": (lambda strip, f: strip.call("log", f), lambda f: f.log()),
    "sin": (lambda strip, f: strip.call("sin", f), lambda f: f.sin()),
    "cos": (lambda strip, f: strip.call("cos", f), lambda f: f.cos()),
    "tan": (lambda strip, f: strip.call("tan", strip.scaled(f, 0.125)), lambda f: (f / 8).tan()),
    "|-f|": (lambda strip, f: strip.call("abs", strip.negate(f)), lambda f: f),
    "1 + f + … + f^10": (lambda strip, f: strip.geometric(f, 11), lambda f: (f**11 - 1) / (f - 1)),
}


@pytest.mark.one_in(4)
@KINDS
@pytest.mark.parametrize("name", FUNCTIONS)
@given(st.floats(4.0, 6.0), st.floats(-1.0, 1.0), st.floats(-0.5, 0.5))
@settings(max_examples=examples(3, 10), deadline=None)
def test_a_series_encloses_its_function_all_over_the_strip(name, is_even, a, b, c):
    strip = Strip(HEIGHT, 48, is_even=is_even)
    by_series, by_balls = FUNCTIONS[name]
    with ctx.workprec(200), np.errstate(all="ignore"):
        argument = series(strip, a, b, c)
        found = by_series(strip, argument)
        assert found.is_known
        for theta in places():
            true = by_balls(value(argument, theta))
            assert value(found, theta).overlaps(true)
            assert bool(abs(true).lower() <= found.norm)
        # Not by being wide: ten digits are left of the doubles, exp being as large as e^8.
        assert found.rest < 1e-6 * found.norm


@KINDS
@given(
    st.lists(st.floats(-2.0, 2.0), min_size=1, max_size=9),
    st.lists(st.floats(-2.0, 2.0), min_size=1, max_size=9),
)
@example([1.5e-193], [1.5e-193])  # the product is below all doubles
@settings(max_examples=examples(6, 40), deadline=None)
def test_sums_and_products_enclose_theirs_where_they_are_cut(is_even, first, second):
    # The degree is less than that of the product: what is cut off is in the rest.
    strip = Strip(HEIGHT, 8, is_even=is_even)
    f, g = series(strip, *first), series(strip, *second)
    with ctx.workprec(200):
        for theta in places():
            x, y = value(f, theta), value(g, theta)
            assert value(f + g, theta).overlaps(x + y)
            assert value(f - g, theta).overlaps(x - y)
            assert value(f * g * f, theta).overlaps(x * y * x)
            assert bool(abs(x * y).lower() <= (f * g).norm)


@KINDS
@pytest.mark.parametrize(
    ("name", "middle"),
    [
        # cos θ = −1.05 has Im θ = 0.315.
        ("1/f", 1.05),
        ("f^(1/2)", 1.05),
        ("log", 1.05),
        ("f^(-5/3)", 1.05),
        # Zeros on the real axis, and a negative function.
        ("1/f", 0.5),
        ("f^(7/10)", 0.5),
        ("|-f|", 0.5),
        ("f^(1/2)", -4.0),
        ("log", -4.0),
        ("f^f", -4.0),
    ],
)
def test_what_is_not_holomorphic_on_the_strip_stays_unknown(name, middle, is_even):
    strip = Strip(HEIGHT, 48, is_even=is_even)
    with np.errstate(all="ignore"):
        assert not FUNCTIONS[name][0](strip, series(strip, middle, 1.0)).is_known


def test_the_unknown_spreads():
    strip = Strip(HEIGHT, 8, is_even=True)
    one = strip.constant(Fraction(1))
    with np.errstate(all="ignore"):
        for found in (
            one + strip.unknown,
            strip.unknown - one,
            one * strip.unknown,
            strip.negate(strip.unknown),
            strip.inverse(strip.unknown),
            strip.call("sin", strip.unknown),
            strip.power(strip.unknown, Fraction(1, 3)),
        ):
            assert not found.is_known
