r"""A part of a motion next to a near rest, with a phase of its own.

Where P ≈ K (w² ± ρ²), w = |v − v_m|, the phase y has w = ρ sinh y if the motion passes the place
and w = ρ cosh y if it turns back before it; an end where it turns back at once has v = v_r ± y².
Within a zone about v_m, where P'' is constant to 2^-70 by its ball, P/(w² ± ρ²) = ½ P'' needs no
value of P, which all but cancels there.
"""

from dataclasses import dataclass
from typing import Literal

from flint import arb, ctx

from service.dynamics.reduction.geometry.loop import Loop, LoopPoint, ball
from service.dynamics.reduction.root_finding.gap import NearRest, box_about, factor_R, slopes

CONSTANT_BITS = 70
WIDEST_ZONE = 80
NARROWEST_ZONE = 1024
"""−log2 of the zones' radii."""


@dataclass(frozen=True, slots=True)
class Slow:
    """A near rest on the way."""

    v: arb
    """Unrolled."""
    reach: arb
    turns: bool
    zone: arb
    """w up to which dt/dy is constant."""
    K: arb
    at: LoopPoint


@dataclass(frozen=True, slots=True)
class LoopStretch:
    """A part of the way, v from ``first`` to ``last``, with a phase y of its own."""

    kind: Literal["turn", "slow turn", "pass"]
    side: int
    """Side of an end: 1 if the stretch lies above it, −1 below. A pass has 1."""
    origin: arb
    """Where the motion turns, or the near rest that is passed."""
    slow: Slow | None
    first: arb
    last: arb
    """y at both ends, in the order of growing v."""

    def offset(self, y: arb) -> arb:
        """Return v − origin."""
        if self.slow is None:
            return self.side * y * y
        rho = self.slow.reach
        if self.slow.turns:
            half = (y / 2).sinh()
            return self.side * 2 * rho * half * half
        return rho * y.sinh()

    def slope(self, y: arb) -> arb:
        """Return |dv/dy|."""
        if self.slow is None:
            return 2 * abs(y)
        return self.slow.reach * abs(y.sinh() if self.slow.turns else y.cosh())

    def width(self, y: arb) -> arb:
        """Return w, the distance from the near rest."""
        if self.slow is None:
            return arb(1)
        return self.slow.reach * (y.cosh() if self.slow.turns else abs(y.sinh()))

    def phase(self, v: arb) -> arb:
        """Return y at v."""
        away = (v - self.origin).mid()
        if self.slow is None:
            return self.side * arb(0).max(self.side * away).sqrt()
        if self.slow.turns:
            return self.side * 2 * (arb(0).max(self.side * away) / (2 * self.slow.reach)).sqrt().asinh()
        return (away / self.slow.reach).asinh()


def zone_depth(loop: Loop, near: NearRest) -> int:
    """Return −log2 of a radius in v about the place, within which P''/2 is constant to 2^-CONSTANT_BITS."""
    depth = WIDEST_ZONE
    while depth <= NARROWEST_ZONE:
        with ctx.workprec(4 * depth):
            if _stiffness(loop.refined(), near, depth).rel_accuracy_bits() >= CONSTANT_BITS:
                return depth
        depth += 24
    return depth


def _stiffness(loop: Loop, near: NearRest, depth: int) -> arb:
    """Return P/(w² ± ρ²) within 2^-depth of the place: R f''/(2 μ²) on a box about it.

    f is its value at the place plus ½ f''(ξ) τ², and w = μ(ξ') τ.
    """
    radius = 2 * arb(2) ** -depth / abs(ball(loop.C) * near.at.c * near.v.sin())
    box = box_about(loop, near.at, radius)
    sine = near.v.sin() + arb(0, arb(2) ** (1 - depth))
    mu = ball(loop.C) * box.c * sine
    second = slopes(loop, box)[1]
    return factor_R(loop, box) * second / (2 * mu * mu)


def make_slow(loop: Loop, near: NearRest, depth: int) -> Slow:
    """Return the near rest with its zone of radius 2^-depth, at the current precision."""
    K = _stiffness(loop, near, depth)
    # The reach is that of the place's own P'': of P'' elsewhere in the zone it is the same up to its ball.
    widened = K * arb(1, arb(2) ** (2 - CONSTANT_BITS))
    return Slow(near.v, near.reach, bool(near.square < 0), arb(2) ** -depth, widened, near.at)
