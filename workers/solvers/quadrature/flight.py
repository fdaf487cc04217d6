r"""Parametrises aperiodic planar motions: separatrices, collisions, ends at a pole.

An arc of the loop with at least one end that is not a rest point is covered by
a phase y that runs through all real numbers and grows with time; L is the
length of the arc, δ the distance from its terminal end.

Two terminal ends, in the direction σ:

.. math:: v = v_- + \frac{L}{1+e^{-\sigma y}} ,\qquad \frac{dt}{dy} = \frac{Z L}{4 c\sqrt P\cosh^2(y/2)} .

One rest point v_r (a simple zero of P), where the motion turns back at y = 0:

.. math:: |v - v_r| = L\tanh^2\frac y2,\quad P = |v-v_r|\,K,\qquad
          \frac{dt}{dy} = \frac{Z\sqrt L}{c\sqrt K\cosh^2(y/2)} .

Either way δ ~ e^{-|y|}. At a double zero of P, where √P ~ κδ, dt/dy tends to
Z/(cκ): the end is approached exponentially and never reached. Where √P falls
off more slowly, or diverges (a collision), dt/dy dies out and the end is
reached in finite time.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

from flint import arb

from service.dynamics.motion import Asymptote, Estimate
from service.dynamics.reduction.geometry.loop import Loop, LoopPoint
from service.dynamics.reduction.window import Arc, ArcEnd, StartingPoint
from workers.solvers.orbits.orbit import RATE_NUDGE, STATE_NUDGE, six_variables

FARTHEST_Y = 48.0
"""|y| where an end that is never reached is as good as reached: e^-48 is 1e-5 of a double's rounding."""
FARTHEST_FINITE_Y = 960.0
"""|y| up to which the time of arrival at an end is followed: δ is 2^-1385, where the windows are known."""
ARRIVED_MAX_RATE_SHARE = 1e-21
"""Share of the rate at the start below which nothing of the time of arrival is missing."""
LIMIT_MIN_Y = 24.0
"""|y| where what happens at the end can be told: δ is 1e-10 of the arc."""
STEADY_MAX_RELATIVE_CHANGE = 1e-4
"""Relative change of dt/dy by one unit of y, far out, below which it has a limit."""


@dataclass(frozen=True, slots=True)
class Flight:
    """An aperiodic planar motion as a function of θ, 0 ≤ θ ≤ 2π standing for y_- ≤ y ≤ y_+."""

    arc: Arc
    direction: int
    """Sign of dv/dy; with a rest point, of dv/dy after it."""
    has_rest: bool
    first: float
    """y_-: the earliest phase."""
    last: float
    """y_+: the latest."""
    phase: arb
    """y at t = 0."""

    @property
    def loop(self) -> Loop:
        """The loop of the arc."""
        return self.arc.loop

    @property
    def start(self) -> float:
        """Return u = θ/π at t = 0, in [0, 2], but for its rounding."""
        return 2.0 * (float(self.phase) - self.first) / (self.last - self.first)

    @property
    def after_start(self) -> arb:
        """Return the time from the rounded ``start`` to t = 0: dt/du is many times that of all the motion."""
        at = self._y(arb.pi() * self.start)
        return (self.phase - at) * self.rate_of_phase(at)

    @property
    def is_even(self) -> bool:
        """Say whether dt/dθ takes the same value at θ and 2π − θ: with a rest point in the middle."""
        return self.has_rest and self.first == -self.last

    @property
    def junctions(self) -> tuple[float, ...]:
        """Return no u: dt/dθ is smooth but for the poles."""
        return ()

    @property
    def corners(self) -> tuple[float, ...]:
        """Return u in (0, 2) where the motion passes a pole."""
        phases = [float(self._phase_of(pole)) for pole in self.arc.poles]
        both = [*phases, *(-y for y in phases)] if self.has_rest else phases
        shares = (2.0 * (y - self.first) / (self.last - self.first) for y in both)
        return tuple(sorted(u for u in shares if 0.0 < u < 2.0))

    def somewhere(self) -> arb:
        """Return a v of the arc at which nothing special happens."""
        return (2 * self.arc.lower + self.arc.upper) / 3

    def rate(self, theta: arb) -> arb:
        """Return dt/dθ > 0."""
        return self.rate_of_phase(self._y(theta)) * self._scale

    def rate_of_phase(self, y: arb) -> arb:
        """Return dt/dy > 0."""
        at, root, y = self._beside(y, RATE_NUDGE)
        L, cosh = self._length, (y / 2).cosh()
        factor = L.sqrt() if self.has_rest else L / 4
        return self.loop.Z * factor / (at.c * root * cosh * cosh)

    def state(self, theta: arb) -> tuple[arb, ...]:
        """Return (p, q, r, g1, g2, g3) in the client's axes."""
        at, root, y = self._beside(self._y(theta), STATE_NUDGE)
        # p = -(Z/c) dv/dt, and √P = √L |tanh(y/2)| √K with a rest point.
        p = -self.direction * root
        return six_variables(self.loop, at, p * (y / 2).tanh() * self._length.sqrt() if self.has_rest else p)

    @property
    def _length(self) -> arb:
        return self.arc.upper - self.arc.lower

    @property
    def _scale(self) -> arb:
        return (arb(self.last) - arb(self.first)) / (2 * arb.pi())

    def _y(self, theta: arb) -> arb:
        return self.first + self._scale * theta

    def _beside(self, y: arb, nudge: arb) -> tuple[LoopPoint, arb, arb]:
        at, root = self._at(y)
        if at.c.is_finite() and root.is_finite():
            return at, root, y
        return *self._at(y + nudge), y + nudge

    def _at(self, y: arb) -> tuple[LoopPoint, arb]:
        """Return the point and √K with a rest point, √P without."""
        if self.has_rest:
            gone = self._length * (y / 2).tanh() ** 2
            left = self._length / (y / 2).cosh() ** 2
            point = self._point(gone, left) if self.direction > 0 else self._point(left, gone)
            return point, (point.P / gone).sqrt()
        share = self.direction * y
        point = self._point(self._length / (1 + (-share).exp()), self._length / (1 + share.exp()))
        return point, point.P.sqrt()

    def _point(self, above: arb, below: arb) -> LoopPoint:
        """Return the point this far above the lower end and below the upper one, from the nearer."""
        return self.loop.point(self.arc.lower + above if above < below else self.arc.upper - below)

    def _phase_of(self, v: arb) -> arb:
        """Return y ≥ 0 after a rest point, or y."""
        above, below = v - self.arc.lower, self.arc.upper - v
        if not self.has_rest:
            return self.direction * (above / below).log()
        gone, left = (above, below) if self.direction > 0 else (below, above)
        return 2 * (gone.nonnegative_part() / left).sqrt().asinh()


