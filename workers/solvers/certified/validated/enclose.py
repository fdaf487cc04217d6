"""Enclosures of a motion at exact times, from an exact state, with as many bits as are asked for.

Between steps the motion is known to be in m + Q·box: m is exact, Q nearly orthogonal and the box narrow
(Lohner's way against wrapping). A step takes m to the end of its polynomial and the box through the enclosed
derivative of the flow; Q is then chosen anew, so that the longest side of the image keeps its direction. All
errors are proportional to 2^−precision, and the precision is raised until what is asked for is reached.
"""

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.formula.algebras.ball import BallAlgebra, ball
from service.dynamics.solution.dense_output import exact_middle
from workers.solvers.certified.certify import ALLOWED_BITS, HIGHEST_PRECISION, is_narrow
from workers.solvers.certified.validated.step import (
    ROUND_UP,
    SUM_ROUNDING,
    UNDERFLOW,
    ProvenStep,
    StepTooLongError,
    prove,
    rounded_length,
    taylor,
    upper,
)
from workers.solvers.certified.validated.system import Recorded, System, record
from workers.solvers.errors import CertifiedUnavailableError

FloatArray = NDArray[np.float64]
Start = Callable[[], Sequence[arb]]
"""Returns balls of the state at t = 0 at the precision in force; they shrink with it."""
Watch = Callable[[Fraction], None]
"""Is called with the time until which the motion is proven; what it raises ends the work."""

GUARD_BITS = 24
"""Bits by which errors may grow along the motion at the first try."""
ORDER_PER_BIT = 0.4
"""Order of the polynomials: a larger one makes steps longer and each of them dearer. Measured."""
MIN_ORDER = 16
TIME_BITS = 96
"""Bits of the rational next to a time in a ball; so many more than those of what is asked there."""
BOX_SIDE = 2.0**-20
"""Half a side of the box about a state, which the motion does not leave in the ball of a time."""
MIN_STEP_SHARE = Fraction(1, 2**34)
"""Steps that would have to be shorter than this part of the whole time are met at a singularity."""


@dataclass(frozen=True, slots=True)
class ProvenSet:
    """The set m + 2^−precision Q·box, and the derivative of the flow from t = 0: C + Q·D, |D| bounded."""

    middle: tuple[arb, ...]
    """m: exact numbers."""
    frame: FloatArray
    """Q, shape (d, d)."""
    box: FloatArray
    """Half the sides of the box, shape (d,)."""
    flow: FloatArray
    """C, shape (d, d)."""
    flow_box: FloatArray
    """Bounds of D, shape (d, d)."""

    @property
    def radius(self) -> FloatArray:
        """Radii of the variables, in units of 2^−precision."""
        return ROUND_UP * (np.abs(self.frame) @ self.box)


@dataclass(frozen=True, slots=True)
class ProvenStretch:
    """A proven step and the set from which it starts."""

    step: ProvenStep
    start: ProvenSet


