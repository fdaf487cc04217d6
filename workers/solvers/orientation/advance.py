r"""Computes the precession per period from the curve alone.

On a planar motion ω/s depends on g only, hence the attitude on the place on the
curve only: a motion to and fro between rest points has no net precession, and
one round the whole loop has the same whatever the potential. In the coordinate
v of the loop (primed axes, A > C)

.. math:: \Delta\psi_1 = \varepsilon\frac{A Z}{C}\oint\frac{|g_1|\,dv}{c\,(1-g_1^2)} ,\qquad
          \Delta\psi_3 = \Delta\psi_1 - 2\pi\varepsilon ,

ε the sign of s g1 g3. The mirror to A < C exchanges the axes and turns ψ round:
ψ1 = −ψ3', ψ3 = −ψ1', and the same relation holds.

The potential has no part in it. The integrand is one function of v for each λ and α, whose only narrow
feature, about the equator, has a node in its middle: panels end there. Their errors are estimates.
"""

from dataclasses import dataclass
from math import inf, nextafter

from flint import arb, ctx

from service.dynamics.formula.algebras.ball import ball
from service.dynamics.motion import Estimate
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.windows import REDUCTION_BITS
from service.dynamics.solution.dense_output import Advance, split
from workers.solvers.quadrature.time_map import make_time_map

EQUATOR_NUDGE = arb(2) ** -60
"""The integrand is even about the equator: 2^-60 beside it, it differs by less than a double shows."""


@dataclass(frozen=True, slots=True)
class Precession:
    """The angles by which the azimuths of the body's first and third axes advance in one period."""

    psi1: Estimate
    psi3: Estimate


def loop_advances(loop: Loop, sense: int) -> tuple[Advance, Advance]:
    """Return what ψ1 and ψ3 gain when a motion goes round the loop once, with ``sense`` = sign of s g1 g3.

    Raises
    ------
    QuadratureNotConvergedError, PrecisionLostError
        The curve is too extreme.
    """
    with ctx.workprec(REDUCTION_BITS):
        refined = loop.refined()
        swept = make_time_map(lambda theta: _rate(refined, theta), (1.0,), is_even=True).period
        first = arb(swept.hi) + arb(swept.lo)
        rest = 2 * arb.pi() - first
        one, three = (rest, -first) if loop.mirrored else (first, -rest)
        return _advance(sense * one, swept.error), _advance(sense * three, swept.error)


def estimate(advance: Advance) -> Estimate:
    """Return an advance as one double, with its rounding in the error.

    That of a libration is 0, and its error too: this is a theorem.
    """
    if advance == Advance():
        return Estimate(0.0, 0.0, "theorem")
    return Estimate(advance.hi, nextafter(abs(advance.lo) + advance.error, inf), "estimate")


def _rate(loop: Loop, theta: arb) -> arb:
    """Return |dψ1'/dv| at v = θ; it vanishes at the poles."""
    sine, cosine = theta.sin_cos()
    if sine.contains(0):
        return arb(0)
    if cosine.contains(0):
        sine, cosine = (theta + EQUATOR_NUDGE).sin_cos()
    at = loop.point_from(sine, cosine)
    return ball(loop.alpha) * loop.Z * abs(at.g1) / (at.c * (at.g2 * at.g2 + at.g3 * at.g3))


def _advance(total: arb, error: float) -> Advance:
    # Next to a whole turn the integral is known to more digits than two doubles of the turn have.
    (hi, lo), left_out = split(total, 2)
    return Advance(hi, lo, nextafter(error + left_out, inf) if left_out > 0.0 else error)
