r"""The gain of the attitude in a period: the precession from the curve alone, and the attitude, proven.

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

The attitude of a periodic motion is proven by steps over one period, and by what it gains in each: with n
whole periods T before t, and the azimuths Δψ gained in one,

.. math:: \psi_k(t) = \psi_k(t - n T) + n\,\Delta\psi_k , \qquad
          q(t) = (\pm 1)^n e^{k n \Delta\psi_1 / 2} q(t - n T) ,

so late times cost no more than early ones.
"""

from dataclasses import dataclass, replace
from functools import partial
from math import floor, inf, nextafter

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.equations.orientation import LOCAL_QUATERNION, PRECESSION, about_vertical
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.motion import COLUMNS, Estimate
from service.dynamics.problem import Problem
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.windows import REDUCTION_BITS
from service.dynamics.solution.dense_output import Advance, split
from workers.solvers.certified.certify import Certified, is_narrow
from workers.solvers.certified.validated.enclose import Start, enclose_at
from workers.solvers.certified.validated.motion import AXES, with_attitude
from workers.solvers.certified.validated.system import EulerPoisson, TurningBody
from workers.solvers.errors import CertifiedUnavailableError
from workers.solvers.quadrature.time_map import make_time_map

EQUATOR_NUDGE = arb(2) ** -60
"""The integrand is even about the equator: 2^-60 beside it, it differs by less than a double shows."""
SPARE_BITS = 16
"""Bits that sums and products of the attitude may lose."""


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


def with_proven_attitude(
    problem: Problem, body: RigidBody, start: Start, proven: Certified, *, goes_round: bool
) -> Certified:
    """Return enclosures of a planar motion with those of its attitude, and of its precession.

    A motion that does not go round its curve goes to and fro: then nothing is gained in a period.

    Raises
    ------
    CertifiedUnavailableError
        The motion has no period, or steps do not prove its attitude.
    """
    if proven.period is None:
        raise CertifiedUnavailableError("it has no period")
    turns = [floor(float(time / proven.period)) for time in proven.times]
    bits = proven.bits + SPARE_BITS + max((abs(n).bit_length() for n in turns), default=0)
    with ctx.workprec(4 * bits):
        local = [time - n * proven.period for time, n in zip(proven.times, turns, strict=True)]
        axes = tuple(AXES[name] for name in PRECESSION)
        system = TurningBody(EulerPoisson(body, problem.potential.tape), axes)
        *there, last = enclose_at(system, partial(with_attitude, start, axes), [*local, proven.period], bits)
        gained = last[10:] if goes_round else (arb(0), arb(0))
        first = with_attitude(start, axes)[6:10]
        turned = zip(_turned_by(gained[0], first), last[6:10], strict=True)
        is_turned = float(sum((x * y for x, y in turned), arb(0))) < 0.0
        rows = []
        for n, state, row in zip(turns, proven.states, there, strict=True):
            quaternion = _turned_by(n * gained[0], row[6:10])
            sign = -1 if is_turned and n % 2 else 1
            angles = [psi + n * gain for psi, gain in zip(row[10:], gained, strict=True)]
            rows.append((*state, *(sign * x for x in quaternion), *angles))
    if not all(is_narrow(value, proven.bits) for row in [*rows, gained] for value in row):
        raise CertifiedUnavailableError(f"its attitude is not known to {proven.bits} bits")
    columns = (*COLUMNS, *LOCAL_QUATERNION, *PRECESSION)
    return replace(proven, states=tuple(rows), columns=columns, precession=(gained[0], gained[1]))


def _turned_by(angle: arb, quaternion: tuple[arb, ...]) -> tuple[arb, ...]:
    sine, cosine = (angle / 2).sin_cos()
    return about_vertical(cosine, sine, quaternion)
