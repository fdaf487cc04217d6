r"""Stability of the motion of Bobylev and Steklov against leaving the plane q = 0.

For V = a g1, A = 2C and any B the variational equation of q is Lamé's with n = 1,

.. math:: \ddot q = (2\wp(t+\omega') + E)\,q, \qquad E = \frac{a}{2C}\bigl(x_B + \tfrac{\nu}{3}\bigr),
          \qquad x_B = \frac{2\nu(C-B)}{B},

whose band edges are x_B = x2, 0 and x1 (the roots of 1 − nu x − x², and 0).
Its Floquet exponent over one period of g1 is π θ'/θ, with the theta function
and the argument that are real in the band or gap of x_B. (The sign of nu is
that of g1; only |nu| and B/C matter.)
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from math import isqrt
from typing import Literal

from flint import acb, arb, ctx

from service.dynamics.formula.algebras.ball import ball
from workers.solvers.three_terms.variables import incomplete_first_kind

Stability = Literal["stable", "unstable", "edge"]


@dataclass(frozen=True, slots=True)
class TransverseStability:
    """The pair of multipliers (μ, 1/μ) of perturbations out of the plane."""

    trip_trace: arb
    """μ + 1/μ over one period of g1."""
    trace: arb
    """μ + 1/μ over the period of all six variables, which is two of g1."""
    growth: arb
    """|μ| ≥ 1 over the period of all six variables."""
    stability: Stability
    """"edge" where x_B is at a band edge, or cannot be told from it."""


def transverse_stability(nu: Fraction, B_over_C: Fraction) -> TransverseStability:
    """Return the multipliers of V = a g1, A = 2C on the curve g3² = nu g1, at the current precision.

    Parameters
    ----------
    nu
        Not 0.
    B_over_C
        B/C > 0.
    """
    size = abs(nu)
    x1 = equator(size)
    x2, x_B = -1 / x1, ball(2 * size * (1 - B_over_C) / B_over_C)
    if B_over_C == 1:
        # Lagrange's top: x_B = 0.
        return TransverseStability(arb(-2), arb(2), arb(1), "edge")
    exponent, is_gap, sign = _floquet(x1, x2, x_B)
    trip = 2 * sign * (exponent.cosh() if is_gap else exponent.cos())
    growth = abs(2 * exponent).exp() if is_gap else arb(1)
    is_edge = not ((x_B < x2 or x_B > x2) and (x_B < x1 or x_B > x1))
    if is_edge:
        # The trace is ±2 there and goes on beyond with the same slope.
        trip += arb(0, (2 * (abs(trip) - 2)).abs_upper())
    stability: Stability = "edge" if is_edge else "unstable" if is_gap else "stable"
    return TransverseStability(trip, trip * trip - 2, growth, stability)


def equator(nu: Fraction) -> arb:
    """Return x1, the positive root of 1 − nu x − x²."""
    square = ball(nu)
    return 2 / (square + (square * square + 4).sqrt())


def _floquet(x1: arb, x2: arb, x_B: arb) -> tuple[arb, bool, int]:
    """Return the exponent over a period of g1, whether it is real, and the sign of its exponential.

    sn² of the argument is (x1 − x2)/(x1 − x_B) in modulus m = x1/(x1 − x2); in
    each band and gap the argument differs from a real or imaginary one by half
    periods.
    """
    width = x1 - x2
    m, m1 = x1 / width, -x2 / width
    K = acb(m).elliptic_k().real
    nome = (-arb.pi() * acb(m1).elliptic_k().real / K).exp()
    # Midpoints: a ball at an edge may be put on either side of it, where the formulas agree.
    if (x_B - x2).mid() < 0:
        square, modulus, kind = width / (x1 - x_B), m, 0
    elif x_B.mid() <= 0:
        square, modulus, kind = (x_B - x2) / -x2, m1, 1
    elif (x_B - x1).mid() < 0:
        square, modulus, kind = (x1 - x_B) / x1, m, 2
    else:
        square, modulus, kind = width / (x_B - x2), m1, 3
    at = arb.pi() * incomplete_first_kind(square, modulus) / (2 * K)
    if kind == 0:
        return arb.pi() * _odd_ratio(nome, at, arb.cos, arb.sin, -1), True, 1
    if kind == 1:
        return arb.pi() * _odd_ratio(nome, at, arb.sinh, arb.cosh, 1), False, 1
    if kind == 2:
        return arb.pi() * _even_ratio(nome, at), True, -1
    return arb.pi() * _odd_ratio(nome, at, arb.cosh, arb.sinh, -1), False, 1


def _odd_ratio(
    nome: arb, at: arb, upper: Callable[[arb], arb], lower: Callable[[arb], arb], sign: int
) -> arb:
    """Return Σ sⁿ (2n+1) q^(n(n+1)) upper((2n+1) at) / Σ sⁿ q^(n(n+1)) lower((2n+1) at), for s = ``sign``.

    It is θ1'/θ1, or θ2'/θ2, at a real or an imaginary argument. |at| ≤ −log(q)/2.
    """
    count, tail = _terms(nome)
    top, bottom = arb(0, tail), arb(0, tail)
    for n in range(count):
        weight = sign**n * nome ** (n * (n + 1))
        top += (2 * n + 1) * weight * upper((2 * n + 1) * at)
        bottom += weight * lower((2 * n + 1) * at)
    return top / bottom


def _even_ratio(nome: arb, at: arb) -> arb:
    """Return θ4'/θ4 at a real argument."""
    count, tail = _terms(nome)
    top, bottom = arb(0, tail), arb(1, tail)
    for n in range(1, count):
        weight = (-1) ** n * nome ** (n * n)
        top -= 4 * n * weight * (2 * n * at).sin()
        bottom += 2 * weight * (2 * n * at).cos()
    return top / bottom


def _terms(nome: arb) -> tuple[int, arb]:
    """Return how many terms are summed and a bound of the others.

    m ≤ 1/2, so that q ≤ e^(−π) and each term is below 4 (n+1) q^(n² − 1/2), less than half of the one before.
    """
    count = 2 + isqrt(ctx.prec // 4)
    return count, (8 * (count + 1) * nome ** (count * count - 1)).abs_upper()
