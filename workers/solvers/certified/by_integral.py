"""Encloses any periodic motion of a potential with a formula, by inverting one integral."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.families.general_solution import GeneralPotential
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.window import Arc, StartingPoint, Window, require_known_ends, starting_point
from service.dynamics.reduction.windows import REDUCTION_BITS, choose_window, find_windows
from workers.solvers.certified.fourier_time import (
    FourierTime,
    ProvenStrip,
    make_fourier_time,
    proven_strip,
    time_of_turn,
)
from workers.solvers.certified.orbit import is_the_only_one, passes_pole, start_on
from workers.solvers.certified.phase import LibrationPhase, RealLoop, RotationPhase
from workers.solvers.certified.time_model import TimeModel, make_time_model
from workers.solvers.certified.way import MotionPhase, PolarWay, way_of
from workers.solvers.complex_plane.angular_part import AngularSeries
from workers.solvers.complex_plane.complex_loop import ComplexLoop, unit_at_poles
from workers.solvers.errors import CertifiedUnavailableError, PrecisionNeededError

FindArc = Callable[[RigidBody, Potential, PlanarMotion], Arc | None]
"""Returns the arc of a motion, whose ends may be in doubt by a few roundings; None if it does not know."""

SHARES = (0.375, 0.625, 0.8125)
"""Places on the arc where the energy is taken: two at least are neither a pole nor the equator."""
WAY_BITS_MULTIPLE = 16
MOST_BITS_OF_INTEGRAL = 240
"""Bits of V1 beyond which its series would take minutes: 64 bits take some 6 s, and twice as many five times
as long."""
MIN_REST_SINE_OF_V = 2.0**-40
"""Least |sin v| at a rest point where V1 is an integral: nearer ones ask for more and more bits."""
MIN_ROOT_ORDER_AT_POLE = 8
"""Least order of the root of sin v at a pole where V1 is an integral."""
MOTIONS_CACHED = 4
NEWTON_TRIES = 12
MAX_NARROWING_FACTOR = 2.0**-8
"""Factor by which a step must narrow the radius of a zero, or else another step is not worth it."""


@dataclass(frozen=True)
class IntegralMotion:
    """A motion from its start on; to be asked at the precision it was made at."""

    phase: MotionPhase
    start: StartingPoint
    energy: arb
    bits: int
    """How well the period is wanted, relative to it."""

    @property
    def passes_pole(self) -> bool:
        """Say whether it goes through a pole."""
        return passes_pole(self.start.arc)

    @cached_property
    def strip(self) -> ProvenStrip | None:
        """Return where time is proven to be a holomorphic function of the phase; None if not by one strip."""
        phase = self.phase
        return None if isinstance(phase, PolarWay) or phase.curve.angular else proven_strip(phase)

    @cached_property
    def period(self) -> arb:
        """Return the period of all six variables."""
        if self.strip is None or isinstance(self.phase, PolarWay):
            return self.model.period
        return time_of_turn(self.phase, self.strip, self.bits)

    @cached_property
    def model(self) -> FourierTime | TimeModel:
        """Return time as a function of the phase, which samples need and the period alone does not."""
        if self.strip is None or isinstance(self.phase, PolarWay):
            return make_time_model(self.phase, self.bits)
        return make_fourier_time(self.phase, self.strip, self.bits)

    @cached_property
    def origin(self) -> arb:
        """Return the time of the start since θ = 0."""
        arc, v, direction = self.start.arc, self.start.v, self.start.direction
        if arc.is_whole_loop:
            return arb(0)
        if direction == 0:
            return arb(0) if abs(v - arc.lower) < abs(v - arc.upper) else self.model.span
        return direction * self.model.time_at(self.phase.phase(v))

    def states(self, times: Sequence[arb]) -> tuple[tuple[arb, ...], ...]:
        """Return (p, q, r, g1, g2, g3) in the client's axes."""
        if not times:
            return ()
        model = self.model
        phases = model.phases_at([t + self.origin for t in times])
        if isinstance(model, FourierTime) and not isinstance(self.phase, PolarWay):
            return tuple(self.phase.state(theta, model.rate(theta)) for theta in phases)
        return tuple(self.phase.state(theta) for theta in phases)


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
    window = choose_window(
        find_windows(body, potential, motion, precision=max(ctx.prec, REDUCTION_BITS)), motion
    )
    require_known_ends(window)
    if window.kind != "periodic":
        raise CertifiedUnavailableError(f"it is not periodic ({window.kind})", pointer="/motion")
    return window, starting_point(window, motion)


