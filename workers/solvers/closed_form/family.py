"""The family of solvers by elliptic functions in doubles, for potentials of three terms."""

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.bounds import is_within
from service.dynamics.motion import Motion
from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.recognition.three_terms import ThreeTerms, recognise
from service.dynamics.problem import Problem
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.start import StartingPoint
from service.dynamics.reduction.window import Window
from workers.solvers.assembly.families import NOT_MINE, Declined, PeriodicPlace, Place
from workers.solvers.assembly.periodic import Sampled, make_periodic
from workers.solvers.closed_form.elliptic import ClosedForm, make_closed_form
from workers.solvers.three_terms.intervals import MotionInterval, RootsUndecidedError, intervals, make_curve
from workers.solvers.three_terms.variables import MirrorImage, phase_at, primed_nu

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
