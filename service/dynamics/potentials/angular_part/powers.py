r"""The angular part V1[F] where F is a sum of powers of w, in balls: no integral is left.

The potential of w^m that vanishes like |g3|^(2αm+2) at g3 = 0 is homogeneous, and its second factor solves
the equation of Gauss (H. M. Yehia's (e1) and (eg)): with ζ = (g3/g1)²

.. math:: \frac{\alpha+\zeta}{1+\zeta}\int_0^\zeta \frac{z^{\alpha m}(1+z)^{(1-\alpha)m}}{(\alpha+z)^2}\,dz
          = \frac{\zeta^{\alpha m+1}}{\alpha(\alpha m+1)}\,(1+\zeta)^{(1-\alpha)m}\;
            {}_2F_1(2, m+1; \alpha m+2; -\zeta),

and both sides are continued to all m but those with αm + 1 = 0, −1, −2, …, which are left to the integral.
Between two directions the difference of the integrals is that of V1.
"""

from collections.abc import Mapping
from fractions import Fraction
from functools import lru_cache

from flint import arb, ctx

from service.dynamics.formula.algebras.ball import BallAlgebra, ball
from service.dynamics.formula.algebras.power_sums import ONE, PowerAlgebra, PowerSum, Small
from service.dynamics.formula.tape import Tape

GENERIC_W = Fraction(2, 3)
"""A value of w at which the formula is followed."""


def powers_of(tape: Tape, alpha: Fraction) -> Mapping[Fraction, arb] | None:
    """Return the coefficients of F by the exponents of w, at the current precision.

    None if F is no sum of powers, or has one at which V1 has another form.
    """
    return _powers_at(tape, alpha, ctx.prec)


@lru_cache(maxsize=64)
def _powers_at(tape: Tape, alpha: Fraction, bits: int) -> Mapping[Fraction, arb] | None:
    with ctx.workprec(bits):
        base = BallAlgebra()
        algebra = PowerAlgebra(base, Small(base.constant(GENERIC_W), 1, 1))
        found = tape.evaluate(algebra, (PowerSum({(Fraction(1), 0): Fraction(1)}),))
        terms = {power[0]: algebra.value(PowerSum({ONE: factor})) for power, factor in found.terms.items()}
    if algebra.powers or not all(value.is_finite() for value in terms.values()):
        # A function of w that is no power has been asked for its value.
        return None
    is_other = ((alpha * m + 1).denominator == 1 and alpha * m + 1 <= 0 for m in terms)
    return None if any(is_other) else terms


def angular_of_power(m: Fraction, alpha: Fraction, scale: arb, start: arb, zeta: arb) -> arb:
    """Return V1[w^m] at the direction ``zeta``, 0 at ``start``; ``scale`` is (|A − C| ρ)^(α−1)."""
    a, power = ball(alpha), ball(m)
    turned = (a + zeta) / (1 + zeta) * (1 + start) / (a + start)
    difference = _from_axis(power, a, zeta) - turned * _at_start(m, alpha, _Exact(start), ctx.prec)
    return (1 - a) * (power * scale.log()).exp() * difference


class _Exact:
    """A ball that is known by its bits."""

    def __init__(self, ball: arb) -> None:
        self.ball = ball
        self._bits = ball.mid().man_exp(), ball.rad().man_exp()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Exact) and self._bits == other._bits

    def __hash__(self) -> int:
        return hash(self._bits)


@lru_cache(maxsize=64)
def _at_start(m: Fraction, alpha: Fraction, start: _Exact, bits: int) -> arb:
    """Return the right-hand side above at the direction at which V1 vanishes."""
    with ctx.workprec(bits):
        return _from_axis(ball(m), ball(alpha), start.ball)


def _from_axis(m: arb, alpha: arb, zeta: arb) -> arb:
    """Return the right-hand side above."""
    e = alpha * m + 1
    size = (e * zeta.log() + (1 - alpha) * m * zeta.log1p()).exp() / (alpha * e)
    return size * (-zeta).hypgeom_2f1(arb(2), m + 1, e + 1)
