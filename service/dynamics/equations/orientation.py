r"""The attitude of the body in space: quaternions, rotation matrices, angles of precession.

R takes coordinates in the body to coordinates in space, whose third axis is
gamma: the third row of R is (g1, g2, g3). Quaternions are Hamilton's, scalar
first, and obey q̇ = q ω / 2. The azimuth of the body's axis k obeys

.. math:: \dot\psi_k = \frac{\omega\cdot g - \omega_k g_k}{1 - g_k^2}

and counts from 0 at t = 0; the first axis of space is the horizontal direction
of the body's first axis at t = 0.

A dense output with orientation has, beside the angles, the quaternion of the
time within a period. After n periods of a planar motion the body has turned
about the axis of space by n times the advance Δψ1, and the quaternion with it,

.. math:: q(t + n T) = (\pm 1)^n e^{k n \Delta\psi_1 / 2} q(t) ,

where n Δψ1 is reduced without loss and the sign keeps q continuous.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from typing import TypeVar

import numpy as np

from service.dynamics.formula.algebra import Algebra, RingElement
from service.dynamics.formula.algebras.real import ScalarAlgebra
from service.dynamics.numerics import largest
from service.dynamics.solution.dense_output import (
    EPSILON,
    TURN,
    TURN_LOW,
    Advance,
    DenseOutput,
    FloatArray,
    Period,
    reduce_time,
    split_time,
    two_product,
)

QUATERNION: tuple[str, ...] = ("q0", "q1", "q2", "q3")
LOCAL_QUATERNION: tuple[str, ...] = ("local_q0", "local_q1", "local_q2", "local_q3")
"""The quaternion of the time within a period; internal, not shown to clients."""
PRECESSION: tuple[str, ...] = ("psi1", "psi3")
VERTICAL_ANGLE = 1e-6
"""Angle from the vertical below which the azimuth of an axis is undefined."""

_TWO_TURNS = Period(2.0 * TURN, 2.0 * TURN_LOW, 0.0)
"""4π in two doubles: the period of a quaternion in its angle."""

T = TypeVar("T")
Column = TypeVar("Column", float, FloatArray)
R = TypeVar("R", bound=RingElement)
"""The values of a column, or the bound of their errors."""


def orientation_columns(
    dense: DenseOutput, times: FloatArray, low_parts: FloatArray | None = None
) -> dict[str, FloatArray]:
    """Return those of :func:`trajectory_columns` that tell the attitude: q0, ... and psi1, psi3; or none."""
    if not has_orientation(dense):
        return {}
    return _attitude_of(trajectory_columns(dense, times, low_parts))


def trajectory_columns(
    dense: DenseOutput, times: FloatArray, low_parts: FloatArray | None = None
) -> dict[str, FloatArray]:
    """Return every column a client may see: the six variables, then :func:`orientation_columns`.

    With ``low_parts`` the times are the sums of both.

    Raises
    ------
    OutsideHorizonError
        As calling ``dense``.
    """
    times = np.asarray(times, dtype=np.float64)
    values = dense(times, low_parts)
    columns = {name: values[:, k] for k, name in enumerate(dense.columns) if _is_plain(name)}
    return {**columns, **(_orientation(dense, times, low_parts, values) if has_orientation(dense) else {})}


def column_names(dense: DenseOutput) -> tuple[str, ...]:
    """Return the names of the columns of :func:`trajectory_columns`, in their order."""
    plain = [name for name in dense.columns if _is_plain(name)]
    return (*plain, *_turning(dense))


def _turning(dense: DenseOutput) -> list[str]:
    """Return the names of the columns of the orientation."""
    if all(_is_plain(name) for name in dense.columns):
        return []
    return [*QUATERNION, *(name for name in PRECESSION if name in dense.columns)]


def evaluated_alone(dense: DenseOutput, names: Collection[str]) -> DenseOutput:
    """Return the function of time with only the columns that a client's ``names`` need.

    All of it if a name is neither ``t`` nor one of :func:`column_names`.
    """
    if not set(names) <= {"t", *column_names(dense)}:
        return dense
    wanted = [name for name in dense.columns if _is_plain(name) and name in names]
    others = [name for name in dense.columns if not _is_plain(name)]
    return dense.only(wanted + (others if set(names) & set(_turning(dense)) else []))


def parts_of(dense: DenseOutput) -> dict[str, tuple[str, ...]]:
    """Return for each of :func:`trajectory_columns` the columns of ``dense`` that bound its derivatives.

    A turned quaternion is bent no more than the whole of that of the first period.
    """
    plain: dict[str, tuple[str, ...]] = {
        name: (name,) for name in dense.columns if name not in LOCAL_QUATERNION
    }
    return {**plain, **dict.fromkeys(QUATERNION, LOCAL_QUATERNION)} if has_orientation(dense) else plain


def trajectory_errors(dense: DenseOutput, times: FloatArray) -> dict[str, float]:
    """Return the bound of the absolute error, at any of ``times``, of each of :func:`trajectory_columns`."""
    times = np.asarray(times, dtype=np.float64)
    errors = dense.errors_at(times)
    plain = {name: error for name, error in errors.items() if _is_plain(name)}
    if not has_orientation(dense):
        return plain
    angles = {name: errors[name] for name in PRECESSION if name in errors}
    return {**plain, **dict.fromkeys(QUATERNION, _quaternion_error(dense, times)), **angles}


def orientation_errors(dense: DenseOutput, times: FloatArray) -> dict[str, float]:
    """Return those of :func:`trajectory_errors` that belong to :func:`orientation_columns`."""
    return _attitude_of(trajectory_errors(dense, times))


def has_orientation(dense: DenseOutput) -> bool:
    """Tell whether ``dense`` has the attitude."""
    return LOCAL_QUATERNION[0] in dense.columns


def quaternion_product(left: FloatArray, right: FloatArray) -> FloatArray:
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


def about_vertical(cosine: R, sine: R, quaternion: Sequence[R]) -> tuple[R, R, R, R]:
    """Return an attitude turned about the vertical of space, by the cosine and the sine of half the angle."""
    a, b, c, d = quaternion
    return cosine * a - sine * d, cosine * b - sine * c, cosine * c + sine * b, cosine * d + sine * a


def attitude(gamma: FloatArray) -> FloatArray:
    """Return the quaternion, shape (4,), of the attitude at t = 0 with this gamma, shape (3,)."""
    given = [float(g) for g in gamma]
    return np.array(attitude_in(ScalarAlgebra(), given, given))


def attitude_in(algebra: Algebra[T], gamma: Sequence[T], near: Sequence[float]) -> tuple[T, T, T, T]:
    r"""Return the quaternion of the attitude at t = 0 with this gamma; ``near`` it are doubles.

    R = Ry(−β) Rx(χ) with g1 = sin β, (g2, g3) = cos β (sin χ, cos χ): the first axis
    of the body has no azimuth. Where it is vertical, within VERTICAL_ANGLE, the second axis
    has the azimuth π/2 instead: R = Rx(a) Ry(b).
    """
    half = Fraction(1, 2)
    one, multiply = algebra.constant(Fraction(1)), algebra.multiply

    def length(x: T, y: T) -> T:
        return algebra.power(algebra.add(multiply(x, x), multiply(y, y)), half)

    def half_angle(y: T, x: T, *, is_up: bool, is_left: bool) -> tuple[T, T]:
        """Return cosine and sine of half the angle of (x, y), without cancellation on either side."""
        whole = length(x, y)
        sine, cosine = algebra.divide(y, whole), algebra.divide(x, whole)
        along = algebra.subtract(one, cosine) if is_left else algebra.add(one, cosine)
        larger = algebra.power(multiply(algebra.constant(half), along), half)
        if is_left and not is_up:
            larger = algebra.negate(larger)
        smaller = algebra.divide(multiply(algebra.constant(half), sine), larger)
        return (smaller, larger) if is_left else (larger, smaller)

    (g1, g2, g3), (x, y, z) = gamma, near
    against = algebra.negate(g1)
    if math.hypot(y, z) > VERTICAL_ANGLE:
        c1, s1 = half_angle(g2, g3, is_up=y >= 0.0, is_left=z < 0.0)
        c2, s2 = half_angle(against, length(g2, g3), is_up=x <= 0.0, is_left=False)
        last = algebra.negate(multiply(s1, s2))
    else:
        c1, s1 = half_angle(g2, length(g1, g3), is_up=y >= 0.0, is_left=False)
        c2, s2 = half_angle(against, g3, is_up=x <= 0.0, is_left=z < 0.0)
        last = multiply(s1, s2)
    return multiply(c1, c2), multiply(s1, c2), multiply(c1, s2), last


def azimuth_rate(states: FloatArray, axis: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return ψ' of an axis of the body, its derivatives by the six variables, and 1 − g².

    Shapes are those of ``states``, (..., 6), and without the last axis.
    """
    others = [other for other in range(3) if other != axis]
    w, g = states[..., others], states[..., [3 + other for other in others]]
    square = np.square(g).sum(axis=-1)
    rate = (w * g).sum(axis=-1) / square
    slopes = np.zeros(states.shape)
    slopes[..., others] = g / square[..., None]
    slopes[..., [3 + other for other in others]] = (w - 2.0 * rate[..., None] * g) / square[..., None]
    return rate, slopes, square


