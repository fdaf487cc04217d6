"""Identifies the elliptic motion of a planar motion: its interval, mirror image and phase at t = 0.

The rules are those of :mod:`service.dynamics.reduction.window`, decided by
proven inequalities of the roots alone. What they do not decide is left open.
"""

from flint import arb

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.potentials.recognition import ThreeTerms
from service.dynamics.problem import PlanarMotion, StartAtEquator, StartAtPoint, StartAtRest
from workers.solvers.certified.elliptic import EllipticMotion, make_elliptic_motion
from workers.solvers.three_terms.intervals import MotionInterval, intervals, make_curve
from workers.solvers.three_terms.variables import MirrorImage, phase_at, primed_nu


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
