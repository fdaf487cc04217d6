"""The protocol that every family of solvers in the table implements.

A family computes a planar motion as a function of time. To add one, write ``family.py`` in its room, name it
in :mod:`.table`, and fulfil these duties:

1. ``takes`` says whether the family may have a motion, at the cost of a glance: no compiler is loaded,
   nothing is solved. A family that takes a motion may still decline it.
2. ``promise`` says how large the error of a sample may be that the family hands over. What it finds worse, it
   declines. A family that promises nothing (inf) is the last of its row, or knows that no other does better.
3. ``solve`` returns the very motion of the place: the one in this window, from this start. Where the family
   finds another window, or cannot tell, it declines. It never guesses.
4. What it claims, it knows: the error of the motion bounds that of all six variables at the asked times, and
   the error of its dense output bounds them at all times. What the motion itself shows (its energy, its
   equations) is held against the claim by :func:`workers.solvers.assembly.periodic.make_periodic`, which
   declines what cannot be believed.
5. It works at the precision of balls at which it is called, and leaves it as it was. Where that is too low,
   it raises :class:`~workers.solvers.errors.PrecisionLostError`, and is called again with twice the bits.
6. A motion that no family can compute is refused by an error that says why. That the *next* family may have
   it is said by :class:`~workers.solvers.assembly.place.Declined`.
7. It is a leaf: it imports no other family, reads no clock, file or setting, and its numbers depend on
   nothing but what it is given.
8. Digits that change raise ``NUMERICS``.
"""

from typing import Protocol

from service.dynamics.motion import Motion
from service.dynamics.problem import Problem
from workers.solvers.assembly.place import Declined, Place


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
