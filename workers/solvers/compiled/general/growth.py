r"""The growth of the errors that a run makes on its way, by compiled code.

An error made at s is multiplied by :math:`\Phi(t, s)` until t, which solves :math:`\Phi' = J(t) \Phi` along
the motion, J the derivative of the six rates by the six variables. For errors that are independent, with the
standard deviations :math:`\sigma_i` at :math:`t_i`,

.. math:: P(t) = \sum_i \Phi(t, t_i)\, \sigma_i \sigma_i^T\, \Phi(t, t_i)^T

has their variances on its diagonal: it grows by every passage between any two times, not from t = 0 alone,
and from step to step it is :math:`P \to \Phi P \Phi^T + \sigma\sigma^T`. Φ over a part of a step is Magnus'
exponential of order 6 by three Gaussian nodes (Blanes, Casas & Ros 2000); J is the central difference of
rates, and exact by ω, since rates are quadratic in ω.

That is an estimate and no theorem: of first order, by independent errors of a size that is modelled. A step
is taken to lose, of each variable, a rounding of all that is added up to its rate, and what follows the last
two coefficients of its series: what is exactly 0 stays so, and what is small keeps its own digits.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.evaluation.interpreter import new_registers
from workers.solvers.compiled.general.steps import ORDER, STATE
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.lanes import (
    ROW,
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
from workers.solvers.compiled.records import Equations
from workers.solvers.compiled.residual.nodes import WIDTH, evaluate

FloatArray = NDArray[np.float64]

NODES = 3
"""Number of Gauss's nodes in a part of a step."""
OUTER_NODE = math.sqrt(0.6)
"""The first and the last of them, in [−1, 1]."""
LONGEST_NORM = 1.25
"""Largest norm of J times a length: the series of the exponential, up to the order 9, leaves 1e-6 out."""
MOST_PARTS = 16
DIFFERENCE_SHARE = 2.0**-10
"""Half the distance of two states whose rates are compared, in parts of ω, and of the way of γ in a step.
Such a step is shorter than any feature of V on it: the difference leaves out some 1e-7 of J."""
LEAST_DIFFERENCE, LARGEST_DIFFERENCE = 2.0**-26, 2.0**-16
"""The same in parts of γ, at least and at most: roundings are then 1e-8 of J, and mostly 1e-11."""
_SPREAD, _SIGMA, _WORK = 3 * STATE, 4 * STATE, 4 * STATE + 1
"""Rows of the room at which P, σ and the matrices of the exponential begin; before them is J at the nodes."""
_ROOM = _WORK + 12 * STATE


@kernel
def _put_product(x: int, y: int, out: int) -> None:
    """Put the product of two matrices into the rows of a third one."""
    a, b, c = take(y, 0), take(y, 1), take(y, 2)
    d, e, f = take(y, 3), take(y, 4), take(y, 5)
    for i in range(STATE):
        left = spread(number_at(x, i, 0)) * a + spread(number_at(x, i, 1)) * b
        middle = spread(number_at(x, i, 2)) * c + spread(number_at(x, i, 3)) * d
        right = spread(number_at(x, i, 4)) * e + spread(number_at(x, i, 5)) * f
        put(out, i, left + middle + right)


@kernel
def _put_commutator(x: int, y: int, by: float, out: int, other: int) -> None:
    """Put ``by`` (x y − y x) into the rows of ``out``; ``other`` is room."""
    _put_product(x, y, out)
    _put_product(y, x, other)
    for i in range(STATE):
        put(out, i, spread(by) * (take(out, i) - take(other, i)))


@kernel
def _put_transition(nodes: int, time: float, work: int) -> int:
    """Put Φ over a part of a step into rows; return where they begin. ``nodes`` has J at the three nodes."""
    block = ROW * STATE
    one, two, three = work, work + block, work + 2 * block
    first, second, sum_ = work + 3 * block, work + 4 * block, work + 5 * block
    other, exponent, square = work + 6 * block, work + 7 * block, work + 8 * block
    cube, low, high = work + 9 * block, work + 10 * block, work + 11 * block
    h, third, tenth = spread(time), spread(math.sqrt(15.0) / 3.0 * time), spread(10.0 / 3.0 * time)
    for i in range(STATE):
        x, y, z = take(nodes, i), take(nodes, STATE + i), take(nodes, 2 * STATE + i)
        put(one, i, h * y)
        put(two, i, third * (z - x))
        put(three, i, tenth * ((z - y) - (y - x)))
    _put_commutator(one, two, 1.0, first, other)
    for i in range(STATE):
        put(sum_, i, spread(2.0) * take(three, i) + take(first, i))
    _put_commutator(one, sum_, -1.0 / 60.0, second, other)
    for i in range(STATE):
        put(sum_, i, take(first, i) - spread(20.0) * take(one, i) - take(three, i))
        put(second, i, take(two, i) + take(second, i))
    _put_commutator(sum_, second, 1.0 / 240.0, exponent, other)
    for i in range(STATE):
        put(exponent, i, take(exponent, i) + take(one, i) + spread(1.0 / 12.0) * take(three, i))
    _put_product(exponent, exponent, square)
    _put_product(exponent, square, cube)
    for i in range(STATE):
        x, y, z = take(exponent, i), take(square, i), take(cube, i)
        put(high, i, spread(1.0 / 5040.0) * x + spread(1.0 / 40320.0) * y + spread(1.0 / 362880.0) * z)
        put(low, i, spread(1.0 / 24.0) * x + spread(1.0 / 120.0) * y)
        put_number(high, i, i, number_at(high, i, i) + 1.0 / 720.0)
        put_number(low, i, i, number_at(low, i, i) + 1.0 / 6.0)
        put(other, i, x + spread(0.5) * y)
        put_number(other, i, i, number_at(other, i, i) + 1.0)
    _put_product(cube, high, sum_)
    for i in range(STATE):
        put(low, i, take(low, i) + take(sum_, i))
    _put_product(cube, low, sum_)
    for i in range(STATE):
        put(other, i, take(other, i) + take(sum_, i))
    return other


