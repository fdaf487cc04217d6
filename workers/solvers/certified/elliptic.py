r"""The six variables in elliptic functions of time, in balls.

With the constants of :mod:`workers.solvers.closed_form` the phase is

.. math:: \dot\chi = \tfrac12\sqrt{a_0^2\cos^2\chi + b_0^2\sin^2\chi} .

Gauss's transformation replaces (a, b) by their means and χ by χ' with

.. math:: \sin\chi = \frac{2a\sin\chi'}{d},\quad \cos\chi = \frac{2\Delta'\cos\chi'}{d},\quad
          \Delta = \frac{a\,((a+b)\cos^2\chi' + 2b\sin^2\chi')}{d},\quad
          d = (a+b)\cos^2\chi' + 2a\sin^2\chi',

Δ being the square root above; quarter turns stay quarter turns. After n steps
Δ lies between b_n and a_n, hence χ_n between b_n t/2 and a_n t/2: the means are
never taken for equal, and nothing is truncated.

Which motion it is, its interval, mirror image and phase at t = 0, follows from the rules of
:mod:`service.dynamics.reduction.window`, decided by proven inequalities of the roots alone.
What they do not decide is left open.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.potentials.recognition import ThreeTerms
from service.dynamics.problem import PlanarMotion, StartAtEquator, StartAtPoint, StartAtRest
from workers.solvers.three_terms import (
    MirrorImage,
    MotionInterval,
    RootsUndecidedError,
    intervals,
    make_curve,
    phase_at,
    primed_nu,
    trip_time,
)

MAX_STEPS = 40


@dataclass(frozen=True, slots=True)
class EllipticMotion:
    """A periodic motion in t since the phase of its start; made by :func:`make_elliptic_motion`."""

    interval: MotionInterval
    branch: MirrorImage
    quarters: int
    offset: arb
    """Phase at t = 0: quarters · π/2 + offset."""
    means: tuple[tuple[arb, arb], ...]
    last: tuple[arb, arb]

    @property
    def period(self) -> arb:
        """Return the period of all six variables."""
        return trip_time(self.interval) * self.interval.trips

    @property
    def passes_pole(self) -> bool:
        """Say whether it goes through a pole."""
        return self.interval.lo_end == "pole"

    @property
    def energy(self) -> arb:
        """Return h."""
        return self.interval.curve.energy

    def states(self, times: Sequence[arb]) -> tuple[tuple[arb, ...], ...]:
        """Return (p, q, r, g1, g2, g3) in the client's axes."""
        return tuple(self.state(t) for t in times)

    def state(self, t: arb) -> tuple[arb, ...]:
        """Return (p, q, r, g1, g2, g3) in the client's axes."""
        sine, cosine = self._amplitude(t)
        curve, interval = self.interval.curve, self.interval
        (low, high), (second_low, second_high) = interval.linear_factors()
        # tan v = √(L1(lo)/L1(hi)) tan χ.
        s, c = low.sqrt() * sine, high.sqrt() * cosine
        length = (s * s + c * c).sqrt()
        sine, cosine = s / length, c / length
        up, down = sine * sine, cosine * cosine
        lo, hi, width = interval.lo, interval.hi, interval.hi - interval.lo
        x = lo * down + hi * up
        second = second_low * down + second_high * up
        branch, nu, C = self.branch, curve.nu, ball(curve.C)
        if interval.hi_end == "equator":
            g2 = cosine * (width * second).sqrt()
            amplitude = (low * down + high * up).sqrt()
        else:
            g2 = branch.g2 * ((curve.x1 - hi + width * down) * second).sqrt()
            amplitude = branch.g2 * (curve.quadratic * width).sqrt() * cosine
        r = (2 * width / C).sqrt() * amplitude * sine
        p = -branch.g3 * (nu / (2 * C)).sqrt() * amplitude
        if interval.lo_end == "pole":
            g3 = branch.g3 * (nu * hi).sqrt() * sine
        else:
            g3 = branch.g3 * (nu * x).sqrt()
            p = p * (width / x).sqrt() * sine
        r, g1 = branch.g1 * r, branch.g1 * x
        if branch.is_mirrored:
            return -r, arb(0), -p, g3, g2, g1
        return p, arb(0), r, g1, g2, g3

    def _amplitude(self, t: arb) -> tuple[arb, arb]:
        """Return sin χ and cos χ."""
        a, b = self.last
        mean = a.union(b)
        sine, cosine = (mean * t / 2 + self.offset * (mean / mean)).sin_cos()
        for _ in range(self.quarters % 4):
            sine, cosine = cosine, -sine
        up, down = sine * sine, cosine * cosine
        delta = (a * a * down + b * b * up).sqrt()
        for a, b in reversed(self.means):
            total = (a + b) * down
            d = total + 2 * a * up
            sine, cosine, delta = 2 * a * sine / d, 2 * delta * cosine / d, a * (total + 2 * b * up) / d
            up, down = sine * sine, cosine * cosine
        return sine, cosine


