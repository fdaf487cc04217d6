"""The orientation of the body in space, from its function of time: quaternions and azimuths at any times.

After n periods the body has turned about the vertical by n times the gain of psi1, and its quaternion
with it, q(t + n T) = (±1)^n exp(k n Δψ1/2) q(t); n Δψ1 is reduced without loss. Operations and their
order are those of the service, to the last bit.
"""

import math
from collections.abc import Mapping

import numpy as np

from polhode.evaluation.function import (
    EPSILON,
    FloatArray,
    FunctionOfTime,
    PairOfDoubles,
    split_time,
    two_product,
)

LOCAL = ("local_q0", "local_q1", "local_q2", "local_q3")
"""Columns of the quaternion of the time within a period."""
_QUATERNION = ("q0", "q1", "q2", "q3")
_TWO_TURNS = PairOfDoubles(4.0 * math.pi, 4.0 * 1.2246467991473532e-16)
"""4π in two doubles: the period of a quaternion in its angle."""


def columns_at(function: FunctionOfTime, times: FloatArray) -> dict[str, FloatArray]:
    """Return all columns at ``times`` by name: the variables, and the orientation if the function has it."""
    values = function(times)
    names = list(function.columns)
    hidden = (*LOCAL, "psi1", "psi3")
    columns = {name: values[:, k] for k, name in enumerate(names) if name not in hidden}
    if LOCAL[0] not in names:
        return columns
    quaternion = _quaternion(function, times, values)
    angles = {name: values[:, k] for k, name in enumerate(names) if name in ("psi1", "psi3")}
    return {**columns, **{name: quaternion[:, k] for k, name in enumerate(_QUATERNION)}, **angles}


def errors_at(function: FunctionOfTime, times: FloatArray) -> dict[str, float]:
    """Return the bound of the absolute error of each of :func:`columns_at`, at any of ``times``."""
    errors = function.errors_at(times)
    told = {name: error for name, error in errors.items() if name not in LOCAL}
    if LOCAL[0] not in function.columns:
        return told
    bound = max(function.errors.get(name, function.error) for name in LOCAL) + 2.0 * EPSILON
    if function.period is not None and len(times):
        local, turns = split_time(times, function.period)
        passed = float(np.abs(times).max()) / function.period.hi
        phase = function.period.error * passed + 4.0 * EPSILON * function.period.hi
        here, *moved = (_quaternion(function, local + by) for by in (0.0, -phase, phase))
        bound += max(float(np.abs(there - here).max()) for there in moved)
        bound += 0.5 * float(np.abs(turns).max()) * function.advances.get("psi1", PairOfDoubles()).error
    return {**told, **dict.fromkeys(_QUATERNION, bound)}


def _quaternion(function: FunctionOfTime, times: FloatArray, values: FloatArray | None = None) -> FloatArray:
    known = function(times) if values is None else values
    first = list(function.columns).index(LOCAL[0])
    quaternion = known[:, first : first + 4]
    if function.period is None:
        return quaternion
    _, turns = split_time(times, function.period)
    advances: Mapping[str, PairOfDoubles] = function.advances
    gained = advances.get("psi1", PairOfDoubles())
    product, rest = two_product(turns, gained.hi)
    angle = split_time(product, _TWO_TURNS)[0] + (rest + turns * gained.lo)
    sign = np.where(turns % 2.0 == 0.0, 1.0, _sign_of_period(function, first, gained))
    return sign[:, None] * _product(_about_vertical(angle), quaternion)


def _sign_of_period(function: FunctionOfTime, first: int, gained: PairOfDoubles) -> float:
    series = function.coefficients[:, :, first : first + 4]
    end = series[-1].sum(axis=0)
    start = series[0, ::2].sum(axis=0) - series[0, 1::2].sum(axis=0)
    turned = _product(_about_vertical(np.array(gained.hi)), start)
    return math.copysign(1.0, float(turned @ end))


def _about_vertical(angle: FloatArray) -> FloatArray:
    zero = np.zeros_like(angle)
    return np.stack([np.cos(angle / 2), zero, zero, np.sin(angle / 2)], axis=-1)


def _product(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return Hamilton's product of quaternions, shape (..., 4) each."""
    a0, a1, a2, a3 = np.moveaxis(left, -1, 0)
    b0, b1, b2, b3 = np.moveaxis(right, -1, 0)
    return np.stack(
        [
            a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
            a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
            a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
            a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
        ],
        axis=-1,
    )
