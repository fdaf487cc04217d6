r"""The family of solvers by elliptic functions in doubles, for potentials of three terms.

On an interval lo ≤ x ≤ hi of x = |g1| with x'² = (2/C) (x − lo)(hi − x) L1(x) L2(x),

.. math:: x = lo\cos^2 v + hi\sin^2 v, \qquad \dot v = \tfrac12\sqrt{2L_1L_2/C}, \qquad
          \tan v = \sqrt{L_1(lo)/L_1(hi)}\,\tan\chi,

.. math:: \dot\chi = \tfrac12\sqrt{b^2\cos^2\chi + a^2\sin^2\chi}, \quad
          a^2 = \tfrac2C L_1(lo)L_2(hi),\ b^2 = \tfrac2C L_1(hi)L_2(lo),

so that g1 has the period 2π/M with M the arithmetic-geometric mean of a and b,
whatever the ends of the interval are; v grows for ever. Everything below is a
product or a sum of positive numbers times sin v and cos v: no digit is lost at
turning points, or next to a separatrix beyond what the time itself loses.

The Jacobi amplitude comes in doubles, with full relative accuracy of its tangent. For
:math:`\dot\chi = \sqrt{a^2\cos^2\chi + b^2\sin^2\chi}`, χ(0) = 0, and the
arithmetic-geometric mean M of a and b,

.. math:: \cot\chi = \frac{M}{a}\cot\theta \prod d_n, \qquad \theta = M t,

by Gauss's transformation in the form of Bulirsch (1965). Every d_n is a ratio
of sums of positive numbers: nothing cancels, for any a, b > 0.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.motion import Motion
from service.dynamics.numerics import is_within
from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.recognition import ThreeTerms, recognise
from service.dynamics.problem import Problem
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.window import StartingPoint, Window
from service.dynamics.solution.dense_output import EPSILON, Period, reduce_time
from workers.solvers.assembly.families import NOT_MINE, Declined, PeriodicPlace, Place, Sampled, make_periodic
from workers.solvers.three_terms import (
    MirrorImage,
    MotionInterval,
    RootsUndecidedError,
    Variables,
    intervals,
    make_curve,
    moduli,
    phase_at,
    primed_nu,
)

FloatArray = NDArray[np.float64]
MAX_STEPS = 16
"""The mean of 1 and 1e-300 takes 14; equality of the last digit is not reached reliably."""


@dataclass(frozen=True, slots=True)
class Amplitude:
    """χ as a function of θ; ``means`` are the pairs (a_n, b_n) of the iteration, at least one."""

    means: tuple[tuple[float, float], ...]

    def sine_cosine(
        self, sine: FloatArray, cosine: FloatArray, scale: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return sin v and cos v from sin θ and cos θ, where tan v = ``scale`` · tan χ.

        v is in the quadrant of θ, and where one of the four is 0, so is its partner.
        """
        a, b = self.means[-1]
        last = 0.5 * (a + b)
        cosine = last * cosine
        square = sine * sine
        d: FloatArray | float = 1.0
        for a, b in reversed(self.means):
            ratio = cosine * cosine
            cosine = cosine * d
            d = (b * last * square + ratio) / (a * last * square + ratio)
            last = a
        sine = (scale * self.means[0][0]) * sine
        length = np.hypot(sine, cosine)
        return sine / length, cosine / length


def make_amplitude(a: float, b: float) -> Amplitude:
    """Return the amplitude with these a, b > 0."""
    means = [(a, b)]
    while abs(a - b) > 1e-8 * a and len(means) < MAX_STEPS:
        a, b = 0.5 * (a + b), sqrt(a * b)
        means.append((a, b))
    return Amplitude(tuple(means))


PERIOD_BITS = 112
CONSTANT_BITS = 60
"""Relative accuracy demanded of the balls: of the period, which is two doubles, and of what becomes one."""
MIN_CONSTANT = 2.0**-250
"""Constants below it, or above its inverse, are left to balls: four of them may be multiplied."""
PHASE_RADIUS = 2.0**-60
"""Accuracy demanded of the phase of the start."""
PHASE_ULPS = 2.5
"""Roundings of θ, which stays below 5π/2, in 2^-52 of a turn."""
FORMULA_ULPS = 6.0
"""Roundings of a variable, in 2^-52 of itself, counted in the longest of their formulas."""
TANGENT_ULPS, STEP_ULPS = 3.0, 4.0
"""Roundings of tan v, in 2^-52 of itself: some, and more for every step of the mean."""


