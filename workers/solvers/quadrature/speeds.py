r"""Bounds of (dθ/dt)² along a libration, a rotation and a flight, for one formula of the potential.

Regions are chains of rectangles that are symmetric about the real axis. One that holds a turning
point has P and its divisor vanish together; by the maximum principle

.. math:: \sup_R \Bigl|\frac{f}{g}\Bigr| \le \frac{\sup_R |f|}{\min_{\partial R} |g|}

if f/g is holomorphic on R: the divisors are elementary, and their least values on the border
are known.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from flint import acb, arb

from workers.solvers.orbits.orbit import Libration, Rotation
from workers.solvers.quadrature.complex_radicand import (
    UNKNOWN,
    ComplexRadicand,
    border,
    has_no_point,
    least_sine_squared,
)
from workers.solvers.quadrature.ellipse import PhaseSpeed
from workers.solvers.quadrature.flight import Flight

T = TypeVar("T", arb, acb)


class Speed(PhaseSpeed, Protocol):
    """The bounds along an orbit or a flight for one formula."""

    @property
    def radicand(self) -> ComplexRadicand:
        """P along the loop, at complex places."""
        ...

    def place(self, theta: arb) -> arb:
        """Return v."""
        ...


@dataclass(frozen=True, slots=True)
class LibrationSpeed:
    """c² K / Z², K = P / (h² sin²θ)."""

    orbit: Libration
    radicand: ComplexRadicand

    def bound(self, chain: Sequence[acb], *, is_close: bool) -> arb:
        """See PhaseSpeed.bound."""
        largest = _largest(self.radicand.bound(self.place(theta), is_close=is_close) for theta in chain)
        return largest / (self._factor * least_sine_squared(chain))

    def enclosed(self, theta: arb) -> arb:
        """See PhaseSpeed.enclosed."""
        return self.radicand.enclosed(self.place(theta)) / (self._factor * theta.sin() ** 2)

    def limit(self, theta: arb) -> arb | None:
        """See PhaseSpeed.limit."""
        v, loop = self.place(theta), self.orbit.loop
        if (theta / arb.pi()).contains_integer():
            return loop.Z * ((self.orbit.upper - self.orbit.lower) / self.radicand.slope(v)).sqrt()
        if not has_no_point(v):
            return None
        return (self._factor / self.radicand.limit(v)).sqrt() * abs(theta.sin())

    @property
    def _factor(self) -> arb:
        return ((self.orbit.upper - self.orbit.lower) / 2 * self.orbit.loop.Z) ** 2

    def place(self, theta: T) -> T:
        """Return v, from the nearer turning point: balls there are far smaller than those of θ."""
        sine, cosine = (theta / 2).sin_cos()
        width = self.orbit.upper - self.orbit.lower
        if abs(sine).mid() < abs(cosine).mid():
            return self.orbit.lower + width * sine * sine
        return self.orbit.upper - width * cosine * cosine


@dataclass(frozen=True, slots=True)
class RotationSpeed:
    """c² P / Z²."""

    orbit: Rotation
    radicand: ComplexRadicand

    def bound(self, chain: Sequence[acb], *, is_close: bool) -> arb:
        """See PhaseSpeed.bound."""
        largest = _largest(self.radicand.bound(self.place(theta), is_close=is_close) for theta in chain)
        return largest / self.orbit.loop.Z**2

    def enclosed(self, theta: arb) -> arb:
        """See PhaseSpeed.enclosed."""
        return self.radicand.enclosed(self.place(theta)) / self.orbit.loop.Z**2

    def limit(self, theta: arb) -> arb | None:
        """See PhaseSpeed.limit."""
        v = self.place(theta)
        return self.orbit.loop.Z * self.radicand.limit(v).rsqrt() if has_no_point(v) else None

    def place(self, theta: T) -> T:
        """Return v."""
        return self.orbit.origin + self.orbit.direction * theta


@dataclass(frozen=True, slots=True)
class FlightSpeed:
    """16 c² P cosh⁴(y/2) / (Z L)²; with a rest point c² P cosh⁶(y/2) / (Z L sinh(y/2))²."""

    flight: Flight
    radicand: ComplexRadicand

    def bound(self, chain: Sequence[acb], *, is_close: bool) -> arb:
        """See PhaseSpeed.bound."""
        phases = [self._phase(theta) for theta in chain]
        largest = _largest(self._share(y, is_close=is_close) for y in phases)
        return largest / (
            self._divisor * _least_sinh_squared(phases) if self.flight.has_rest else self._divisor
        )

    def enclosed(self, theta: arb) -> arb:
        """See PhaseSpeed.enclosed."""
        y = self._phase(theta)
        found = self.radicand.enclosed(self._place(y)) * self._power(y)
        return found / (self._divisor * (y / 2).sinh() ** 2 if self.flight.has_rest else self._divisor)

    def limit(self, theta: arb) -> arb | None:
        """See PhaseSpeed.limit."""
        y = self._phase(theta)
        v = self._place(y)
        if self.flight.has_rest and y.contains(0):
            length = self.flight.arc.upper - self.flight.arc.lower
            return self.flight.loop.Z * self._scale * (length / self.radicand.slope(v)).sqrt()
        if not has_no_point(v):
            return None
        squared = self.radicand.limit(v) * self._power(y) / self._divisor
        return (squared / (y / 2).sinh() ** 2 if self.flight.has_rest else squared).rsqrt()

    def _share(self, y: acb, *, is_close: bool) -> arb:
        return self.radicand.bound(self._place(y), is_close=is_close) * abs(self._power(y))

    @property
    def _scale(self) -> arb:
        return (arb(self.flight.last) - arb(self.flight.first)) / (2 * arb.pi())

    @property
    def _divisor(self) -> arb:
        length = self.flight.arc.upper - self.flight.arc.lower
        return (self.flight.loop.Z * length * self._scale) ** 2

    def _phase(self, theta: T) -> T:
        return self.flight.first + self._scale * theta

    def _power(self, y: T) -> T:
        return (y / 2).cosh() ** 6 if self.flight.has_rest else 16 * (y / 2).cosh() ** 4

    def place(self, theta: arb) -> arb:
        """Return v."""
        return self._place(self._phase(theta))

    def _place(self, y: T) -> T:
        """Return v, from the nearer end of the arc."""
        flight = self.flight
        if flight.has_rest:
            # 1/cosh² and tanh² of y/2: by one exponential, whose balls are close.
            decay = (-y if y.real > 0 else y).exp() if isinstance(y, acb) else (-abs(y)).exp()
            left, gone = 4 * decay / (1 + decay) ** 2, ((1 - decay) / (1 + decay)) ** 2
            above, below = (gone, left) if flight.direction > 0 else (left, gone)
        else:
            share = (flight.direction * y).exp()
            above, below = 1 / (1 + 1 / share), 1 / (1 + share)
        lower, length = flight.arc.lower, flight.arc.upper - flight.arc.lower
        is_low = abs(above.mid()) < abs(below.mid())
        return lower + length * above if is_low else flight.arc.upper - length * below


def _largest(bounds: Iterable[arb]) -> arb:
    """Return the largest; not finite if one of them is not, and the others are not asked."""
    largest = arb(0)
    for found in bounds:
        if not found.is_finite():
            return UNKNOWN
        largest = largest.max(found)
    return largest


def _least_sinh_squared(chain: Sequence[acb]) -> arb:
    """Return a lower bound of |sinh(y/2)|² on the border, or everywhere if it has no zero inside.

    It is sinh² + sin² of the halves of the real and the imaginary part, the latter below π/2.
    """
    left, right, height = (value / 2 for value in border(chain))
    ends = (left.sinh() ** 2).min(right.sinh() ** 2)
    if left > 0 or right < 0:
        return ends.lower()
    if not all(part.imag.rad() < arb.pi() for part in chain):
        return UNKNOWN
    return ends.min(height.sin() ** 2).lower()
