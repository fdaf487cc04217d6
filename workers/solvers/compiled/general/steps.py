r"""Power series of motions from any state, and steps of a fixed high order along them, by compiled code.

A potential's gradient is a list of operations on registers. Register n has a power series in the time,
:math:`u_n(t) = \sum_k u_{n,k} t^k`; the coefficients of order k of all registers follow from those of lower
orders and from the state's of order k (Moore 1966; Jorba & Zou 2005), and from these the equations give the
state's of order k + 1.

The radius of convergence ρ is read off the last two coefficients. A step is

.. math:: h = 0.98\, \rho\, \varepsilon^{1/(N+1)} ,

so that what is left out, a geometric series in h/ρ, is about ε of the largest variable. The states are summed
with what rounding has lost of them. Several motions go side by side, each by its own steps
(:mod:`compiled.lanes`).
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.lanes import (
    LANES,
    ROW,
    combine,
    first_row,
    larger,
    new_rows,
    number_at,
    place_of,
    put,
    put_number,
    size_of,
    spread,
    take,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
ADD, SUBTRACT, MULTIPLY, SCALE, DIVIDE, SHARE, NEGATE, POWER, EXP, LOG, SINE = range(11)
"""Operations, rows (operation, to, left, right). ``SCALE``: the left operand is a constant; ``SHARE`` and
``POWER``: the right one is. ``SINE`` puts the sine into ``to`` and the cosine into ``right``."""
STATE = 6
"""Registers of p, q, r, g1, g2, g3: the first ones. Those of the constants follow."""
ORDER = 24
COUNT = ORDER + 1
"""Rows of a register."""
ARRIVED, FAILED, TIRED, GOING = range(4)
"""How a run ends: at its end; by what is not finite, or a collapsed step; by its number of steps."""
STEP_SHARE = 0.98
FIRST_ROOM_STEPS = 64
"""Steps for which there is memory at first."""
INVISIBLE_SHARE = 2.0**-54
TIME_SPACING = 2.0**-50
"""Spacing of times, relative to the time: some ulp."""


@kernel
def _put_product(u: int, i: int, j: int, k: int, out: int, to: int) -> None:
    """Put the coefficients of order k of a product into a row; two sums do not wait for each other."""
    x, y = i * COUNT, j * COUNT
    m, n = 0, k
    first, second = spread(0.0), spread(0.0)
    if i == j:
        while m < n:
            first = first + take(u, x + m) * take(u, x + n)
            m += 1
            n -= 1
        second = first
    else:
        while m < n:
            first = first + take(u, x + m) * take(u, y + n)
            second = second + take(u, x + n) * take(u, y + m)
            m += 1
            n -= 1
    if m == n:
        first = first + take(u, x + m) * take(u, y + n)
    put(out, to, first + second)


@kernel
def _put_turn(u: int, k: int, out: int) -> None:
    """Put order k of qr, pr, pq, and of the three parts of γ × ω, into the first rows."""
    zero = spread(0.0)
    qr, pr, pq, first, second, third = zero, zero, zero, zero, zero, zero
    for m in range(k + 1):
        n = k - m
        p, q, r = take(u, m), take(u, COUNT + m), take(u, 2 * COUNT + m)
        g1, g2, g3 = take(u, 3 * COUNT + n), take(u, 4 * COUNT + n), take(u, 5 * COUNT + n)
        other = take(u, 2 * COUNT + n)
        qr = qr + q * other
        pr = pr + p * other
        pq = pq + p * take(u, COUNT + n)
        first = first + (r * g2 - q * g3)
        second = second + (p * g3 - r * g1)
        third = third + (q * g1 - p * g2)
    put(out, 0, qr)
    put(out, 1, pr)
    put(out, 2, pq)
    put(out, 3, first)
    put(out, 4, second)
    put(out, 5, third)


@kernel
def _transcendental(operation: int, u: int, to: int, i: int, j: int, k: int) -> None:
    """Fill in order k of a function f, by the differential equation that f(u(t)) satisfies."""
    x, y, z = i * COUNT, j * COUNT, to * COUNT
    if k == 0:
        for lane in range(LANES):
            value = number_at(u, x, lane)
            if operation == POWER:
                put_number(u, z, lane, math.pow(value, number_at(u, y, lane)))
            elif operation == EXP:
                put_number(u, z, lane, math.exp(value))
            elif operation == LOG:
                put_number(u, z, lane, math.log(value) if value > 0.0 else math.nan)
            else:
                put_number(u, z, lane, math.sin(value))
                put_number(u, y, lane, math.cos(value))
        return
    total, other = spread(0.0), spread(0.0)
    by = spread(float(k))
    if operation == POWER:
        exponent = take(u, y)
        for m in range(k):
            factor = exponent * spread(float(k - m)) - spread(float(m))
            total = total + factor * take(u, x + k - m) * take(u, z + m)
        put(u, z + k, total / (by * take(u, x)))
    elif operation == EXP:
        for m in range(1, k + 1):
            total = total + spread(float(m)) * take(u, x + m) * take(u, z + k - m)
        put(u, z + k, total / by)
    elif operation == LOG:
        for m in range(1, k):
            total = total + spread(float(m)) * take(u, z + m) * take(u, x + k - m)
        put(u, z + k, (take(u, x + k) - total / by) / take(u, x))
    else:
        for m in range(1, k + 1):
            rate = spread(float(m)) * take(u, x + m)
            total = total + rate * take(u, y + k - m)
            other = other + rate * take(u, z + k - m)
        put(u, z + k, total / by)
        put(u, y + k, spread(0.0) - other / by)


@kernel
def gradient_order(code: IntArray, u: int, k: int) -> None:
    """Fill in one order of all operations."""
    for n in range(code.shape[0]):
        operation, to, i, j = code[n, 0], code[n, 1], code[n, 2], code[n, 3]
        x, y, z = i * COUNT, j * COUNT, to * COUNT + k
        if operation == MULTIPLY:
            _put_product(u, i, j, k, u, z)
        elif operation == SCALE:
            put(u, z, take(u, x) * take(u, y + k))
        elif operation == ADD:
            put(u, z, take(u, x + k) + take(u, y + k))
        elif operation == SUBTRACT:
            put(u, z, take(u, x + k) - take(u, y + k))
        elif operation == DIVIDE:
            put(u, z, spread(0.0))
            _put_product(u, to, j, k, u, z)
            put(u, z, (take(u, x + k) - take(u, z)) / take(u, y))
        elif operation == SHARE:
            put(u, z, take(u, x + k) / take(u, y))
        elif operation == NEGATE:
            put(u, z, spread(0.0) - take(u, x + k))
        else:
            _transcendental(operation, u, to, i, j, k)


@kernel
def _put_pull(u: int, gradient: IntArray, i: int, j: int, k: int, out: int, to: int) -> None:
    """Put order k of g_i V_j − g_j V_i into a row; i and j count from 0. The row after it is used too."""
    for side in range(2):
        g, part = (3 + i, j) if side == 0 else (3 + j, i)
        if gradient[3 + part] == 1:
            put(out, to + side, take(u, g * COUNT + k) * take(u, gradient[part] * COUNT))
        else:
            _put_product(u, g, gradient[part], k, out, to + side)
    put(out, to, take(out, to) - take(out, to + 1))


@kernel
def take_series(code: IntArray, gradient: IntArray, moments: int, u: int, sums: int) -> None:
    """Fill in all orders of all registers ``u``, ORDER + 1 rows each, from the state's of order 0.

    ``gradient`` has the registers of V_1, V_2, V_3 and for each whether it is a constant (1) or not (0);
    ``moments`` are A, B, C, B − C, C − A, A − B, shape (6, LANES); ``sums`` is room for 8 rows.
    """
    for k in range(ORDER):
        gradient_order(code, u, k)
        _put_turn(u, k, sums)
        by = spread(1.0 / (k + 1))
        for a in range(3):
            _put_pull(u, gradient, (a + 1) % 3, (a + 2) % 3, k, sums, 6)
            turn = take(moments, 3 + a) * take(sums, a) + take(sums, 6)
            put(u, a * COUNT + k + 1, turn / take(moments, a) * by)
            put(u, (3 + a) * COUNT + k + 1, take(sums, 3 + a) * by)


def _conversion() -> FloatArray:
    r"""Return :math:`u^k = 2^{1-2k} \sum_j' \binom{2k}{k-j} T_j(2u - 1)` as rows of coefficients.

    All are positive with the sum 1: the conversion loses nothing.
    """
    return np.array(
        [
            [
                math.comb(2 * k, k - j) / 4**k * (1 if j == 0 else 2) if j <= k else 0.0
                for j in range(ORDER + 1)
            ]
            for k in range(ORDER + 1)
        ]
    )


CONVERSION = np.ascontiguousarray(_conversion().T)


@kernel
def _put_radii(u: int, few: int, radii: FloatArray, used: int) -> None:
    """Fill in radii of convergence; NaN if a coefficient is not finite, inf if the last ones vanish.

    What is not finite in a lower order is not finite in one of the last two: all orders are sums of products.
    """
    zero = spread(0.0)
    size, last, before, total = zero, zero, zero, zero
    for a in range(STATE):
        x, y, z = (
            size_of(take(u, a * COUNT)),
            size_of(take(u, a * COUNT + ORDER)),
            size_of(take(u, a * COUNT + ORDER - 1)),
        )
        size, last, before = larger(x, size), larger(y, last), larger(z, before)
        total = total + (x + y + z)
    put(few, 0, size)
    put(few, 1, last)
    put(few, 2, before)
    put(few, 3, total)
    for lane in range(used):
        radius, size_here = math.inf, number_at(few, 0, lane)
        if number_at(few, 1, lane) > 0.0:
            radius = math.pow(size_here / number_at(few, 1, lane), 1.0 / ORDER)
        if number_at(few, 2, lane) > 0.0:
            radius = min(radius, math.pow(size_here / number_at(few, 2, lane), 1.0 / (ORDER - 1)))
        radii[lane] = radius if number_at(few, 3, lane) < math.inf else math.nan


@kernel
def _advance(u: int, h: int, lost: int, work: int, sums: int) -> None:
    """Move the states by ``h``, and put Chebyshev series over [0, h] of all variables into ``sums``."""
    factor, step = spread(1.0), take(h, 0)
    for k in range(COUNT):
        for a in range(STATE):
            put(work, a * COUNT + k, take(u, a * COUNT + k) * factor)
        factor = factor * step
    table = place_of(CONVERSION)
    for a in range(STATE):
        combine(table, COUNT, COUNT, COUNT, 1, work + ROW * COUNT * a, sums + ROW * COUNT * a)
        gain = spread(0.0)
        for k in range(ORDER, 0, -1):
            gain = gain + take(work, a * COUNT + k)
        gain = gain + take(lost, a)
        old = take(u, a * COUNT)
        new = old + gain
        put(lost, a, gain - (new - old))
        put(u, a * COUNT, new)


@kernel
def seen(pieces: FloatArray) -> tuple[int, float]:
    """Return how many coefficients doubles can see in some column, without the last ones, and the largest."""
    room = new_rows(COUNT + 1)
    rows, sizes, largest = place_of(pieces), first_row(room), spread(0.0)
    for k in range(COUNT):
        value = spread(0.0)
        for n in range(len(pieces)):
            value = larger(size_of(take(rows, n * COUNT + k)), value)
        put(sizes, k, value)
        largest = larger(value, largest)
    put(sizes, COUNT, largest)
    length, most = 1, 0.0
    for a in range(STATE):
        tail, k, top = 0.0, ORDER, number_at(sizes, COUNT, a)
        most = max(most, top)
        while k >= length:
            tail += number_at(sizes, k, a)
            if tail > INVISIBLE_SHARE * top:
                length = k + 1
            k -= 1
    # Up to here the room has an owner.
    room[0, 0] = 0.0
    return length, most


@kernel
def _gradient_size(u: int, gradient: IntArray, lane: int) -> float:
    total = 0.0
    for part in range(3):
        total += number_at(u, gradient[part] * COUNT, lane) ** 2
    return math.sqrt(total)


@kernel
def new_pieces(motions: int) -> FloatArray:
    """Return room for the series of some motions."""
    return np.empty((motions, FIRST_ROOM_STEPS, COUNT, LANES))


@kernel
def take_steps(
    code: IntArray,
    gradient: IntArray,
    constants: FloatArray,
    moments: FloatArray,
    registers: int,
    states: FloatArray,
    ends: FloatArray,
    tolerances: FloatArray,
    max_steps: int,
    longest: float,
    collapsed: float,
    pieces: FloatArray,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
    """Integrate from states at 0 to ``ends``; return how that ends, numbers of steps, breaks, series.

    Every motion has a column of ``states``, ``constants`` and ``moments``; there are at most ``LANES``. The
    shapes found are (motions,), (motions,), (motions, room + 1) and (motions, room, ORDER + 1, LANES): the
    Chebyshev series of the six variables side by side, and two columns of 0. ``pieces`` is room for these,
    and is made larger where needed. No step is longer than ``longest``; one that is shorter than
    ``collapsed`` of the longest one ends a run, as do numbers that are not finite. The last are the sizes of
    the potential's gradient at the beginning and at the end, shape (motions, 2), NaN where it has none.
    """
    used = len(ends)
    # One room for all rows, with their places in it.
    room = new_rows(registers * COUNT + 2 * STATE * COUNT + 2 * STATE + 9)
    u = first_row(room)
    work = u + ROW * registers * COUNT
    sums = work + ROW * STATE * COUNT
    lost = sums + ROW * STATE * COUNT
    bodies = lost + ROW * STATE
    step_row = bodies + ROW * STATE
    few = step_row + ROW
    for lane in range(LANES):
        # Lanes without a motion follow the first.
        own = lane if lane < used else 0
        for n in range(len(constants)):
            put_number(u, (STATE + n) * COUNT, lane, constants[n, own])
        for a in range(STATE):
            put_number(u, a * COUNT, lane, states[a, own])
            put_number(bodies, a, lane, moments[a, own])
    radii = np.empty(LANES)
    breaks = np.zeros((used, pieces.shape[1] + 1))
    shares, longest_taken, times, following = np.empty(used), np.zeros(used), np.zeros(used), np.zeros(used)
    counts, statuses = np.zeros(used, dtype=np.int64), np.full(used, GOING)
    is_finite = np.ones(used, dtype=np.bool_)
    for lane in range(used):
        shares[lane] = STEP_SHARE * math.pow(tolerances[lane], 1.0 / (ORDER + 1.0))
        if ends[lane] == 0.0:
            statuses[lane] = ARRIVED
    sizes = np.empty((used, 2))
    gradient_order(code, u, 0)
    for lane in range(used):
        sizes[lane, 0] = _gradient_size(u, gradient, lane)
    left_over = True
    while left_over:
        take_series(code, gradient, bodies, u, few)
        _put_radii(u, few, radii, used)
        left_over = False
        for lane in range(used):
            put_number(step_row, 0, lane, 0.0)
            if statuses[lane] != GOING:
                continue
            if counts[lane] >= max_steps:
                statuses[lane] = TIRED
                continue
            time, end, step = times[lane], ends[lane], shares[lane] * radii[lane]
            left = abs(end - time)
            at_end = left <= longest and left <= step
            limit = min(left, longest)
            if not step >= 0.0:
                statuses[lane] = FAILED
                continue
            is_cut = limit <= step
            step = min(step, limit)
            longest_taken[lane] = max(longest_taken[lane], step)
            if not is_cut and not step > max(collapsed * longest_taken[lane], TIME_SPACING * abs(time)):
                statuses[lane] = FAILED
                continue
            following[lane] = end if at_end else time + math.copysign(step, end)
            put_number(step_row, 0, lane, following[lane] - time)
            left_over = True
        if not left_over:
            break
        _advance(u, step_row, lost, work, sums)
        for lane in range(used):
            if statuses[lane] != GOING:
                continue
            total = 0.0
            for a in range(STATE):
                total += abs(number_at(u, a * COUNT, lane))
            is_finite[lane] = total < math.inf
            if not is_finite[lane]:
                statuses[lane] = FAILED
                continue
            count = counts[lane]
            if count == pieces.shape[1]:
                more, wider = np.zeros((used, 2 * count + 1)), np.empty((used, 2 * count, COUNT, LANES))
                more[:, : count + 1] = breaks
                wider[:, :count] = pieces[:used]
                breaks, pieces = more, wider
            for k in range(COUNT):
                for a in range(STATE):
                    pieces[lane, count, k, a] = number_at(sums, a * COUNT + k, lane)
                for a in range(STATE, LANES):
                    pieces[lane, count, k, a] = 0.0
            counts[lane] = count + 1
            times[lane] = following[lane]
            breaks[lane, count + 1] = times[lane]
            if times[lane] == ends[lane]:
                statuses[lane] = ARRIVED
    gradient_order(code, u, 0)
    for lane in range(used):
        sizes[lane, 1] = _gradient_size(u, gradient, lane) if is_finite[lane] else math.nan
        if counts[lane] > 0 and statuses[lane] != TIRED and is_finite[lane] and not sizes[lane, 1] < math.inf:
            # Where the potential is hardly less than smooth, a step can end beyond its domain.
            statuses[lane], counts[lane], sizes[lane, 1] = FAILED, counts[lane] - 1, math.nan
    # Up to here the room has an owner.
    room[0, 0] = 0.0
    return statuses, counts, breaks, pieces, sizes
