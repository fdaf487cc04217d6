"""What compiled code may rely on: division by zero is no error, and sums keep their order."""

import math

import numpy as np

from workers.solvers.compiled.kernels import inlined, kernel


@kernel
def quotient(x: float, y: float) -> float:
    return x / y


@inlined
def twice(x: float) -> float:
    return 2.0 * x


@kernel
def total(values: np.ndarray) -> float:
    found = 0.0
    for k in range(len(values)):
        found += twice(values[k])
    return found


def test_division_by_zero_gives_infinity_or_nan():
    assert quotient(1.0, 0.0) == math.inf
    assert quotient(-1.0, 0.0) == -math.inf
    assert math.isnan(quotient(0.0, 0.0))


def test_sums_keep_their_order():
    # In another order, as a compiler that may reorder takes, the small ones do not vanish.
    values = np.array([1e16] + [1.0, -1.0, 0.25] * 8 + [-1e16])
    expected = 0.0
    for value in values:
        expected += 2.0 * value
    assert total(values) == expected
    assert total(values) != 2.0 * math.fsum(values)
