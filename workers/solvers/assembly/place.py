"""The input of every family of solvers besides the problem, and the answer of one that declines."""

from dataclasses import dataclass, field

from flint import arb

from service.dynamics.motion import Motion
from service.dynamics.reduction.start import StartingPoint
from service.dynamics.reduction.window import Window
from workers.solvers.orbits.near_rest import SlowOrbit, is_slow, slow_orbit
from workers.solvers.orbits.orbit import Libration, Rotation, make_orbit, somewhere_on

PeriodicOrbit = Libration | Rotation | SlowOrbit


@dataclass(frozen=True, slots=True)
class Place:
    """The window of a planar motion and where in it the motion starts, in balls of the current precision."""

    window: Window
    start: StartingPoint


@dataclass(frozen=True, slots=True)
class PeriodicPlace(Place):
    """A place in a periodic window."""

    _orbits: list[PeriodicOrbit] = field(default_factory=list, init=False, compare=False, repr=False)

    @property
    def orbit(self) -> PeriodicOrbit:
        """Return the motion as a function of its phase, which keeps its digits next to a rest.

        It is made where it is asked for: compiled solvers do without.

        Raises
        ------
        PrecisionLostError
            More bits are needed.
        """
        if not self._orbits:
            self._orbits.append(slow_orbit(self.start) or make_orbit(self.start))
        return self._orbits[0]

    def somewhere(self) -> arb:
        """Return a v of the orbit at which nothing special happens; raises as :attr:`orbit`."""
        arc = self.start.arc
        return self.orbit.somewhere() if is_slow(arc) else somewhere_on(arc)


@dataclass(frozen=True, slots=True)
class Declined:
    """A family's answer that it leaves the motion to the next one."""

    reached: float
    """Largest error that it showed; inf if it did not come so far."""
    found: Motion | None = None
    """A motion that is worse than was claimed and asked for, with the error that it showed."""


NOT_MINE = Declined(float("inf"))


def periodic_place(place: Place) -> PeriodicPlace:
    """Return the place as one in a periodic window."""
    return PeriodicPlace(place.window, place.start)