@dataclass(frozen=True, slots=True)
class ProvenTrajectory:
    """A motion proven from t = 0 to ``end``, which may be before it: a ball of each variable at each time."""

    stretches: tuple[ProvenStretch, ...]
    begins: tuple[Fraction, ...]
    """The distances from t = 0 at which they begin."""
    end: Fraction
    precision: int

    def stretch(self, t: Fraction) -> ProvenStretch:
        """Return the stretch in which t is."""
        return self.stretches[max(0, bisect_right(self.begins, abs(t)) - 1)]

    def state(self, t: Fraction) -> tuple[arb, ...]:
        """Return the variables at a time of the trajectory."""
        stretch = self.stretch(t)
        step, start = stretch.step, stretch.start
        place = float((t - step.begin) / step.length)
        radius = step.error + self._moved(stretch, place, start.frame, start.box)
        return self._about(step, ball((t - step.begin) / step.length), ROUND_UP * radius)

    def over(self, first: Fraction, last: Fraction) -> tuple[arb, ...]:
        """Return balls that contain the variables at all times from ``first`` to ``last``."""
        found: tuple[arb, ...] = ()
        for stretch in self.stretches:
            step = stretch.step
            low, high = sorted((t - step.begin) / step.length for t in (first, last))
            if high >= 0 and low <= 1:
                tau = ball(max(low, Fraction(0))).union(ball(min(high, Fraction(1))))
                part = self._about(step, tau, step.spread)
                found = tuple(map(arb.union, found, part)) if found else part
        return found

    def _about(self, step: ProvenStep, tau: arb, radius: FloatArray) -> tuple[arb, ...]:
        unit = arb(2) ** -self.precision
        widths = (unit * width for width in radius.tolist())
        return tuple(curve(tau) + arb(0, width) for curve, width in zip(step.curves, widths, strict=True))

    def flow(self, t: Fraction) -> tuple[FloatArray, FloatArray]:
        """Return the derivative of the state at t by that at 0: a matrix and a bound of its errors."""
        stretch = self.stretch(t)
        step, start = stretch.step, stretch.start
        place = float((t - step.begin) / step.length)
        matrix = _at(step.flow, place)
        lost = self._moved(stretch, place, start.frame, start.flow_box) + _lost(step, start.flow)
        return matrix @ start.flow, ROUND_UP * lost

    def flow_along(self, stretch: ProvenStretch) -> tuple[FloatArray, FloatArray]:
        """Return matrices whose convex hull has what :meth:`flow` is in a stretch, but for a bound."""
        step, start = stretch.step, stretch.start
        whole, sizes = _lost(step, start.frame), np.abs(step.flow).sum(axis=0)
        lost = (sizes @ np.abs(start.frame) + whole) @ start.flow_box + _lost(step, start.flow)
        return _corners(step.flow) @ start.flow, ROUND_UP * lost

    def along(self, stretch: ProvenStretch) -> tuple[FloatArray, FloatArray]:
        """Return states, shape (n, d), whose convex hull has those of a stretch, but for a bound of each."""
        step = stretch.step
        longest = max(len(curve) for curve in step.curves)
        rows = [[float(curve[power]) for curve in step.curves] for power in range(longest)]
        coefficients = np.array(rows)
        sizes = np.abs(coefficients).sum(axis=0)
        return _corners(coefficients), ROUND_UP * (2.0**-self.precision * step.spread + SUM_ROUNDING * sizes)

    def _moved(self, stretch: ProvenStretch, place: float, frame: FloatArray, box: FloatArray) -> FloatArray:
        step = stretch.step
        image, lost = _image(step, _at(step.flow, place), frame)
        moved: FloatArray = (np.abs(image) + lost) @ box
        return moved


@dataclass(frozen=True, slots=True)
class Enclosure:
    """Balls of the variables at the asked times, and the motion that they are of."""

    states: tuple[tuple[arb, ...], ...]
    forward: ProvenTrajectory | None
    backward: ProvenTrajectory | None
    precision: int


class _TooWideError(ArithmeticError):
    def __init__(self, t: Fraction) -> None:
        super().__init__()
        self.t = t


def enclose(
    system: System,
    start: Start,
    times: Sequence[Fraction],
    bits: int,
    *,
    watch: Watch | None = None,
    shorter: int = 1,
) -> Enclosure:
    """Return enclosures of the motion of a system from ``start`` at t = 0, at exact ``times`` of any signs.

    Parameters
    ----------
    start
        Balls that contain the exact state; asked again for each precision.
    bits
        Radii are at most 2^(8 − bits), of numbers above 1 relative to them.
    shorter
        So many times shorter steps than the motion needs, for its derivative by the state at t = 0: that is a
        polynomial of low degree.

    Raises
    ------
    CertifiedUnavailableError
        The motion meets a singularity or a kink of the system, or too many bits would be needed: with the
        time until which it is proven.
    """
    recorded = record(system)
    spare, reached = GUARD_BITS, Fraction(0)
    earliest, latest = min(times, default=Fraction(0)), max(times, default=Fraction(0))
    while True:
        precision = bits + spare
        if precision > HIGHEST_PRECISION:
            raise CertifiedUnavailableError(f"{HIGHEST_PRECISION} bits are not enough{_until(reached)}")
        with ctx.workprec(precision):
            try:
                forward = _trajectory(recorded, start, latest, bits, watch, shorter) if latest >= 0 else None
                backward = (
                    _trajectory(recorded, start, earliest, bits, watch, shorter) if earliest < 0 else None
                )
                states = []
                for t in times:
                    trajectory = forward if t >= 0 else backward
                    assert trajectory is not None
                    state = trajectory.state(t)
                    if not all(map(is_narrow, state, [bits] * len(state))):
                        raise _TooWideError(t)
                    states.append(state)
                return Enclosure(tuple(states), forward, backward, precision)
            except _TooWideError as error:
                reached = error.t
        # Errors of unstable motions grow exponentially: as many bits are lost in each unit of time.
        whole = max(abs(latest), abs(earliest))
        needed = spare * min(4.0, float(whole / abs(reached)) if reached else 4.0)
        spare = max(spare + GUARD_BITS, int(1.1 * needed) + ALLOWED_BITS)