@dataclass(frozen=True, slots=True)
class ClosedForm:
    """A periodic motion, in t since the phase θ = ``quarters`` · π/2 + ``offset``."""

    interval: MotionInterval
    branch: MirrorImage
    quarters: int
    offset: float
    period: Period
    """The common period of all six variables."""
    passages: FloatArray
    """Times in [0, period) at which a pole is passed, growing."""
    amplitude: Amplitude
    scale: float
    """tan v / tan χ."""
    rate: float
    """dθ/dt."""
    variables: Variables

    def sample(self, times: FloatArray) -> FloatArray:
        """Return p, q, r, g1, g2, g3 at ``times`` of shape (n,): shape (n, 6)."""
        local = reduce_time(np.asarray(times, dtype=np.float64), self.period)
        theta = self.offset + self.rate * local
        turned = _turned(np.sin(theta), np.cos(theta), self.quarters)
        sine, cosine = self.amplitude.sine_cosine(*turned, self.scale)
        return self._client(self.variables.state(sine, cosine, self.branch))

    def error(self, phases: int = 64) -> float:
        """Return the bound of the absolute error of :meth:`sample` within one period.

        First order in the roundings, of which every one is counted: a few ulp
        of the phase move a variable by its slope, a few ulp of tan v and of the
        variable itself are relative. Slopes are taken at ``phases`` places.
        """
        v = np.linspace(0.0, 2.0 * np.pi, phases, endpoint=False)
        sine, cosine = np.sin(v), np.cos(v)
        state = self.variables.state(sine, cosine, self.branch)
        slope = np.abs(self.variables.slope(state, self.branch))
        speed = self.variables.phase_speed(sine, cosine)[:, None]
        late = PHASE_ULPS * EPSILON * 2.0 * np.pi / self.rate
        tangent = (TANGENT_ULPS + STEP_ULPS * len(self.amplitude.means)) * EPSILON
        turned = tangent * np.abs(sine * cosine)[:, None] / speed
        return float((slope * (late + turned) + FORMULA_ULPS * EPSILON * np.abs(state)).max())

    def _client(self, state: FloatArray) -> FloatArray:
        if not self.branch.is_mirrored:
            return state
        return np.stack(
            [-state[:, 2], state[:, 1], -state[:, 0], state[:, 5], state[:, 4], state[:, 3]], axis=1
        )


def make_closed_form(interval: MotionInterval, branch: MirrorImage, origin: arb) -> ClosedForm:
    """Return the motion that is at the phase ``origin`` when t = 0, at the current precision.

    Raises
    ------
    RootsUndecidedError
        The precision does not suffice.
    """
    a, b = moduli(interval)
    mean = a.agm(b)
    length = 2 * arb.pi() * interval.trips / mean
    _require(length, PERIOD_BITS)
    quarters = round(float(2 * origin / arb.pi()))
    offset = origin - quarters * arb.pi() / 2
    if not offset.rad() < PHASE_RADIUS:
        raise RootsUndecidedError("the phase of the start")
    (low, high), _ = interval.linear_factors()
    passages = np.empty(0)
    if interval.lo_end == "pole":
        turns = [2 * (arb.pi() * k - origin) / mean / length for k in (0, 1)]
        passages = np.sort([float((turn - turn.floor()) * length) for turn in turns])
    return ClosedForm(
        interval,
        branch,
        quarters % 4,
        float(offset),
        Period.of(length),
        passages,
        make_amplitude(float(b) / 2, float(a) / 2),
        float((low / high).sqrt()),
        float(mean / 2),
        _variables(interval),
    )


def _variables(interval: MotionInterval) -> Variables:
    curve = interval.curve
    first, second = interval.linear_factors()
    is_equator = interval.hi_end == "equator"
    above = arb(0) if is_equator else curve.x1 - interval.hi
    width = interval.hi - interval.lo
    for value in (*first, *second, above, width, interval.lo, curve.nu, ball(curve.C)):
        _require(value, CONSTANT_BITS)
    return Variables(
        C=float(curve.C),
        nu=float(curve.nu),
        a1=float(curve.terms.a1),
        b1=float(curve.terms.b1),
        c1=float(curve.terms.c1),
        lo=float(interval.lo),
        hi=float(interval.hi),
        width=float(width),
        first=(float(first[0]), float(first[1])),
        second=(float(second[0]), float(second[1])),
        above=float(above),
        reaches_pole=interval.lo_end == "pole",
        reaches_equator=is_equator,
    )


def _turned(sine: FloatArray, cosine: FloatArray, quarters: int) -> tuple[FloatArray, FloatArray]:
    """Return sine and cosine of an angle greater by quarters of a turn: exact zeros stay so."""
    for _ in range(quarters):
        sine, cosine = cosine, -sine
    return sine, cosine


def _require(value: arb, bits: int) -> None:
    if value == 0:
        return
    if not value.is_finite() or value.rel_accuracy_bits() < bits:
        raise RootsUndecidedError(f"a constant is known to fewer than {bits} bits")
    if not MIN_CONSTANT < abs(value) < 1.0 / MIN_CONSTANT:
        raise RootsUndecidedError("a constant whose products with others are beyond doubles")