def _attitude_of(columns: Mapping[str, Column]) -> dict[str, Column]:
    return {name: column for name, column in columns.items() if name in QUATERNION or name in PRECESSION}


def _is_plain(name: str) -> bool:
    return name not in LOCAL_QUATERNION and name not in PRECESSION


def _orientation(
    dense: DenseOutput, times: FloatArray, low_parts: FloatArray | None, values: FloatArray
) -> dict[str, FloatArray]:
    first = dense.columns.index(LOCAL_QUATERNION[0])
    quaternion = values[:, first : first + 4]
    if dense.period is not None:
        _, turns = split_time(times, dense.period, low_parts)
        quaternion = _turned(quaternion, turns, dense)
    angles = {name: values[:, dense.columns.index(name)] for name in PRECESSION if name in dense.columns}
    return {**{name: quaternion[:, k] for k, name in enumerate(QUATERNION)}, **angles}


def _turned(quaternion: FloatArray, turns: FloatArray, dense: DenseOutput) -> FloatArray:
    """Return the quaternions of times n = ``turns`` periods later."""
    advance = dense.advances.get(PRECESSION[0], Advance())
    product, rest = two_product(turns, advance.hi)
    angle = reduce_time(product, _TWO_TURNS) + (rest + turns * advance.lo)
    sign = np.where(turns % 2.0 == 0.0, 1.0, _sign_of_period(dense, advance))
    return sign[:, None] * _turned_by(angle, quaternion)


