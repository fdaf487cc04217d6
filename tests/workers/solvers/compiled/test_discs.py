"""Arithmetic of discs: what is sampled of the operands lies in the disc of the result."""

import numpy as np
import pytest

from workers.solvers.compiled.discs import derivatives
from workers.solvers.compiled.discs.arithmetic import (
    FIRST_FREE,
    POWERS,
    add,
    collapse,
    function,
    invert,
    multiply,
    new_rows,
    raise_to,
    scale_power,
)
from workers.solvers.compiled.workspace import LANES

ONE, OTHER, RESULT = (FIRST_FREE + k for k in range(3))
UNIT = np.exp(2j * np.pi * np.arange(12) / 12)


@pytest.fixture
def rows():
    draws = np.random.default_rng(4)
    c, r, e = new_rows(3)
    c[0], r[0], e[0] = draws.uniform(0.3, 0.9, LANES), draws.uniform(0.0, 0.1, LANES), 1.0
    for row in (ONE, OTHER):
        c[row] = draws.uniform(0.5, 2.0, LANES)
        r[row] = draws.uniform(0.0, 0.3, LANES)
    c[OTHER, ::2] *= -1.0
    e[ONE], e[OTHER] = 2.0, 0.5
    return c, r, e


def points(rows, row):
    """Return places in the discs of a row, its power of the scale beside them, shape (12, LANES)."""
    c, r, _ = rows
    return c[row] + r[row] * UNIT[:, None]


def holds(rows, row, values):
    c, r, _ = rows
    # The reference has roundings of its own.
    return bool((np.abs(values - c[row]) <= r[row] + 1e-14 * (np.abs(values) + 1.0)).all())


def test_products_and_inverses(rows):
    c, r, e = rows
    multiply(c, r, e, RESULT, ONE, OTHER)
    assert e[RESULT] == 2.5
    assert holds(rows, RESULT, points(rows, ONE) * points(rows, OTHER))
    invert(c, r, e, RESULT, OTHER)
    assert e[RESULT] == -0.5
    assert holds(rows, RESULT, 1.0 / points(rows, OTHER))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_sums_are_beside_the_lower_power(rows, sign):
    c, r, e = rows
    one, other, scale = points(rows, ONE), points(rows, OTHER), points(rows, 0)
    add(c, r, e, RESULT, ONE, OTHER, sign, LANES)
    assert e[RESULT] == 0.5
    assert holds(rows, RESULT, one * scale**1.5 + sign * other)


@pytest.mark.parametrize("exponent", [1.0, 2.0, 3.0, -1.0, 0.5, -1.5, 4.5])
def test_powers(rows, exponent):
    c, r, e = rows
    raise_to(c, r, e, RESULT, ONE, exponent, LANES)
    assert e[RESULT] == 2.0 * exponent
    assert holds(rows, RESULT, points(rows, ONE) ** exponent)
    row = scale_power(c, r, e, abs(exponent), LANES)
    assert holds(rows, row, points(rows, 0) ** abs(exponent))


def test_the_scale_is_multiplied_in(rows):
    c, r, e = rows
    expected = points(rows, ONE) * points(rows, 0) ** 2.0
    collapse(c, r, e, RESULT, ONE, LANES)
    assert e[RESULT] == 0.0
    assert holds(rows, RESULT, expected)


@pytest.mark.parametrize(("operation", "known"), [(8, np.exp), (10, np.sin), (11, np.cos), (12, np.tan)])
def test_functions(rows, operation, known):
    c, r, e = rows
    expected = points(rows, ONE) * points(rows, 0) ** 2.0
    function(operation, c, r, e, RESULT, ONE, LANES)
    finite = np.isfinite(r[RESULT])
    assert finite.sum() > LANES // 2
    values = known(expected)
    assert (np.abs(values - c[RESULT]) <= r[RESULT] + 1e-14 * (np.abs(values) + 1.0))[:, finite].all()


def test_what_is_not_analytic_is_not_known(rows):
    c, r, e = rows
    r[OTHER] = 3.0
    invert(c, r, e, RESULT, OTHER)
    assert np.isnan(r[RESULT]).all()


def test_scratch_of_both_modules_is_apart():
    assert derivatives.INVERSE not in (FIRST_FREE - 1, FIRST_FREE - 2)
    assert POWERS < derivatives.INVERSE < FIRST_FREE
