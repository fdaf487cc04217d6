r"""Taylor coefficients of the six variables along motions, order by order, by compiled code.

A potential's gradient is a list of operations on registers. Register n has a power series in the time,
:math:`u_n(t) = \sum_k u_{n,k} t^k`; the coefficients of order k of all registers follow from those of lower
orders and from the state's of order k (Moore 1966; Jorba & Zou 2005), and from these the equations give the
state's of order k + 1. Every lane is a motion of its own (:mod:`compiled.lanes`).
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.lanes import LANES, number_at, put, put_number, spread, take

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
