"""Arithmetic of discs: what is sampled of the operands lies in the disc of the result."""

import numpy as np
import pytest

from workers.solvers.compiled.discs.rows import (
    SCALE,
    add,
    collapse,
    divide,
    function,
    multiply,
    new_discs,
    number,
    raise_to,
    run_rows,
    scale_power,
    subtract,
)
from workers.solvers.compiled.evaluation.interpreter import Constant
from workers.solvers.compiled.evaluation.program import POWER
from workers.solvers.compiled.workspace import LANES

ONE, OTHER, UNIT_ROW, RESULT = range(4)
NONE = np.empty(0)
UNIT = np.exp(2j * np.pi * np.arange(12) / 12)


@pytest.fixture
def rows():
    draws = np.random.default_rng(4)
    rows = c, r, e = new_discs(5)
    c[SCALE], r[SCALE], e[SCALE] = draws.uniform(0.3, 0.9, LANES), draws.uniform(0.0, 0.1, LANES), 1.0
    for row in (ONE, OTHER):
        c[row] = draws.uniform(0.5, 2.0, LANES)
        r[row] = draws.uniform(0.0, 0.3, LANES)
    c[OTHER, ::2] *= -1.0
    e[ONE], e[OTHER] = 2.0, 0.5
    number(rows, UNIT_ROW, Constant(NONE, NONE, -1, 1), LANES)
    return rows


def points(rows, row):
    """Return places in the discs of a row, its power of the scale beside them, shape (12, LANES)."""
    c, r, _ = rows
    return c[row] + r[row] * UNIT[:, None]


def holds(rows, row, values):
    c, r, _ = rows
    # The reference has roundings of its own.
    return bool((np.abs(values - c[row]) <= r[row] + 1e-14 * (np.abs(values) + 1.0)).all())


def test_products_and_quotients(rows):
    multiply(rows, RESULT, ONE, OTHER, LANES)
    assert rows.powers[RESULT] == 2.5
    assert holds(rows, RESULT, points(rows, ONE) * points(rows, OTHER))
    divide(rows, RESULT, UNIT_ROW, OTHER, LANES)
    assert rows.powers[RESULT] == -0.5
    assert holds(rows, RESULT, 1.0 / points(rows, OTHER))


@pytest.mark.parametrize(("combine", "sign"), [(add, 1.0), (subtract, -1.0)])
def test_sums_are_beside_the_lower_power(rows, combine, sign):
    one, other, scale = points(rows, ONE), points(rows, OTHER), points(rows, SCALE)
    combine(rows, RESULT, ONE, OTHER, LANES)
    assert rows.powers[RESULT] == 0.5
    assert holds(rows, RESULT, one * scale**1.5 + sign * other)


@pytest.mark.parametrize("exponent", [1.0, 2.0, 3.0, -1.0, 0.5, -1.5, 4.5])
def test_powers(rows, exponent):
    code = np.array([[POWER, ONE, 0, 0]])
    run_rows(code, np.array([exponent]), NONE, rows, LANES)
    # The result of the first instruction.
    assert rows.powers[3] == 2.0 * exponent
    assert holds(rows, 3, points(rows, ONE) ** exponent)
    raise_to(rows, RESULT, ONE, Constant(np.array([exponent]), NONE, 0, 0), LANES)
    assert holds(rows, RESULT, points(rows, ONE) ** exponent)
    row = scale_power(rows, abs(exponent), LANES)
    assert holds(rows, row, points(rows, SCALE) ** abs(exponent))


def test_the_scale_is_multiplied_in(rows):
    expected = points(rows, ONE) * points(rows, SCALE) ** 2.0
    collapse(rows, RESULT, ONE, LANES)
    assert rows.powers[RESULT] == 0.0
    assert holds(rows, RESULT, expected)


@pytest.mark.parametrize(("operation", "known"), [(8, np.exp), (10, np.sin), (11, np.cos), (12, np.tan)])
def test_functions(rows, operation, known):
    c, r, _ = rows
    expected = points(rows, ONE) * points(rows, SCALE) ** 2.0
    function(rows, RESULT, ONE, operation, LANES)
    finite = np.isfinite(r[RESULT])
    assert finite.sum() > LANES // 2
    values = known(expected)
    assert (np.abs(values - c[RESULT]) <= r[RESULT] + 1e-14 * (np.abs(values) + 1.0))[:, finite].all()


def test_what_is_not_analytic_is_not_known(rows):
    rows.radii[OTHER] = 3.0
    divide(rows, RESULT, UNIT_ROW, OTHER, LANES)
    assert np.isnan(rows.radii[RESULT]).all()
