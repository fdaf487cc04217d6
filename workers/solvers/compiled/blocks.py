"""Sums without loss, and times sorted by the panel they are in, so that a kernel works on many at once."""

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.kernels import inlined, kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
UnsignedArray = NDArray[np.uint64]

BLOCK = 1024
"""Times that are worked on together."""
STRIDE = BLOCK + 8
"""Between rows of a workspace in one dimension. Rows at a distance that the compiler knows cannot overlap,
else it would go through them one by one; at a power of two they would all be in the same lines of the
cache."""


@inlined
def two_sum(a: float, b: float) -> tuple[float, float]:
    """Return a + b rounded, and what that leaves out (Knuth)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@kernel
def sort_by_interval(
    starts: FloatArray, local: FloatArray, home: IntArray, begins: UnsignedArray, order: IntArray
) -> None:
    """Fill in where each interval's times begin, and the times' numbers in that order.

    The intervals begin at ``starts``; what is before all of them belongs to the first.
    """
    number = len(starts)
    begins[:] = 0
    for k in range(len(local)):
        # Bisection for the last one that has begun.
        low, width = 0, number
        while width > 1:
            half = width // 2
            low += half if starts[low + half] <= local[k] else 0
            width -= half
        home[k] = low
        begins[low + 1] += 1
    for n in range(number):
        begins[n + 1] += begins[n]
    for k in range(len(local)):
        order[begins[home[k]]] = k
        begins[home[k]] += 1
    for n in range(number, 0, -1):
        begins[n] = begins[n - 1]
    begins[0] = 0
