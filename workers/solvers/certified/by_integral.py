"""Enclosures of any periodic motion of a potential with a formula: one integral, inverted."""

from dataclasses import dataclass
from functools import cached_property

from flint import acb, arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.arc import Arc
from service.dynamics.reduction.loop import Loop
from service.dynamics.reduction.start import StartingPoint, starting_point
from service.dynamics.reduction.window import Window
from service.dynamics.reduction.windows import (
    PRECISION,
    choose_window,
    find_windows,
    require_inside_domain,
)
from workers.solvers.certified.complex_loop import ComplexLoop
from workers.solvers.certified.errors import CertifiedUnavailableError, PrecisionNeededError
from workers.solvers.certified.phase import Libration, Rotation
from workers.solvers.certified.time_model import TimeModel, make_time_model
from workers.solvers.certified.trapezoid import time_of_turn

SHARES = (0.375, 0.625, 0.8125)
"""Places on the arc where the energy is taken: two at least are neither a pole nor the equator."""
NEWTON_TRIES = 12


@dataclass(frozen=True)
class IntegralMotion:
    """A motion from its start on; to be asked at the precision it was made at."""

    phase: Libration | Rotation
    start: StartingPoint
    energy: arb

    @property
    def passes_pole(self) -> bool:
        """Say whether it goes through a pole."""
        return passes_pole(self.start.arc)

    @cached_property
    def period(self) -> arb:
        """Return the period of all six variables."""
        time = time_of_turn(self.phase)
        return self.model.period if time is None else time

    @cached_property
    def model(self) -> TimeModel:
        """Return time as a function of the phase, which samples need and the period alone does not."""
        return make_time_model(self.phase)

    @cached_property
    def origin(self) -> arb:
        """Return the time of the start since θ = 0."""
        if isinstance(self.phase, Rotation):
            return arb(0)
        v, direction = self.start.v, self.start.direction
        below, above = v - self.phase.lower, self.phase.upper - v
        if direction == 0:
            return arb(0) if abs(below) < abs(above) else self.model.span
        return direction * self.model.time_at(2 * arb.atan2(below.sqrt(), above.sqrt()))

    def state(self, t: arb) -> tuple[arb, ...]:
        """Return (p, q, r, g1, g2, g3) in the client's axes."""
        return self.phase.state(self.model.phase_at(t + self.origin))


def periodic_window(
    body: RigidBody, potential: Potential, motion: PlanarMotion
) -> tuple[Window, StartingPoint]:
    """Return the window and the start of a periodic motion, at the current precision or a better one.

    Raises
    ------
    CertifiedUnavailableError
        It is not periodic.
    NoMotionError, SeveralWindowsError, NoSuchWindowError, StartOutsideWindowError, LeavesDomainError
        The motion asked for is not there, or not the only one.
    """
    window = choose_window(find_windows(body, potential, motion, precision=max(ctx.prec, PRECISION)), motion)
    require_inside_domain(window)
    if window.kind != "periodic":
        raise CertifiedUnavailableError(f"it is not periodic ({window.kind})", pointer="/motion")
    return window, starting_point(window, motion)


def integral_motion(start: StartingPoint) -> IntegralMotion:
    """Return the motion from ``start`` on a periodic arc, at the current precision.

    Raises
    ------
    CertifiedUnavailableError
        The potential has no formula, or the motion is not analytic: told here or when it is asked.
    PrecisionNeededError
        The precision does not suffice, as above.
    """
    arc = start.arc
    curve = _curve(arc)
    if arc.is_whole_loop:
        return IntegralMotion(Rotation(curve, start.v, start.direction), start, curve.h)
    return IntegralMotion(Libration(curve, _zero(curve, arc.lower), _zero(curve, arc.upper)), start, curve.h)


def passes_pole(arc: Arc) -> bool:
    """Say whether motions on the arc go through a pole."""
    return arc.is_whole_loop or bool(arc.poles)


def _curve(arc: Arc) -> ComplexLoop:
    loop = arc.loop
    if passes_pole(arc) and loop.alpha.denominator != 1:
        raise CertifiedUnavailableError(
            f"it passes a pole, where time is not an analytic function of g3 for A/C = {loop.alpha}",
            pointer="/motion",
        )
    side = 0 if passes_pole(arc) else 1 if ((arc.lower + arc.upper) / 2).sin() > 0 else -1
    return ComplexLoop(loop, _tape(loop), _energy(loop, arc), side)


def _tape(loop: Loop) -> Tape:
    try:
        return loop.potential.tape
    except NoClosedFormError as error:
        raise CertifiedUnavailableError(
            "the potential is given by an integral", pointer="/potential"
        ) from error


def _energy(loop: Loop, arc: Arc) -> arb:
    """Return h, which must be the same all along the arc.

    It is taken from D: two places where it differs refute the potential.
    """
    places = (arc.lower + (arc.upper - arc.lower) * share for share in SHARES)
    found = [h for h in map(loop.energy, places) if h.is_finite()][:2]
    if len(found) < 2:
        raise PrecisionNeededError("the energy")
    first, second = found
    if not first.overlaps(second):
        raise CertifiedUnavailableError("the potential is not admissible on this curve", pointer="/potential")
    return first.intersection(second)


def _zero(curve: ComplexLoop, v: arb) -> arb:
    """Return the enclosure of the one zero of N next to ``v``, proven by the interval Newton method."""
    middle = v.mid()
    value = curve.N(curve.place(acb(middle), analytic=False), analytic=False).real
    guess = v
    for _ in range(NEWTON_TRIES):
        slope = curve.slope(curve.place(acb(guess), analytic=False), analytic=False).real
        found = middle - value / slope
        if not found.is_finite():
            break
        if guess.contains(found):
            return found
        guess = arb(middle, (4 * abs(found - middle)).abs_upper())
    raise PrecisionNeededError("a rest point")
