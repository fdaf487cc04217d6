"""Periodic motions in compiled doubles, as a family of solvers that the chooser can ask.

The compiler is loaded, and the first time run, only by those who need it: modules with kernels are imported
by the functions that call them.
"""

from dataclasses import dataclass
from math import atan2
from typing import TYPE_CHECKING, Literal

import numpy as np
from flint import arb

from service.dynamics.body import RigidBody
from service.dynamics.motion import Motion
from service.dynamics.numerics import is_within
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion, Problem, StartAtEquator
from service.dynamics.reduction.geometry.loop import Loop, make_loop, start_g3_sign
from service.dynamics.reduction.window import Arc, Window
from workers.solvers.assembly.families import (
    NOT_MINE,
    Declined,
    PeriodicPlace,
    Place,
    Sampled,
    asked_times,
    conventions_of,
    make_periodic,
)
from workers.solvers.errors import is_known
from workers.solvers.ways import is_plain

if TYPE_CHECKING:
    from workers.solvers.compiled.motion import SpectralMotion

CompiledTier = Literal["draft", "standard", "high"]
"""The tiers that have a kernel."""
SAME_END_CHANGE = 1e-6
"""Departure of g1 at its ends within which two solvers speak of one window."""
END_DOUBT = 2.0**-44
"""Error of an end of the arc, in v."""


@dataclass(frozen=True, slots=True)
class CompiledFamily:
    """One kernel, for whoever its claim satisfies; see :class:`workers.solvers.assembly.families.Family`."""

    kernel: CompiledTier

    def takes(self, problem: Problem, place: Place) -> bool:
        """Take periodic motions, save those that need to tell when a pole is passed by a convention.

        The certified tier has a grade of its own, which is not one of doubles. The plain way has no kernels.
        """
        if is_plain():
            return False
        is_periodic = isinstance(place, PeriodicPlace) and isinstance(problem.motion, PlanarMotion)
        return is_periodic and problem.accuracy.tier != "certified" and not conventions_of(place.start)

    def promise(self, problem: Problem) -> float:
        """Promise the tolerance at all asked times."""
        return problem.tolerance

    def solve(self, problem: Problem, place: Place) -> Motion | Declined:
        """Return the motion; declined if it is not the one in the window, or worse than the tolerance."""
        from workers.solvers.compiled.solve import solve_spectral  # noqa: PLC0415

        motion = problem.motion
        if not isinstance(place, PeriodicPlace) or not isinstance(motion, PlanarMotion):
            return NOT_MINE
        found = solve_spectral(problem.body, problem.potential, motion, tier=self.kernel)
        if found is None or not is_in_window(place.window, found):
            return NOT_MINE
        period = found.period
        end = np.array([period.hi])
        asked = asked_times(problem, period)
        times = asked.doubles if problem.wants_series else end
        if not is_within(found.error_at(times), self.promise(problem)):
            return Declined(found.error_at(times))
        if not is_known(period, self.promise(problem)):
            # Within a few periods its samples may be good enough for all that.
            return Declined(period.error / period.hi)
        error = found.error_at(end)
        evidence: dict[str, float | int | str] = {"compiled": len(found.panels), "rounding": error}
        # Times are counted from the start: the equator is where it is, other starts are rounded.
        crosses = motion.start is None and place.window.ends[1] == "equator"
        is_exact = crosses or isinstance(motion.start, StartAtEquator)
        apart = found.place_error(self.kernel, ends=1 if is_exact else 2)
        sampled = Sampled(
            found.sample, period, np.zeros(0), error, evidence, found, place_error=apart, asked=asked
        )
        return make_periodic(problem, place, sampled)


def arc_in_doubles(body: RigidBody, potential: Potential, motion: PlanarMotion) -> Arc | None:
    """Return the arc of the motion, its ends in doubt by roundings; None where doubles do not decide."""
    if is_plain():
        return None
    from workers.solvers.compiled.solve import solve_spectral  # noqa: PLC0415

    found = solve_spectral(body, potential, motion, tier="draft")
    if found is None:
        return None
    loop = make_loop(body, potential, motion)
    return _arc(found, loop, start_g3_sign(loop, motion))


def is_in_window(window: Window, found: "SpectralMotion") -> bool:
    """Tell whether a motion has the ends of the window, and so is the one in it."""
    return found.ends == window.ends and all(
        abs(one - other) <= SAME_END_CHANGE for one, other in zip(found.g1, window.g1, strict=True)
    )


def _arc(found: "SpectralMotion", loop: Loop, g3_sign: int) -> Arc:
    orbit = found.loop
    if orbit.rotates:
        base = arb(0) if g3_sign > 0 else -arb.pi()
        return Arc(loop, base, base + 2 * arb.pi(), None, None)
    middle, half = atan2(orbit.s_middle, orbit.c_middle), float(orbit.half_width)
    return Arc(loop, arb(middle - half, END_DOUBT), arb(middle + half, END_DOUBT), "rest", "rest")
