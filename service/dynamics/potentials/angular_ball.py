"""The angular part V1[F] of :mod:`.angular` as a rigorous enclosure."""

from dataclasses import dataclass
from fractions import Fraction

from flint import acb, arb, ctx, fmpq

from service.dynamics.body import RigidBody
from service.dynamics.potentials.curve_function import CurveFunction

EVALUATIONS_PER_BIT = 200
"""Limit of the integrator. Smooth functions need some 10; what is not reached is honestly wide."""


def angular_balls(
    body: RigidBody, function: CurveFunction, order: int, g1: arb, g3: arb, reference_angle: arb
) -> tuple[arb, ...]:
    """Return enclosures of V1[θ^k F] for k = 0..``order``, at the current ``flint.ctx.prec``.

    NaN where the balls of g1 or g3 contain zero, and where F is undefined
    anywhere between the reference direction and the point.
    """
    alpha = _ball(body.alpha)
    squares = g1 * g1, g3 * g3
    zeta, rho = squares[1] / squares[0], squares[0] + squares[1]
    if not (zeta.is_finite() and zeta > 0):
        return (arb("nan"),) * (order + 1)
    scale = ((_ball(abs(body.A - body.C)) * rho).log() * (alpha - 1)).exp()
    T = (alpha * squares[0] + squares[1]) / rho
    start = reference_angle.tan() ** 2
    paths = [_Path(function, k, alpha, 1 - alpha, scale, start, zeta) for k in range(order + 1)]
    at_point = function.ball(curve_ball(body, g1, g3), order)
    at_start = [path.real(start.log()) for path in paths]
    if not all(value.is_finite() for value in (*at_point, *at_start)):
        return (arb("nan"),) * (order + 1)
    # V1 is wanted as exactly as F, to which it is added; θF may be zero.
    size = sum((abs(value) for value in (*at_point, *at_start)), start=arb(0))
    size = size if size > 0 else arb(1)
    return tuple((1 - alpha) * T * _integral(path, size) for path in paths)


def curve_ball(body: RigidBody, g1: arb, g3: arb) -> arb:
    """Return the enclosure of w, NaN where the ball of g1 or g3 contains zero."""
    alpha = _ball(body.alpha)
    return (
        (alpha - 1) * _ball(abs(body.A - body.C)).log() + 2 * (alpha * abs(g3).log() - abs(g1).log())
    ).exp()


@dataclass(slots=True)
class _Path:
    """∫ θ^k F(w) dz / (α + z)² over log z, from z = ``start`` to z = ``end``."""

    function: CurveFunction
    k: int
    alpha: arb
    exponent: arb
    """1 − α."""
    scale: arb
    """(|A − C| ρ)^(α−1)."""
    start: arb
    end: arb
    is_undefined: bool = False
    """F has no real value at some place the integrator asked for."""

    def real(self, y: arb) -> arb:
        """Return the integrand over y = log z; NaN where F is undefined as a real function."""
        alpha, exponent = self.alpha, self.exponent
        # On either side the form whose terms vary little on a wide ball of y.
        if y > 0:
            t = (-y).exp()
            shape, weight = y + exponent * t.log1p(), t / (1 + alpha * t) ** 2
        else:
            t = y.exp()
            shape, weight = alpha * y + exponent * t.log1p(), t / (alpha + t) ** 2
        return self.function.ball(self.scale * shape.exp(), self.k)[self.k] * weight

    def __call__(self, y: acb, analytic: bool) -> acb:
        """Return the integrand for ``acb.integral``."""
        if self.is_undefined:
            return acb(0)  # so that the integrator comes to its end at once
        if not analytic and y.imag.is_zero():
            value = self.real(y.real)
            self.is_undefined = not value.is_finite() and not self.real(y.real.mid()).is_finite()
            return acb(value)
        alpha, exponent = self.alpha, self.exponent
        if y.real > 0:
            t = (-y).exp()
            shape, weight = y + exponent * (1 + t).log(analytic), t / (1 + alpha * t) ** 2
        else:
            t = y.exp()
            shape, weight = alpha * y + exponent * (1 + t).log(analytic), t / (alpha + t) ** 2
        w = self.scale * shape.exp()
        return self.function.complex_ball(w, self.k, analytic=analytic)[self.k] * weight


def _integral(path: _Path, size: arb) -> arb:
    """Return the enclosure of the integral: between the midpoints of its ends, and what the ends add.

    Its error is small against ``size``, or against the integral if that is larger.
    """
    start, end = path.start.log(), path.end.log()
    at_start, at_end = path.real(start), path.real(end)
    accuracy = max(8, min(ctx.prec, path.end.rel_accuracy_bits() + 8))
    tolerance = arb(2) ** -accuracy
    integral = acb.integral(
        path,
        acb(start.mid()),
        acb(end.mid()),
        rel_tol=tolerance,
        abs_tol=(tolerance * size).mid(),
        eval_limit=EVALUATIONS_PER_BIT * ctx.prec,
    ).real
    if path.is_undefined:
        return arb("nan")
    return integral + at_end * (end - end.mid()) - at_start * (start - start.mid())


def _ball(value: Fraction) -> arb:
    return arb(fmpq(value.numerator, value.denominator))
