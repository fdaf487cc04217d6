r"""Taylor coefficients of the six variables along a motion, order by order, by compiled code.

A potential's gradient is a list of operations on registers. Register n has a power series in the time,
:math:`u_n(t) = \sum_k u_{n,k} t^k`; the coefficients of order k of all registers follow from those of lower
orders and from the state's of order k (Moore 1966; Jorba & Zou 2005), and from these the equations give the
state's of order k + 1.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.kernels import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ADD, SUBTRACT, MULTIPLY, SCALE, DIVIDE, SHARE, NEGATE, POWER, EXP, LOG, SINE = range(11)
"""Operations, rows (operation, to, left, right). ``SCALE``: the left operand is a constant; ``SHARE`` and
``POWER``: the right one is. ``SINE`` puts the sine into ``to`` and the cosine into ``right``."""
STATE = 6
"""Registers of p, q, r, g1, g2, g3: the first ones. Those of the constants follow."""
ORDER = 24


@kernel
def _product(u: FloatArray, i: int, j: int, k: int) -> float:
    """Return the coefficient of order k of a product.

    Four sums do not wait for one another, and places that cannot be negative are not looked at for that.
    """
    x, y = u[np.uint64(i)], u[np.uint64(j)]
    first, second, third, fourth = 0.0, 0.0, 0.0, 0.0
    m, n = 0, k
    while n >= m + 3:
        first += x[np.uint64(m)] * y[np.uint64(n)]
        second += x[np.uint64(n)] * y[np.uint64(m)]
        third += x[np.uint64(m + 1)] * y[np.uint64(n - 1)]
        fourth += x[np.uint64(n - 1)] * y[np.uint64(m + 1)]
        m += 2
        n -= 2
    while m <= n:
        first += x[np.uint64(m)] * y[np.uint64(n)]
        if m < n:
            second += x[np.uint64(n)] * y[np.uint64(m)]
        m += 1
        n -= 1
    return (first + second) + (third + fourth)


@kernel
def _transcendental(operation: int, u: FloatArray, to: int, i: int, j: int, k: int) -> None:
    """Fill in order k of a function f, by the differential equation that f(u(t)) satisfies."""
    x = u[i, 0]
    if k == 0:
        if operation == POWER:
            u[to, 0] = math.pow(x, u[j, 0])
        elif operation == EXP:
            u[to, 0] = math.exp(x)
        elif operation == LOG:
            u[to, 0] = math.log(x) if x > 0.0 else math.nan
        else:
            u[to, 0], u[j, 0] = math.sin(x), math.cos(x)
        return
    total, other = 0.0, 0.0
    if operation == POWER:
        exponent = u[j, 0]
        for m in range(k):
            total += (exponent * (k - m) - m) * u[i, k - m] * u[to, m]
        u[to, k] = total / (k * x)
    elif operation == EXP:
        for m in range(1, k + 1):
            total += m * u[i, m] * u[to, k - m]
        u[to, k] = total / k
    elif operation == LOG:
        for m in range(1, k):
            total += m * u[to, m] * u[i, k - m]
        u[to, k] = (u[i, k] - total / k) / x
    else:
        for m in range(1, k + 1):
            total += m * u[i, m] * u[j, k - m]
            other += m * u[i, m] * u[to, k - m]
        u[to, k], u[j, k] = total / k, -other / k


@kernel
def gradient_order(code: IntArray, u: FloatArray, order: int) -> None:
    """Fill in one order of all operations."""
    k = np.uint64(order)
    for n in range(code.shape[0]):
        operation, left, right = code[n, 0], code[n, 2], code[n, 3]
        to, i, j = np.uint64(code[n, 1]), np.uint64(left), np.uint64(right)
        if operation == MULTIPLY:
            u[to, k] = _product(u, left, right, order)
        elif operation == SCALE:
            u[to, k] = u[i, 0] * u[j, k]
        elif operation == ADD:
            u[to, k] = u[i, k] + u[j, k]
        elif operation == SUBTRACT:
            u[to, k] = u[i, k] - u[j, k]
        elif operation == DIVIDE:
            u[to, k] = 0.0
            u[to, k] = (u[i, k] - _product(u, code[n, 1], right, order)) / u[j, 0]
        elif operation == SHARE:
            u[to, k] = u[i, k] / u[j, 0]
        elif operation == NEGATE:
            u[to, k] = -u[i, k]
        else:
            _transcendental(operation, u, code[n, 1], left, right, order)


@kernel
def _times_gradient(u: FloatArray, i: int, part: int, is_constant: bool, k: int) -> float:
    """Return the coefficient of order k of a variable's product with a part of the gradient."""
    return u[i, k] * u[part, 0] if is_constant else _product(u, i, part, k)


@kernel
def take_series(code: IntArray, gradient: IntArray, moments: FloatArray, u: FloatArray) -> None:
    """Fill in all orders of all registers from the state's of order 0.

    ``gradient`` has the registers of V_1, V_2, V_3 and for each whether it is a constant (1) or not (0);
    ``moments`` are A, B, C, B − C, C − A, A − B.
    """
    A, B, C, along, across, about = moments
    V1, V2, V3 = gradient[0], gradient[1], gradient[2]
    first, second, third = gradient[3] == 1, gradient[4] == 1, gradient[5] == 1
    p, q, r, g1, g2, g3 = u[0], u[1], u[2], u[3], u[4], u[5]
    for k in range(ORDER):
        gradient_order(code, u, k)
        qr, pr, pq, rg2, qg3, pg3, rg1, qg1, pg2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for m in range(k + 1):
            n = np.uint64(k - m)
            qr += q[m] * r[n]
            pr += p[m] * r[n]
            pq += p[m] * q[n]
            rg2 += r[m] * g2[n]
            qg3 += q[m] * g3[n]
            pg3 += p[m] * g3[n]
            rg1 += r[m] * g1[n]
            qg1 += q[m] * g1[n]
            pg2 += p[m] * g2[n]
        pull1 = _times_gradient(u, 4, V3, third, k) - _times_gradient(u, 5, V2, second, k)
        pull2 = _times_gradient(u, 5, V1, first, k) - _times_gradient(u, 3, V3, third, k)
        pull3 = _times_gradient(u, 3, V2, second, k) - _times_gradient(u, 4, V1, first, k)
        by = 1.0 / (k + 1)
        p[k + 1] = (along * qr + pull1) / A * by
        q[k + 1] = (across * pr + pull2) / B * by
        r[k + 1] = (about * pq + pull3) / C * by
        g1[k + 1] = (rg2 - qg3) * by
        g2[k + 1] = (pg3 - rg1) * by
        g3[k + 1] = (qg1 - pg2) * by
