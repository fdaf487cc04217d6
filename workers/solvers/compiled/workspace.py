"""The workspace of a solver: places of the loop, times and discs that are gone through together.

They lie in records that Python has made once (:mod:`compiled.records` says why). Times are sorted by the
panel they are in, so that a kernel works on many at once.
"""

import threading

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import ARC, CUT, MAX_ARCS, MAX_PANELS, Records, new_records, rows

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
UnsignedArray = NDArray[np.uint64]
BLOCK = 1024
"""Times that are worked on together."""
STRIDE = BLOCK + 8
"""Between rows of a workspace in one dimension. Rows at a distance that the compiler knows cannot overlap,
else it would go through them one by one; at a power of two they would all be in the same lines of the
cache."""
POINTS = 80
"""Places that are gone through together while a motion is solved."""
LANES = 32
"""Discs that are worked on together. Plain arithmetic goes through all of them, also those that nobody asks
for: the compiler then knows how many there are."""
_OF_THREAD = threading.local()


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


class Places:
    """Places of the loop that are gone through together."""

    sine: FloatArray
    cosine: FloatArray
    """Sine and cosine of v."""
    below: FloatArray
    above: FloatArray
    """v − v₋ and v₊ − v."""
    speed: FloatArray
    """|dv/du|."""
    g1: FloatArray
    g2: FloatArray
    g3: FloatArray
    c: FloatArray
    """Primed, and c = g2/cos v."""
    radicand: FloatArray
    bound: FloatArray
    """P, and the bound of its rounding."""
    rate: FloatArray
    """dt/du."""
    noise: FloatArray
    """Bound of the relative rounding of dt/du."""


class Moments:
    """Times that are gone through together, and the places at them."""

    time: FloatArray
    """Since the start of the panel."""
    sense: FloatArray
    phase: FloatArray
    floor: FloatArray
    ceiling: FloatArray
    """x and its bracket."""
    is_found: FloatArray
    slope: FloatArray
    """dt/dx."""
    width: FloatArray
    """Width of the panel, in u."""
    sine: FloatArray
    cosine: FloatArray
    speed: FloatArray
    g1: FloatArray
    g2: FloatArray
    g3: FloatArray
    c: FloatArray
    """As those of places."""
    p: FloatArray
    r: FloatArray
    """Primed.

    The rows are at distances that the compiler knows: else it would go through them one by one.
    """


class DiscWorkspace:
    """Discs around places of the loop."""

    s_centre: FloatArray
    s_radius: FloatArray
    c_centre: FloatArray
    c_radius: FloatArray
    """|sin v| and cos v, as discs."""
    t_radius: FloatArray
    """Radius of both squares."""
    sign: FloatArray
    """Sign of sin v."""
    square: FloatArray
    square_radius: FloatArray
    """c² as a disc."""


class Workspace:
    """All that a solver works on."""

    places: Places
    moments: Moments
    discs: DiscWorkspace
    arcs: Records
    waiting: Records
    coarse: Records


PLACES, MOMENTS, DISC_WORKSPACE = rows(Places, POINTS), rows(Moments, STRIDE), rows(DiscWorkspace, LANES)
WORKSPACE = np.dtype(
    (
        np.record,
        [
            ("places", PLACES),
            ("moments", MOMENTS),
            ("discs", DISC_WORKSPACE),
            ("arcs", ARC, MAX_ARCS),
            ("waiting", CUT, MAX_PANELS),
            ("coarse", CUT, MAX_PANELS),
        ],
    ),
    align=True,
)


def own_workspace() -> Records:
    """Return the workspace of this thread, shape (1,), with whatever was left on it.

    It is so large that the system hands it out page by page: a new one takes longer than many a motion.
    """
    found: Records | None = getattr(_OF_THREAD, "workspace", None)
    if found is None:
        found = _OF_THREAD.workspace = new_records(WORKSPACE)
    return found