def make_elliptic_motion(
    interval: MotionInterval, branch: MirrorImage, origin: tuple[int, arb]
) -> EllipticMotion:
    """Return the motion whose phase at t = 0 is origin[0] · π/2 + origin[1], at the current precision.

    Raises
    ------
    RootsUndecidedError
        The precision does not suffice.
    """
    (low, high), (second_low, second_high) = interval.linear_factors()
    factor = interval.curve.factor
    a, b = (factor * high * second_low).sqrt(), (factor * low * second_high).sqrt()
    if not (a.is_finite() and b.is_finite() and a > 0 and b > 0):
        raise RootsUndecidedError("a linear factor may vanish")
    means = []
    for _ in range(MAX_STEPS):
        if abs(a - b) < a * arb(2) ** (6 - ctx.prec) or (a - b).contains(0):
            break
        means.append((a, b))
        a, b = (a + b) / 2, (a * b).sqrt()
    return EllipticMotion(interval, branch, origin[0], origin[1], tuple(means), (a, b))


def elliptic_motion(body: RigidBody, terms: ThreeTerms, motion: PlanarMotion) -> EllipticMotion | None:
    """Return the motion at the current precision; None if it is not periodic, or not there as it is asked.

    Raises
    ------
    RootsUndecidedError
        The precision does not suffice, or two roots coincide.
    """
    mirrored = body.A < body.C
    g1, g3 = (motion.g3_sign, motion.sign_of_g1) if mirrored else (motion.sign_of_g1, motion.g3_sign)
    nu = primed_nu(motion.lambda_squared, mirrored=mirrored)
    interval = _chosen(intervals(make_curve(terms, min(body.A, body.C), nu, g1)), motion.window)
    if interval is None:
        return None
    start = motion.start
    if start is None:
        start = StartAtEquator() if interval.hi_end == "equator" else StartAtRest()
    if isinstance(start, StartAtEquator):
        if interval.hi_end != "equator":
            return None
        direction = start.s_sign * g3
        branch, turned = _moving(interval, g1, 0, g3, direction, mirrored=mirrored)
        return make_elliptic_motion(interval, branch, (turned, arb(0)))
    if isinstance(start, StartAtRest):
        return _at_rest(interval, g1, start.g2_sign, g3, mirrored=mirrored)
    return _at_point(interval, motion, start, (g1, g3), mirrored=mirrored)


def _chosen(found: tuple[MotionInterval, ...], window: int | None) -> MotionInterval | None:
    """Return the periodic interval that is asked for."""
    if window is None:
        window = 0 if len(found) == 1 else -1
    if not 0 <= window < len(found):
        return None
    return found[window] if found[window].is_periodic else None


def _moving(
    interval: MotionInterval, g1: int, g2: int, g3: int, direction: int, *, mirrored: bool
) -> tuple[MirrorImage, int]:
    """Return the mirror image through a point with these signs, and the quarter of its phase.

    ``direction`` is that of the loop coordinate v of the reduction. At the
    equator (g2 = 0) sin v is the sign of the phase; elsewhere the quarter is
    that of the phase's sine and cosine: 0, 1, 2 or 3.
    """
    if interval.hi_end == "equator":
        carries_g3 = interval.lo_end == "pole"
        branch = MirrorImage(g1, 1, direction if carries_g3 else g3, mirrored)
        sine, cosine = direction * g3, g2
    elif interval.lo_end == "pole":
        branch = MirrorImage(g1, g2, 1, mirrored)
        sine, cosine = g3, direction * g2
    else:
        branch = MirrorImage(g1, g2, g3, mirrored)
        sine, cosine = 1, direction * g2 * g3
    if cosine == 0:
        return branch, 1 if sine > 0 else 3
    return branch, {(1, 1): 0, (1, -1): 1, (-1, -1): 2, (-1, 1): 3}[sine, cosine]


def _at_rest(interval: MotionInterval, g1: int, g2: int, g3: int, *, mirrored: bool) -> EllipticMotion | None:
    """Return the motion from rest; the larger |g1| if there are two such places."""
    if interval.hi_end == "rest":
        carries_g3 = interval.lo_end == "pole"
        branch = MirrorImage(g1, g2, 1 if carries_g3 else g3, mirrored)
        quarters = 3 if carries_g3 and g3 < 0 else 1
    elif interval.lo_end == "rest":
        branch, quarters = MirrorImage(g1, 1, g3, mirrored), 0 if g2 > 0 else 2
    else:
        return None
    return make_elliptic_motion(interval, branch, (quarters, arb(0)))


def _at_point(
    interval: MotionInterval,
    motion: PlanarMotion,
    start: StartAtPoint,
    signs: tuple[int, int],
    *,
    mirrored: bool,
) -> EllipticMotion | None:
    """Return the motion from a given g1."""
    size, curve = ball(abs(start.g1)), interval.curve
    # The client's g1 is the g3 of the mirrored axes.
    x = size * size / curve.nu if mirrored else size
    if not (start.g1 * motion.sign_of_g1 > 0 and interval.lo < x and x < interval.hi):
        return None
    g1, g3 = signs
    branch, quarter = _moving(interval, g1, start.g2_sign, g3, start.s_sign * g3, mirrored=mirrored)
    width = interval.hi - interval.lo
    first = phase_at(interval, ((x - interval.lo) / width).sqrt(), ((interval.hi - x) / width).sqrt())
    # Mirrored at the vertical axis, at both, at the horizontal one.
    turns = {0: (0, first), 1: (2, -first), 2: (2, first), 3: (0, -first)}
    return make_elliptic_motion(interval, branch, turns[quarter])