@kernel
def _norm(matrix: int, few: int) -> float:
    """Return the largest sum of a column's sizes; NaN where one is not finite."""
    total = spread(0.0)
    for i in range(STATE):
        total = total + size_of(take(matrix, i))
    put(few, 0, total)
    most = 0.0
    for lane in range(STATE):
        here = number_at(few, 0, lane)
        if not here < math.inf:
            return math.nan
        most = max(most, here)
    return most


@kernel
def _pass_on(room: int, time: float) -> float:
    """Take P over a part of a step, by J at its nodes, and add σ; return the largest variance.

    Where J is not known nothing grows.
    """
    P, sigma = room + ROW * _SPREAD, room + ROW * _SIGMA
    work = room + ROW * _WORK
    # Sums of what is not finite are not finite.
    for i in range(STATE):
        put(work, i, take(room, i) + take(room, STATE + i) + take(room, 2 * STATE + i))
    if _norm(work, work + ROW * STATE) < math.inf:
        transition = _put_transition(room, time, work)
        moved, turned = work, work + ROW * STATE
        _put_product(transition, P, moved)
        for i in range(STATE):
            for k in range(STATE):
                put_number(turned, k, i, number_at(moved, i, k))
        _put_product(transition, turned, P)
    most = 0.0
    for a in range(STATE):
        deviation = number_at(sigma, 0, a)
        if deviation < math.inf:
            put_number(P, a, a, number_at(P, a, a) + deviation * deviation)
        # Where one error is 1e8 times all others, roundings of P are more than these, of either sign.
        variance = abs(number_at(P, a, a))
        if not variance <= most:
            most = variance
    return most


@kernel
def parts_of(norm: float, time: float) -> int:
    """Return into how many parts a step is cut, by the norm of J in its middle and its length."""
    needed = abs(time) * norm / LONGEST_NORM
    return min(math.ceil(max(needed, 1.0)), MOST_PARTS) if needed < math.inf else 1


@kernel
def _put_distances(series: int, length: int, few: int, apart: FloatArray) -> None:
    """Fill in half the distances of states whose rates are compared, in a step with this series."""
    way = spread(0.0)
    for k in range(1, length):
        way = way + size_of(take(series, k))
    put(few, 0, way)
    put(few, 1, way + size_of(take(series, 0)))
    turn, reach, goes = 0.0, 0.0, 0.0
    for a in range(3):
        turn = max(turn, number_at(few, 1, a))
        reach, goes = max(reach, number_at(few, 1, 3 + a)), max(goes, number_at(few, 0, 3 + a))
    for a in range(3):
        apart[a] = DIFFERENCE_SHARE * turn if turn > 0.0 else DIFFERENCE_SHARE
        apart[3 + a] = min(max(DIFFERENCE_SHARE * goes, LEAST_DIFFERENCE * reach), LARGEST_DIFFERENCE * reach)


@kernel
def _put_places(series: int, length: int, middle: float, half: float, at_nodes: int) -> None:
    """Put the states at the nodes of a part of a step into rows."""
    x, y, z = middle - OUTER_NODE * half, middle, middle + OUTER_NODE * half
    # Three sums do not wait for one another.
    a, b, c = spread(0.0), spread(0.0), spread(0.0)
    d, e, f = a, b, c
    for k in range(length - 1, 0, -1):
        coefficient = take(series, k)
        a, d = (coefficient + spread(2.0 * x) * a) - d, a
        b, e = (coefficient + spread(2.0 * y) * b) - e, b
        c, f = (coefficient + spread(2.0 * z) * c) - f, c
    put(at_nodes, 0, (take(series, 0) + spread(x) * a) - d)
    put(at_nodes, 1, (take(series, 0) + spread(y) * b) - e)
    put(at_nodes, 2, (take(series, 0) + spread(z) * c) - f)