def enclose_at(system: System, start: Start, times: Sequence[arb], bits: int) -> list[tuple[arb, ...]]:
    """Return balls of the variables at the true times in balls ``times``, by the rationals next to them.

    Raises
    ------
    CertifiedUnavailableError
        As :func:`enclose`, or a time is not known well enough.
    """
    nearby = [rational_next_to(time, bits + TIME_BITS) for time in times]
    found, recorded = enclose(system, start, nearby, bits), record(system)
    states = list[tuple[arb, ...]]()
    with ctx.workprec(found.precision + TIME_BITS):
        for time, near, state in zip(times, nearby, found.states, strict=True):
            late = arb(abs(time - ball(near)).abs_upper())
            rates = recorded.right_side.run(BallAlgebra(), box_until(recorded, state, late))
            moved = (late * abs(rates[n]) if n in rates else arb(0) for n in range(len(state)))
            states.append(tuple(x + arb(0, far.abs_upper()) for x, far in zip(state, moved, strict=True)))
    return states


def box_until(recorded: Recorded, state: Sequence[arb], late: arb) -> list[arb]:
    """Return a box about a state that the motion does not leave for a time ``late``.

    Raises
    ------
    CertifiedUnavailableError
        It may leave it.
    """
    box = [value + arb(0, BOX_SIDE) for value in state]
    rates = recorded.right_side.run(BallAlgebra(), box).values()
    if not all(abs(rate) * late < BOX_SIDE / 2 for rate in rates):
        raise CertifiedUnavailableError("a time is not known well enough to tell where it is then")
    return box


def rational_next_to(value: arb, bits: int = TIME_BITS) -> Fraction:
    """Return a number next to the midpoint that has so many bits."""
    with ctx.workprec(bits):
        return exact_middle(value.mid() + 0)


def _until(t: Fraction) -> str:
    return f"; it is proven until t = {float(t):.10g}"


def _trajectory(
    system: Recorded, start: Start, end: Fraction, bits: int, watch: Watch | None, shorter: int
) -> ProvenTrajectory:
    count, order = system.dimension, max(MIN_ORDER, round(ORDER_PER_BIT * ctx.prec))
    # A sum is rounded to the precision in force, whatever that of the start is.
    balls = [value + 0 for value in start()]
    if not all(is_narrow(value, bits) for value in balls):
        raise CertifiedUnavailableError(
            f"its state at t = 0 is not known to {bits} bits", pointer="/accuracy/bits"
        )
    unit = arb(2) ** -ctx.prec
    here = ProvenSet(
        tuple(value.mid() for value in balls),
        np.eye(count),
        np.array([upper(value.rad() / unit) if value.rad() > 0 else 0.0 for value in balls]),
        np.eye(count),
        np.zeros((count, count)),
    )
    t, stretches = Fraction(0), list[ProvenStretch]()
    widest = [max(1.0, abs(float(value))) for value in here.middle]
    allowed = float(2.0 ** (ALLOWED_BITS - bits + ctx.prec))
    while not stretches or abs(t) < abs(end):
        step = _step(system, here, t, end, order, shorter)
        stretches.append(ProvenStretch(step, here))
        t += step.length
        try:
            here = _carried(step, here)
        except StepTooLongError:
            raise _TooWideError(t) from None
        if watch is not None:
            watch(t)
        widest = [max(size, abs(float(value))) for size, value in zip(widest, here.middle, strict=True)]
        if not np.all(here.radius <= allowed * np.array(widest)):
            raise _TooWideError(t)
    begins = tuple(abs(each.step.begin) for each in stretches)
    return ProvenTrajectory(tuple(stretches), begins, t, ctx.prec)