def _sign_of_period(dense: DenseOutput, advance: Advance) -> float:
    """Return the sign in q(T) = ± exp(k Δψ1/2) q(0)."""
    first = dense.columns.index(LOCAL_QUATERNION[0])
    series = dense.coefficients[:, :, first : first + 4]
    end = series[-1].sum(axis=0)
    start = series[0, ::2].sum(axis=0) - series[0, 1::2].sum(axis=0)
    turned = _turned_by(np.array(advance.hi), start)
    return math.copysign(1.0, float(turned @ end))


def _turned_by(angle: FloatArray, quaternion: FloatArray) -> FloatArray:
    parts = tuple(np.moveaxis(quaternion, -1, 0))
    return np.stack(about_vertical(np.cos(angle / 2), np.sin(angle / 2), parts), axis=-1)


def _quaternion_error(dense: DenseOutput, times: FloatArray) -> float:
    """Return the bound within a period, and what the errors of phase and of the advance do to it."""
    own: Mapping[str, float] = dense.errors
    bound = largest(own.get(name, dense.error) for name in LOCAL_QUATERNION) + 2.0 * EPSILON
    if dense.period is None or not len(times):
        return bound
    local, turns = split_time(times, dense.period)
    phase = dense.phase_error(times)
    here, *moved = (_quaternion(dense, local + by) for by in (0.0, -phase, phase))
    # As in DenseOutput.errors_at: turned by any angle they are bent as much, and none leaves [-1, 1].
    sagittas = dense.sagittas_and_ranges(phase)[0][[dense.columns.index(name) for name in LOCAL_QUATERNION]]
    bent = math.hypot(*sagittas.tolist())
    bound += min(largest(float(np.abs(there - here).max()) for there in moved) + bent, 2.0)
    return bound + 0.5 * float(np.abs(turns).max()) * dense.advances.get(PRECESSION[0], Advance()).error


def _quaternion(dense: DenseOutput, times: FloatArray) -> FloatArray:
    columns = orientation_columns(dense, times)
    return np.stack([columns[name] for name in QUATERNION], axis=-1)
