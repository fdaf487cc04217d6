"""The protocol of solver families: input, duties, answers, and the description of a motion.

A family computes a planar motion as a function of time. To add one, write ``family.py`` in its folder, name
it in :mod:`workers.solvers.choose`, and fulfil these duties:

1. ``takes`` says whether the family may have a motion, at the cost of a glance: no compiler is loaded,
   nothing is solved. A family that takes a motion may still decline it.
2. ``promise`` says how large the error of a sample may be that the family hands over. What it finds worse, it
   declines. A family that promises nothing (inf) is the last of its row, or knows that no other does better.
3. ``solve`` returns the very motion that is asked for: the one in this window, from this start. Where the
   family finds another window, or cannot tell, it declines. It never guesses.
4. What it claims, it knows: the error of the motion bounds that of all six variables at the asked times, and
   the error of its dense output bounds them at all times. What the motion itself shows (its energy, its
   equations) is compared with the claim by :func:`workers.solvers.assembly.periodic.make_periodic`, which
   declines what cannot be believed.
5. It works at the precision of balls at which it is called, and leaves it as it was. Where that is too low,
   it raises :class:`~workers.solvers.errors.PrecisionLostError`, and is called again with twice the bits.
6. A motion that no family can compute is refused by an error that says why. That the *next* family may have
   it is said by :class:`Declined`.
7. It is a leaf: it imports no other family, reads no clock, file or setting, and its numbers depend on
   nothing but what it is given.
8. Digits that change raise ``NUMERICS``.
"""

from dataclasses import dataclass, field
from math import inf, nextafter
from typing import Protocol

from flint import arb

from service.dynamics.motion import Estimate, Motion
from service.dynamics.numerics import ErrorKind
from service.dynamics.problem import Problem
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.window import StartingPoint, Window
from workers.solvers.assembly.dense import ResolvedMotion
from workers.solvers.orbits.near_rest import SlowOrbit, is_slow, slow_orbit
from workers.solvers.orbits.orbit import RATE_NUDGE, Libration, Rotation, make_orbit, somewhere_on

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


class Family(Protocol):
    """A family of solvers for planar motions; the duties are those of this module."""

    def takes(self, problem: Problem, place: Place) -> bool:
        """Say at a glance whether the motion may be one for this family."""
        ...

    def promise(self, problem: Problem) -> float:
        """Return the largest error of a sample that is handed over, absolute; inf if nothing is promised."""
        ...

    def solve(self, problem: Problem, place: Place) -> Motion | Declined:
        """Return the motion from the start of ``place``, or leave it to the next family."""
        ...


SYMMETRIC_POLE_PASSAGE = "symmetric_pole_passage"
"""At a pole where the equations allow several continuations g1 keeps its sign and g3 flips (A > C)."""


def conventions_of(start: StartingPoint) -> tuple[str, ...]:
    """Return the conventions that motions on the arc of ``start`` need."""
    arc = start.arc
    if arc.loop.is_smooth_at_poles():
        return ()
    return (SYMMETRIC_POLE_PASSAGE,) if arc.is_whole_loop or arc.poles else ()


def energy_of(loop: Loop, v: arb) -> Estimate:
    """Return the energy of the motions on the loop, from the place ``v`` on it."""
    h = loop.energy(v)
    if not h.is_finite():
        h = loop.energy(v + RATE_NUDGE)
    # What is 0 is not told as the rest of a cancellation.
    value = 0.0 if h.contains(0) else float(h.mid())
    # Balls of a potential given by an integral hold what its series is seen to leave out.
    kind: ErrorKind = "theorem" if loop.potential.has_formula else "estimate"
    return Estimate(value, nextafter(float(abs(h - value).abs_upper()), inf), kind)


def evidence_of(resolved: ResolvedMotion) -> dict[str, float | int | str]:
    """Return what the dense output took."""
    return {
        "pieces": len(resolved.breaks) - 1,
        "states": resolved.evaluations,
        "departure": resolved.departure,
    }