def _step(
    system: Recorded, here: ProvenSet, t: Fraction, end: Fraction, order: int, shorter: int
) -> ProvenStep:
    """Return the longest step whose proof is found by halving, at most to the end."""
    fault = StepTooLongError("steps become shorter and shorter")
    try:
        found = taylor(system, here.middle, order)
        left = abs(end - t)
        longest = found.longest / shorter
        length = min(longest, left) if left else Fraction(1, 2**64)
        shortest = MIN_STEP_SHARE * abs(end)
        radius = here.radius
        while length > shortest:
            try:
                return prove(system, found, t, length if end >= 0 else -length, radius)
            except StepTooLongError as error:
                fault = error
                length = rounded_length(0.5 * float(length))
        raise fault
    except StepTooLongError as error:
        raise CertifiedUnavailableError(
            f"it meets a singularity or a kink of the potential: {error}{_until(t)}"
        ) from error


def _at(polynomial: FloatArray, place: float) -> FloatArray:
    value = polynomial[-1]
    for coefficient in polynomial[-2::-1]:
        value = value * place + coefficient
    return np.asarray(value)


def _corners(polynomial: FloatArray) -> FloatArray:
    """Return the coefficients in Bernstein's polynomials of [0, 1]: values are in their convex hull."""
    return np.tensordot(_bernstein(len(polynomial) - 1), polynomial, 1)


@cache
def _bernstein(last: int) -> FloatArray:
    """Return the matrix that takes coefficients of powers to those of Bernstein's polynomials."""
    weights = [[math.comb(i, j) / math.comb(last, j) for j in range(last + 1)] for i in range(last + 1)]
    return np.array(weights)


def _image(step: ProvenStep, matrix: FloatArray, frame: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return M Q and a bound of its errors; those of the evaluation of M are among them."""
    return matrix @ frame, ROUND_UP * _lost(step, frame)


def _lost(step: ProvenStep, factor: FloatArray) -> FloatArray:
    """Return a bound of the errors of M X but for its own roundings; M is evaluated anywhere in the step."""
    lost: FloatArray = (step.flow_error + SUM_ROUNDING * np.abs(step.flow).sum(axis=0)) @ np.abs(factor)
    return lost


def _carried(step: ProvenStep, here: ProvenSet) -> ProvenSet:
    """Return the set at the end of a step."""
    unit = arb(2) ** -ctx.prec
    ends = [curve(arb(1)) for curve in step.curves]
    middle = tuple(value.mid() for value in ends)
    added = step.error + np.array([upper(value.rad() / unit) for value in ends])
    matrix = step.flow.sum(axis=0)
    image, lost = _image(step, matrix, here.frame)
    frame = _frame(image * here.box)
    turned = frame.T @ image
    through = np.abs(turned) + np.abs(frame.T) @ (lost + SUM_ROUNDING * np.abs(image))
    flow = matrix @ here.flow
    box = _solved(frame, through @ here.box + np.abs(frame.T) @ added)
    flow_box = _solved(frame, through @ here.flow_box + np.abs(frame.T) @ _lost(step, here.flow))
    return ProvenSet(middle, frame, box, flow, flow_box)


def _frame(sides: FloatArray) -> FloatArray:
    """Return a nearly orthogonal matrix whose first columns follow the longest sides of an image."""
    lengths = np.linalg.norm(sides, axis=0)
    if not np.all(np.isfinite(lengths)):
        raise StepTooLongError("the set is too wide")
    order = np.argsort(-lengths)
    scale = max(float(lengths.max()), UNDERFLOW)
    return np.asarray(np.linalg.qr(sides[:, order] / scale)[0])


def _solved(frame: FloatArray, bound: FloatArray) -> FloatArray:
    """Return a bound of Q⁻¹x, given one of Qᵀx: Q⁻¹ = (QᵀQ)⁻¹Qᵀ, and |QᵀQ − 1| is below 2^−40 in rows."""
    if not np.abs(frame.T @ frame - np.eye(len(frame))).sum(axis=1).max() < 2.0**-42:
        raise StepTooLongError("a frame is not orthogonal")
    return np.asarray(ROUND_UP * (bound + 2.0**-40 * bound.max(axis=0)))
