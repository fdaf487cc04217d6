"""Describes a planar motion besides its numbers: energy, conventions, evidence."""

from math import inf, nextafter

from flint import arb

from service.dynamics.motion import Estimate
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.start import StartingPoint
from workers.solvers.assembly.dense import ResolvedMotion
from workers.solvers.orbits.orbit import RATE_NUDGE

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
    return Estimate(value, nextafter(float(abs(h - value).abs_upper()), inf))


def evidence_of(resolved: ResolvedMotion) -> dict[str, float | int | str]:
    """Return what the dense output took."""
    return {
        "pieces": len(resolved.breaks) - 1,
        "states": resolved.evaluations,
        "departure": resolved.departure,
    }
