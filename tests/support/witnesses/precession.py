r"""Precession over one period of a motion round the whole loop, through both poles.

The orientation of the body depends on where it is on the curve only, so the
angles gained in a period depend on α = A/C and λ alone, not on the potential.
In the coordinate v of the loop (A > C), the azimuths of the first and of the
third axis about the fixed vector gain

.. math:: \Delta\psi_1 = 4\int_0^{\pi/2}\frac{\alpha Z g_1}{c\,(1-g_1^2)}\,dv, \qquad
          \Delta\psi_3 = -4\int_0^{\pi/2}\frac{Z g_1}{c\,(1-g_3^2)}\,dv = \Delta\psi_1 - 2\pi .

For α = 2 partial fractions of 2 x1 sin²v/(1 − x1² sin⁴v) make them elliptic:

.. math:: \Delta\psi_1 = 4\sqrt{\nu x_1}\,\bigl(\Pi(x_1|m) - \Pi(-x_1|m)\bigr), \qquad m = -x_1^2 .
"""

from dataclasses import dataclass

from flint import acb, arb, ctx

from service.dynamics.formula.algebras.ball import ball
from service.dynamics.reduction.geometry.loop import Loop


@dataclass(frozen=True, slots=True)
class Precession:
    """Angles gained over one period about the fixed vector, in radians, not reduced."""

    psi1: arb
    """Angle of the first principal axis."""
    psi3: arb
    """Angle of the third: the precession of Euler's angles."""


def precession(loop: Loop, direction: int = 1) -> Precession:
    """Return the precession of a motion with dv/dt of this sign round ``loop``, at the current precision.

    (Motions between rest points retrace their way and do not precess.)
    """
    fine = loop.refined()
    turn = 2 * arb.pi()
    if fine.alpha == 2:
        first = _elliptic(fine)
        third = first - turn
    elif fine.G < fine.Z:
        first = _integral(fine, third=False)
        third = first - turn
    else:
        # 1 − g1² comes close to 0: the other integrand is the smooth one.
        third = _integral(fine, third=True)
        first = third + turn
    return _in_client_axes(fine, first, third, direction)


def precession_by_integral(loop: Loop, direction: int = 1) -> Precession:
    """Return the same from two integrals over the loop, one for each axis."""
    fine = loop.refined()
    return _in_client_axes(fine, _integral(fine, third=False), _integral(fine, third=True), direction)


def _in_client_axes(loop: Loop, first: arb, third: arb, direction: int) -> Precession:
    sign = loop.g1_sign * direction
    if loop.mirrored:
        # A mirror image turns the other way, and the axes are exchanged.
        return Precession(-sign * third, -sign * first)
    return Precession(sign * first, sign * third)


def _elliptic(loop: Loop) -> arb:
    x1 = loop.G
    nu = loop.Z * loop.Z / x1
    n, m = acb(x1), acb(-x1 * x1)
    difference = acb.elliptic_pi(n, m) - acb.elliptic_pi(-n, m)
    return 4 * (nu * x1).sqrt() * difference.real


def _integral(loop: Loop, *, third: bool) -> arb:
    """Return Δψ1, or Δψ3, for g1 > 0 and growing v.

    Above v = π/4 in w = π/2 − v; below it in y = −log(√2 sin v), where powers of
    sin v are exponentials, cut off where the rest is below the precision.
    """
    alpha, Z, G = ball(loop.alpha), loop.Z, loop.G
    power = acb(alpha)

    def integrand(sine_power: acb, q: acb, h: acb, analytic: bool) -> acb:
        """Return the integrand without its constants, from |sin v|^α, q = cos²v, h = (1 − |sin v|^2α)/q."""
        denominator = G * G + Z * Z * q if third else Z * Z + G * G * q * h
        slope = (Z * Z + G * G * h).sqrt(analytic=analytic) * denominator
        return sine_power / slope

    def upper(w: acb, analytic: bool) -> acb:
        sine = w.sin()
        q = sine * sine
        sine_power = w.cos().pow(power, analytic=analytic)
        is_near = abs(q) * (alpha + 1) < 0.5
        h = _quotient_near_zero(q, alpha) if is_near else (1 - sine_power * sine_power) / q
        return integrand(sine_power, q, h, analytic)

    def lower(y: acb, analytic: bool) -> acb:
        sine = (-y).exp() / acb(2).sqrt()
        q = 1 - sine * sine
        sine_power = (-power * (y + acb(2).log() / 2)).exp()
        h = (1 - sine_power * sine_power) / q
        return integrand(sine_power, q, h, analytic) * sine / q.sqrt(analytic=analytic)

    smallest = arb(ctx.prec) * arb(2).log()
    total = acb.integral(upper, 0, acb.pi() / 4) + acb.integral(lower, 0, smallest / (alpha + 1))
    # Where it was cut off q ≥ 1/2 and h ≥ 1, so that c ≥ 1 and 1 − g1², 1 − g3² ≥ 1/2.
    left_out = 2 * arb(2).sqrt() / (alpha + 1) * (-smallest).exp()
    # Factored out, so that the integral is known to an accuracy relative to its size.
    factor = -4 * Z * G if third else 4 * alpha * Z * G
    return factor * (total.real + arb(0, left_out.abs_upper()))


def _quotient_near_zero(q: acb, alpha: arb) -> acb:
    """Return (1 − (1 − q)^α)/q by its series, for |q| (α + 1) < 1/2: the terms fall by halves at least."""
    term, total, k = acb(alpha), acb(0), 0
    while abs(term).upper() > arb(2) ** -ctx.prec:
        total += term
        k += 1
        term = term * q * (k - alpha) / (k + 1)
    rest = arb(0, 2 * abs(term).abs_upper())
    return total + acb(rest, rest)