def motion_by_integral(
    body: RigidBody, potential: Potential, motion: PlanarMotion, bits: int, find_arc: FindArc | None = None
) -> IntegralMotion:
    """Return the motion, its period being wanted to so many bits; raises as the other two functions.

    What ``find_arc`` finds is proven. Where it does not decide, or the motion is not there, the windows
    are looked for in balls.
    """
    found = _known(body, potential, motion, bits)
    if found is None:
        found = _proved(body, potential, motion, bits, find_arc)
        _keep(body, potential, motion, found)
    return found


def _proved(
    body: RigidBody, potential: Potential, motion: PlanarMotion, bits: int, find_arc: FindArc | None
) -> IntegralMotion:
    arc = None if find_arc is None else find_arc(body, potential, motion)
    start = None if arc is None else start_on(arc, motion)
    if start is not None:
        try:
            found = integral_motion(start, bits)
            if is_the_only_one(start.arc, found.energy):
                return found
        except (PrecisionNeededError, CertifiedUnavailableError):
            pass
    return integral_motion(periodic_window(body, potential, motion)[1], bits)


def way_from(
    body: RigidBody, potential: Potential, motion: PlanarMotion, start: StartingPoint, bits: int
) -> IntegralMotion:
    """Return the motion from a known start, which :func:`motion_by_integral` then does not look for.

    Raises as :func:`integral_motion`.
    """
    found = _known(body, potential, motion, bits)
    if found is None:
        found = integral_motion(start, bits)
        _keep(body, potential, motion, found)
    return found


_Key = tuple[RigidBody, Potential | int, PlanarMotion, int, int, bool]
_KNOWN: dict[_Key | None, tuple[Potential, IntegralMotion]] = {}
"""The last MOTIONS_CACHED motions, the oldest first: other tiers and times of a problem ask for the same one.

While a potential is kept, no other has its number.
"""


def _known(body: RigidBody, potential: Potential, motion: PlanarMotion, bits: int) -> IntegralMotion | None:
    for wanted, is_way in ((bits, False), (way_bits(bits), True)):
        found = _KNOWN.get(_key(body, potential, motion, wanted, is_way))
        if found is not None:
            return found[1]
    return None


def _keep(body: RigidBody, potential: Potential, motion: PlanarMotion, found: IntegralMotion) -> None:
    _KNOWN[_key(body, potential, motion, found.bits, isinstance(found.phase, PolarWay))] = potential, found
    while len(_KNOWN) > MOTIONS_CACHED:
        # Another thread may have taken the oldest one away.
        _KNOWN.pop(next(iter(_KNOWN), None), None)


def _key(body: RigidBody, potential: Potential, motion: PlanarMotion, bits: int, is_way: bool) -> _Key:
    return body, potential if potential.has_formula else id(potential), motion, ctx.prec, bits, is_way


def integral_motion(start: StartingPoint, bits: int) -> IntegralMotion:
    """Return the motion from ``start`` on a periodic arc, at the current precision.

    Raises
    ------
    CertifiedUnavailableError
        The potential has no formula, or the motion is not analytic: told here or when it is asked.
    PrecisionNeededError
        The precision does not suffice, as above.
    """
    arc = start.arc
    loop = arc.loop
    passes = passes_pole(arc)
    side = 0 if passes else 1 if ((arc.lower + arc.upper) / 2).sin() > 0 else -1
    tape, angular = _parts(loop, side, bits)
    ends = () if passes else (arc.lower, arc.upper)
    if angular is not None and not all(abs(v.sin()) > MIN_REST_SINE_OF_V for v in ends):
        raise CertifiedUnavailableError(
            "it comes to rest next to a pole, and the potential is given by an integral", pointer="/motion"
        )
    unit = unit_at_poles(loop, tape) if passes else 0
    if passes and angular is not None:
        # No root of sin v makes it smooth there: pieces reach so far that the rest takes no time.
        unit = max(1, unit) * ceil(MIN_ROOT_ORDER_AT_POLE / max(1, unit))
    real = RealLoop(loop, tape, side, angular)
    h = _energy(arc, real) if angular is None else -angular.at_curve
    curve = ComplexLoop(loop, tape, h, side, unit, angular=angular)
    rests = (arc.lower, arc.upper)
    if not arc.is_whole_loop:
        rests = _zero(real, curve.h, arc.lower), _zero(real, curve.h, arc.upper)
    if not unit:
        turning = RotationPhase(curve, real, start.v, start.direction)
        phase = turning if arc.is_whole_loop else LibrationPhase(curve, real, *rests)
        found = IntegralMotion(phase, start, curve.h, bits)
        if not passes or found.strip is not None:
            return found
    # Pieces are fewer, and bounds closer, on one side of a pole at a time.
    there = way_of(replace(curve, unit=max(1, unit)), start, rests)
    way = IntegralMotion(there, start, curve.h, way_bits(bits))
    if not unit:
        try:
            way.model  # noqa: B018  made once, and asked for here
        except CertifiedUnavailableError:
            return found
    return way


