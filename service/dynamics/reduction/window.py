"""Admissible windows: the stretches of a curve on which a planar motion lives."""

from dataclasses import dataclass
from typing import Literal

from service.dynamics.reduction.arc import Arc

EndKind = Literal["pole", "equator", "rest", "equilibrium", "standstill", "edge", "collision"]
"""At ``rest`` the motion turns back; an ``equilibrium`` it reaches in the limit t → ±∞ only; at a
``standstill`` it comes to rest after a finite time, and may go on at any later one; a ``collision``, where p²
grows without bound, is no pole, and the motion ends there."""
WindowKind = Literal["periodic", "separatrix", "equilibrium", "standstill", "collision", "pole", "edge"]


@dataclass(frozen=True, slots=True)
class Window:
    """One admissible window of |g3| = λ|g1|^(C/A).

    Two arcs that are mirror images under g2 → −g2 make one window.
    """

    index: int
    """Place in the order of growing largest |g1|; of equal ones the northern is first."""
    kind: WindowKind
    """How the motion in it ends: ``periodic``, or the reason why it never closes."""
    ends: tuple[EndKind, EndKind]
    """Where |g1| is smallest, where it is largest."""
    g1: tuple[float, float]
    """g1, with its sign, at the two ends."""
    g2: tuple[float, float]
    """Smallest and largest g2 of the (northern, if there are two) arc."""
    arcs: tuple[Arc, ...]
    """One arc of the loop, or two that are mirror images (northern first)."""
