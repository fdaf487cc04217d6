"""The precession per period in compiled doubles; apart, since it loads the compiler.

Motions that doubles do not decide are left to balls.

Single jobs and sweeps call this same function.
"""

from collections.abc import Callable

from service.dynamics.body import RigidBody
from service.dynamics.numerics import is_within
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.solution.dense_output import TURN, TURN_LOW, Advance
from workers.solvers.compiled.frame import make_frame
from workers.solvers.compiled.records import Records, copied
from workers.solvers.compiled.solve_set import advance_of
from workers.solvers.orientation.advance import loop_advances

SUM_ERROR = 2.0**-102
"""Error of a sum with 2π in two doubles: 2^-105 of 2π, and half an ulp of what is left, 2^-50 at most."""
MAX_ADVANCE_ERROR = 1e-13
"""Largest error of an advance: a curve that is so extreme that doubles know it worse is left to balls."""


def advances_on(body: RigidBody, motion: PlanarMotion) -> Callable[[Loop, int], tuple[Advance, Advance]]:
    """Return the function for the curve of a motion: :func:`.advance.loop_advances`, by doubles first."""
    frame = make_frame(body, motion)

    def advances(loop: Loop, sense: int) -> tuple[Advance, Advance]:
        found = None if frame is None else advances_by_doubles(frame.shared, sense)
        return loop_advances(loop, sense) if found is None else found

    return advances


def advances_by_doubles(loops: Records, sense: int) -> tuple[Advance, Advance] | None:
    """Return what ψ1 and ψ3 gain when a motion goes round the only loop once; None if doubles do not decide.

    ``sense`` is the sign of s g1 g3.
    """
    loops = copied(loops)
    first, error = advance_of(loops)
    if not is_within(error, MAX_ADVANCE_ERROR):
        return None
    rest, lo = _sum_of_turn(-first)
    # The mirror to A < C exchanges the axes and turns ψ round.
    alone, summed = Advance(sense * first, 0.0, error), Advance(sense * rest, sense * lo, error + SUM_ERROR)
    return (summed, _turned(alone)) if loops[0]["mirrored"] else (alone, _turned(summed))


def _turned(advance: Advance) -> Advance:
    """Return the same in the other sense."""
    return Advance(0.0 - advance.hi, 0.0 - advance.lo, advance.error)


def _sum_of_turn(value: float) -> tuple[float, float]:
    """Return the sum of 2π and a value of at most that size in two doubles (Dekker)."""
    hi = TURN + value
    left = value - (hi - TURN) + TURN_LOW
    rounded = hi + left
    return rounded, left - (rounded - hi)