PRECISIONS = (192, 768, 3072)
"""Bits, in turn: next to a separatrix the roots agree in many of them."""


def solve_closed_form(
    body: RigidBody, potential: Potential, start: StartingPoint, window: Window
) -> ClosedForm | None:
    """Return the motion from ``start`` in elliptic functions.

    None if V is not a sum of the three terms, the motion is not periodic, the
    start is known to fewer digits than a double has, or the constants of the
    motion are beyond what doubles can multiply.
    """
    if window.kind != "periodic":
        return None
    terms = recognise(body, potential, start.arc.loop.g1_sign)
    if terms is None:
        return None
    for precision in PRECISIONS:
        with ctx.workprec(precision):
            try:
                interval = _interval(terms, start.arc.loop, window)
                return None if interval is None else _motion(interval, start)
            except RootsUndecidedError:
                continue
    return None


def _interval(terms: ThreeTerms, loop: Loop, window: Window) -> MotionInterval | None:
    curve = make_curve(terms, loop.C, primed_nu(loop.lambda_squared, mirrored=loop.mirrored), loop.g1_sign)
    found = (each for each in intervals(curve) if (each.lo_end, each.hi_end) == window.ends)
    return next(found, None)


def _motion(interval: MotionInterval, start: StartingPoint) -> ClosedForm:
    """Find the branch and the phase of a start on the loop."""
    loop = start.arc.loop
    sine, cosine = start.v.sin_cos()
    x = interval.curve.x1 * sine * sine
    g2, g3, direction = _sign(cosine), _sign(sine), start.direction
    # Signs of sin v and cos v, chosen such that v grows with t.
    if interval.lo_end == "pole" and interval.hi_end == "equator":
        branch = MirrorImage(loop.g1_sign, 1, direction, loop.mirrored)
        signs = (direction * g3, g2)
    elif interval.hi_end == "equator":
        branch = MirrorImage(loop.g1_sign, 1, g3, loop.mirrored)
        signs = (direction * g3, g2)
    elif interval.lo_end == "pole":
        branch = MirrorImage(loop.g1_sign, g2, 1, loop.mirrored)
        signs = (g3, direction * g2)
    else:
        branch = MirrorImage(loop.g1_sign, g2, g3, loop.mirrored)
        signs = (1, direction * g2 * g3)
    if direction == 0:
        origin = _turning_phase(interval, x, g2, g3)
    else:
        width = interval.hi - interval.lo
        up = ((x - interval.lo) / width).nonnegative_part().sqrt()
        # On the equator, where cos v has no sign, the ball of x says less than is known.
        down = ((interval.hi - x) / width).nonnegative_part().sqrt() if g2 else arb(0)
        origin = phase_at(interval, (signs[0] or 1) * up, (signs[1] or 1) * down)
    return make_closed_form(interval, branch, origin)


def _turning_phase(interval: MotionInterval, x: arb, g2: int, g3: int) -> arb:
    """Return the phase of a rest point, which x is next to."""
    is_low = abs(x - interval.lo) < abs(x - interval.hi)
    if interval.lo_end == "pole":
        return g3 * arb.pi() / 2
    if interval.hi_end == "equator":
        return arb(0) if g2 > 0 else arb.pi()
    return arb(0) if is_low else arb.pi() / 2


def _sign(value: arb) -> int:
    """Return the sign of a ball, 0 if it has none."""
    return 1 if value > 0 else -1 if value < 0 else 0


WELL_CONDITIONED = 1e-12
"""Largest error of a closed form in doubles that is preferred to the quadrature in balls."""


class ClosedFormFamily:
    """See :class:`workers.solvers.assembly.families.Family`."""

    def takes(self, problem: Problem, place: Place) -> bool:
        """Take periodic motions; whether V has three terms is seen when it is solved."""
        return isinstance(place, PeriodicPlace)

    def promise(self, problem: Problem) -> float:
        """Promise a few roundings more than a double has."""
        return WELL_CONDITIONED

    def solve(self, problem: Problem, place: Place) -> Motion | Declined:
        """Return the motion; declined without the three terms, or where roundings exceed the promise."""
        if not isinstance(place, PeriodicPlace):
            return NOT_MINE
        closed = solve_closed_form(problem.body, problem.potential, place.start, place.window)
        if closed is None:
            return NOT_MINE
        error = closed.error()
        if not is_within(error, self.promise(problem)):
            return Declined(error)
        evidence: dict[str, float | int | str] = {"closed_form": "elliptic functions", "rounding": error}
        found = Sampled(closed.sample, closed.period, closed.passages, error, evidence)
        return make_periodic(problem, place, found)
