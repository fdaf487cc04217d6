"""The input of every family of solvers besides the problem, and the answer of one that declines."""

from dataclasses import dataclass

from service.dynamics.reduction.start import StartingPoint
from service.dynamics.reduction.window import Window
from workers.solvers.orbits.near_rest import SlowOrbit, slow_orbit
from workers.solvers.orbits.orbit import Libration, Rotation, make_orbit

PeriodicOrbit = Libration | Rotation | SlowOrbit


@dataclass(frozen=True, slots=True)
class Place:
    """The window of a planar motion and where in it the motion starts, in balls of the current precision."""

    window: Window
    start: StartingPoint


@dataclass(frozen=True, slots=True)
class PeriodicPlace(Place):
    """A place in a periodic window, with the motion there as a function of its phase."""

    orbit: PeriodicOrbit


@dataclass(frozen=True, slots=True)
class Declined:
    """A family's answer that it leaves the motion to the next one; what it found is worth nothing."""

    reached: float
    """Largest error that it showed; inf if it did not come so far."""


NOT_MINE = Declined(float("inf"))


def periodic_place(place: Place) -> PeriodicPlace:
    """Return the place with its orbit, which keeps its digits next to a rest.

    Raises
    ------
    PrecisionLostError
        More bits are needed.
    """
    orbit = slow_orbit(place.start) or make_orbit(place.start)
    return PeriodicPlace(place.window, place.start, orbit)