def make_flight(start: StartingPoint) -> Flight:
    """Return the motion through a starting point of an arc that is not periodic, over all phases."""
    arc = start.arc
    has_rest = "rest" in (arc.lower_end, arc.upper_end)
    direction = (1 if arc.lower_end == "rest" else -1) if has_rest else start.direction
    flight = Flight(arc, direction, has_rest, -FARTHEST_Y, FARTHEST_Y, arb(0))
    phase = flight._phase_of(start.v)
    # Towards its rest point the motion is before it.
    return replace(flight, phase=-phase if has_rest and start.direction == -direction else phase)


@dataclass(frozen=True, slots=True)
class Reach:
    """The phase that is reached in one direction of time, and the end of the arc ahead."""

    y: float
    end: ArcEnd
    nature: Literal["finite", "exponential", "slow"]
    """How the end is approached."""


def reach(flight: Flight, side: int, asked: float) -> Reach:
    """Return the phase that covers the time |t| ≤ ``asked`` on one ``side`` (1 future, −1 past)."""
    terminal = flight.arc.upper_end if side * flight.direction > 0 else flight.arc.lower_end
    if flight.has_rest:
        terminal = flight.arc.upper_end if flight.direction > 0 else flight.arc.lower_end
    if terminal is None:
        raise ValueError("the arc is the whole loop")

    def rate(distance: float) -> float:
        return float(flight.rate_of_phase(arb(side * distance)))

    change = rate(LIMIT_MIN_Y) / rate(LIMIT_MIN_Y - 1.0) - 1.0
    # A collision is reached in finite time, even if P is like that of a pole until shortly before it.
    if change < -STEADY_MAX_RELATIVE_CHANGE or terminal == "collision":
        return Reach(side * _arrival(rate, side * float(flight.phase)), terminal, "finite")
    begin = max(0.0, side * float(flight.phase))
    y, time, previous = begin, 0.0, rate(begin)
    while y < FARTHEST_Y and time <= 1.25 * asked + 1e-3 * previous:
        y, following = y + 1.0, rate(y + 1.0)
        time, previous = time + 0.5 * (previous + following), following
    far = min(max(y + 1.0, 2.0), FARTHEST_Y)
    return Reach(side * far, terminal, "exponential" if change <= STEADY_MAX_RELATIVE_CHANGE else "slow")


def _arrival(rate: Callable[[float], float], phase: float) -> float:
    """Return the distance beyond which no time passes any more."""
    start, y = rate(max(0.0, phase)), FARTHEST_Y
    while rate(y) > ARRIVED_MAX_RATE_SHARE * start and y < FARTHEST_FINITE_Y:
        y *= 1.5
    return y


def asymptote(flight: Flight, found: Reach, arrival: Estimate | None) -> Asymptote:
    """Return what the motion tends to where ``found`` leads."""
    loop, side = flight.loop, 1 if found.y > 0 else -1
    upper = (flight.direction if flight.has_rest else side * flight.direction) > 0
    v = flight.arc.upper if upper else flight.arc.lower
    gamma = _position(loop, v)
    kind: Literal["equilibrium", "pole", "collision"] = "equilibrium"
    if found.end == "collision" or found.end == "pole":
        kind = found.end
    rate = None
    if found.nature == "exponential":
        near, far = (1 / flight.rate_of_phase(arb(side * y)) for y in (FARTHEST_Y - 8, FARTHEST_Y))
        error = abs(float(far - near)) + float(far.rad()) + 2e-16 * float(far)
        rate = Estimate(float(far), error, "difference")
    return Asymptote(kind, arrival if found.nature == "finite" else None, rate, gamma)


def _position(loop: Loop, v: arb) -> tuple[float, float, float]:
    """Return (g1, g2, g3) at v, which may be a pole or on the equator."""
    sine, cosine = v.sin_cos()
    if sine.contains(arb(0)):
        return 0.0, 1.0 if cosine > 0 else -1.0, 0.0
    on_equator = abs(cosine) < STATE_NUDGE
    *_, g1, g2, g3 = six_variables(loop, loop.point(v + STATE_NUDGE if on_equator else v), arb(0))
    return float(g1), 0.0 if on_equator else float(g2), float(g3)