@kernel
def _put_derivatives(
    equations: Equations,
    registers: FloatArray,
    states: FloatArray,
    rates: FloatArray,
    integrals: FloatArray,
    at_nodes: int,
    apart: FloatArray,
    room: int,
) -> None:
    """Put J at the nodes, whose states are in rows, into the first matrices of the room."""
    for j in range(NODES):
        for b in range(STATE):
            column = 2 * (STATE * j + b)
            for a in range(STATE):
                x = number_at(at_nodes, j, a)
                far = apart[b] if a == b else 0.0
                states[a, column], states[a, column + 1] = x + far, x - far
    evaluate(equations, registers, states, rates, integrals, 2 * STATE * NODES)
    for j in range(NODES):
        for b in range(STATE):
            column, by = 2 * (STATE * j + b), 0.5 / apart[b]
            for a in range(STATE):
                put_number(room, STATE * j + a, b, (rates[a, column] - rates[a, column + 1]) * by)


@kernel
def _put_truncation(series: int, tail: float, out: int) -> None:
    """Put into a row what a step of the order N leaves out of each variable; ``tail`` is x / (1 - x).

    There x is the step in parts of the radius of convergence. Terms of the orders N and N − 1 in the time are
    read off the last two of Chebyshev's.
    """
    last, before = take(series, ORDER), take(series, ORDER - 1)
    before = before - spread(2.0 * ORDER) * last
    x = tail / (1.0 + tail)
    one = spread(2.0 ** (2 * ORDER - 1)) * size_of(last)
    other = spread(2.0 ** (2 * ORDER - 3) * x) * size_of(before)
    put(out, 0, spread(tail) * larger(one, other))


@kernel
def _put_deviations(
    equations: Equations,
    registers: FloatArray,
    states: FloatArray,
    state: int,
    noise: float,
    truncation: int,
    share: float,
    room: int,
) -> None:
    """Put σ into the room: ``noise`` of what J makes of every variable, and of the torque's two halves.

    These may cancel: a field along γ has none. To it comes a ``share`` of what series leave out.
    """
    middle, first, results = STATE, 2 * STATE * (NODES // 2), equations.gradient.results
    for a in range(STATE):
        total = 0.0
        for b in range(STATE):
            total += abs(number_at(room, middle + a, b) * number_at(state, 1, b))
        if a < 3:
            i, j = (a + 1) % 3, (a + 2) % 3
            one = states[3 + i, first] * registers[0, results[1 + j], first]
            two = states[3 + j, first] * registers[0, results[1 + i], first]
            total += (abs(one) + abs(two)) / equations.moments[a]
        put_number(room, _SIGMA, a, noise * total + share * number_at(truncation, 0, a))


@kernel
def grown(
    equations: Equations,
    breaks: FloatArray,
    series: FloatArray,
    length: int,
    start: FloatArray,
    noise: float,
    tail: float,
    size: float,
) -> FloatArray:
    """Return the largest standard deviation of the error of any variable, in each step of a run from 0 on.

    Shapes are (steps + 1,) and (steps, ORDER + 1, LANES), of which ``length`` are seen. ``start`` has those
    of the six variables at 0; every step adds ``noise`` of what it adds up, and what follows its series, by
    its ``tail``. ``size`` is that of the largest variable.
    """
    owner = new_rows(_ROOM + NODES + 2)
    room = first_row(owner)
    at_nodes = room + ROW * _ROOM
    registers = new_registers(equations.gradient.code, 1, WIDTH)
    states, rates, integrals = np.empty((STATE, WIDTH)), np.empty((STATE, WIDTH)), np.empty((3, WIDTH))
    apart, found = np.empty(STATE), np.zeros(len(breaks))
    rows = place_of(series)
    for a in range(STATE):
        put_number(room, _SPREAD + a, a, (start[a] / size) ** 2)
        found[0] = max(found[0], start[a])
    for n in range(len(breaks) - 1):
        base, time = rows + ROW * series.shape[1] * n, breaks[n + 1] - breaks[n]
        _put_distances(base, length, at_nodes, apart)
        _put_truncation(base, tail, at_nodes + ROW * NODES)
        _put_places(base, length, 0.0, 1.0, at_nodes)
        _put_derivatives(equations, registers, states, rates, integrals, at_nodes, apart, room)
        parts, most = parts_of(_norm(room + ROW * STATE, room + ROW * _WORK), time), 0.0
        for part in range(parts):
            if parts > 1:
                _put_places(base, length, (2.0 * part + 1.0) / parts - 1.0, 1.0 / parts, at_nodes)
                _put_derivatives(equations, registers, states, rates, integrals, at_nodes, apart, room)
            # Roundings of the parts are independent, and have together that of the step. What series leave
            # out is of the order N + 1 in the time, so that comes at the end.
            rounding = noise * abs(time) / (math.sqrt(parts) * size)
            share = 1.0 / size if part == parts - 1 else 0.0
            _put_deviations(
                equations, registers, states, at_nodes, rounding, at_nodes + ROW * NODES, share, room
            )
            here = _pass_on(room, time / parts)
            if not here <= most:
                most = here
        found[n + 1] = size * math.sqrt(most)
    # Up to here the room has an owner.
    owner[0, 0] = 0.0
    return found