def way_bits(bits: int) -> int:
    """Return to how many bits times through poles are computed: who asks for about as many gets the same."""
    return -(-bits // WAY_BITS_MULTIPLE) * WAY_BITS_MULTIPLE


def _parts(loop: Loop, side: int, bits: int) -> tuple[Tape, AngularSeries | None]:
    """Return the formula of V where sin v has this sign, or on both sides for 0, and the integral."""
    potential = loop.potential
    if not isinstance(potential, GeneralPotential):
        return potential.tape, None
    primed = [(loop.g1_sign, sign) for sign in ((side,) if side else (1, -1))]
    first, *others = (potential.piece(*(signs[::-1] if loop.mirrored else signs)) for signs in primed)
    if any(other != first for other in others):
        raise CertifiedUnavailableError(
            "it passes a pole between quadrants on which F or G differ", pointer="/potential"
        )
    if bits > MOST_BITS_OF_INTEGRAL:
        raise CertifiedUnavailableError(
            f"it needs {bits} bits, and {MOST_BITS_OF_INTEGRAL} are computed of a potential given by an "
            'integral; accepted are "bits": 64 and 128',
            pointer="/accuracy/bits",
        )
    return first.even.tape, AngularSeries(loop, first.angular, bits)


def _energy(arc: Arc, real: RealLoop) -> arb:
    """Return h, which must be the same all along the arc.

    h = V + Q D / (2 (A − C) g1 g3), in the client's axes: two places where it differs refute the potential.
    """
    loop = arc.loop
    A, C = (loop.C, loop.A) if loop.mirrored else (loop.A, loop.C)
    a, c, difference = ball(A), ball(C), ball(2 * (A - C))
    found = []
    for share in SHARES:
        g1, g2, g3 = real.gamma((arc.lower + (arc.upper - arc.lower) * share).mid())
        V, D = loop.potential.value_and_D_ball(g1, g2, g3)
        h = V + (a * g1 * g1 + c * g3 * g3) * D / (difference * g1 * g3)
        if h.is_finite():
            found.append(h)
        if len(found) == 2:
            break
    else:
        raise PrecisionNeededError("the energy")
    first, second = found
    if not first.overlaps(second):
        raise CertifiedUnavailableError("the potential is not admissible on this curve", pointer="/potential")
    return first.intersection(second)


def _zero(real: RealLoop, h: arb, v: arb) -> arb:
    """Return the enclosure of the one zero of N in or about ``v``, proven by the interval Newton method."""
    guess = v
    for _ in range(NEWTON_TRIES):
        slope = -real.slope(guess)
        middle = guess.mid()
        found = middle - (h - real.V(middle)) / slope
        if not found.is_finite():
            break
        if guess.contains(found):
            return _narrowed(real, h, found, slope)
        guess = arb(middle, (4 * abs(found - middle)).abs_upper())
    raise PrecisionNeededError("a rest point")


def _narrowed(real: RealLoop, h: arb, zero: arb, slope: arb) -> arb:
    """Return the zero again and again from the midpoint, while that narrows it."""
    while True:
        middle = zero.mid()
        found = middle - (h - real.V(middle)) / slope
        if not found.rad() < MAX_NARROWING_FACTOR * zero.rad():
            return zero
        zero = found
