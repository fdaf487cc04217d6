r"""The monodromy of a linear system dy/dθ = A(θ) y over one turn of an orbit's phase.

The first panels are those of the time map, which are proved to resolve the motion: no feature of the
potential lies unseen between their nodes. A panel is halved until its propagator is the product of those of
its two halves; the product is kept, and what the two differed by is taken for
its error: a measurement, not a bound. Panels end at the poles, where A may not be smooth.

On each panel y' = A(x) y is solved by Gauss-Legendre collocation, for many intervals at once. With the
STAGES zeros x_i of a Legendre polynomial and a_ij = ∫_{−1}^{x_i} L_j dx, b_j = ∫_{−1}^{1} L_j dx of their
Lagrange polynomials L_j(x),

.. math:: Y_i = 1 + \sum_j a_{ij} A_j Y_j,\qquad Y(1) = 1 + \sum_j b_j A_j Y_j ,

which is of order 2·STAGES and keeps det Y = 1 where tr A = 0 (Hairer, Lubich
and Wanner, Geometric Numerical Integration, II.1.3 and IV.2). The stages never
lie at an end of the interval: A may be undefined there.

One equation has multipliers in closed form: stability of the motion of Bobylev and Steklov against leaving
the plane q = 0. For V = a g1, A = 2C and any B the variational equation of q is Lamé's with n = 1,

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
from itertools import accumulate, pairwise
from math import isqrt
from typing import Literal

import numpy as np
from flint import acb, arb, ctx
from numpy.polynomial import legendre
from numpy.typing import NDArray

from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.numerics import largest
from service.dynamics.solution.dense_output import EPSILON
from workers.solvers.errors import QuadratureNotConvergedError
from workers.solvers.orbits.orbit import Libration, Rotation
from workers.solvers.quadrature.squared_speed import time_map_of
from workers.solvers.three_terms import incomplete_first_kind

FloatArray = NDArray[np.float64]
Stability = Literal["stable", "unstable", "edge"]
MatrixAt = Callable[[arb], FloatArray]
"""Returns A(θ) of a linear system dy/dθ = A(θ) y with tr A = 0, shape (N, N)."""
STAGES = 16


@dataclass(frozen=True, slots=True)
class Collocation:
    """The rule on [−1, 1]."""

    stages: FloatArray
    weights: FloatArray
    integrals: FloatArray
    """a_ij, shape (STAGES, STAGES)."""

    def propagators(self, rates: FloatArray) -> FloatArray:
        """Return Y(1), shape (n, N, N), from A at the stages of n intervals, shape (n, STAGES, N, N)."""
        count, stages, size, _ = rates.shape
        blocks = self.integrals[:, None, :, None] * rates.transpose(0, 2, 1, 3)[:, None]
        equations = np.eye(stages * size) - blocks.reshape(count, stages * size, stages * size)
        ones = np.broadcast_to(np.tile(np.eye(size), (stages, 1)), (count, stages * size, size))
        inside = np.linalg.solve(equations, ones).reshape(count, stages, size, size)
        result: FloatArray = np.eye(size) + np.einsum("j,njab,njbc->nac", self.weights, rates, inside)
        return result


def gauss_collocation() -> Collocation:
    """Return the rule; the integrals come from ∫ P_k dx = (P_{k+1} − P_{k−1}) / (2k + 1)."""
    stages, weights = legendre.leggauss(STAGES)
    P = legendre.legvander(stages, STAGES)
    primitives = np.column_stack([stages + 1.0, P[:, 2:] - P[:, :-2]])
    return Collocation(stages, weights, 0.5 * (primitives @ P[:, :-1].T) * weights)


PROPAGATOR_RELATIVE_CHANGE = 1e-14
"""Change of a propagator by halving its panel, in parts of its norm: some roundings. What is kept
is better still by 2^-32 where the order of the collocation is felt."""
PROPAGATOR_ROUNDINGS = 4.0
"""Roundings of its norm a propagator is charged with: those of A, of the solution, of the product."""
MIN_PANEL_WIDTH = 1e-15
MAX_PANELS = 2000
POLE_PHASE_DISTANCES = (arb(2) ** -16, arb(2) ** -26)
"""Distances from a pole, in θ: near enough for the leading term of A, far beyond the rounding of the corners.
A power −0.9 of the distance still halves its product with the distance between the two."""


class StabilityUndefinedError(DynamicsError):
    """The equations of the perturbations are singular where the motion passes a pole."""

    code = "stability_undefined"


@dataclass(frozen=True, slots=True)
class Monodromy:
    """The propagator over one turn, from θ = 0."""

    matrix: FloatArray
    """Shape (N, N)."""
    error: float
    """Bound of the absolute error of the trace."""
    excursion: float
    """Largest norm on the way, in parts of the larger one of those at both ends, 1 and ‖matrix‖."""
    nodes: int
    """Phases at which A was evaluated."""

    @property
    def trace(self) -> float:
        """Return the sum of the multipliers."""
        return float(np.trace(self.matrix))


@dataclass(frozen=True, slots=True)
class _Panel:
    """left ≤ u ≤ right, u = θ/π."""

    left: float
    right: float
    propagator: FloatArray
    error: float = np.inf
    """Bound of the norm of the propagator's error."""

    @property
    def is_resolved(self) -> bool:
        return self.error <= (PROPAGATOR_RELATIVE_CHANGE + PROPAGATOR_ROUNDINGS * EPSILON) * _norm(
            self.propagator
        )


def turn_monodromy(matrix_at: MatrixAt, orbit: Libration | Rotation) -> Monodromy:
    """Return the monodromy of a system over one turn of ``orbit``, at the current precision.

    Raises
    ------
    StabilityUndefinedError
        A is not integrable at a pole that the orbit passes.
    QuadratureNotConvergedError
        A is not resolved by the largest number of panels.
    PrecisionLostError
        A, or the rate of the phase, is not known to a double's precision.
    WindowBlockedError
        p² is negative on the way.
    """
    _require_integrable(matrix_at, orbit)
    rule = gauss_collocation()
    waiting = _cross(matrix_at, _first_spans(orbit), rule)
    nodes = STAGES * len(waiting)
    done: list[_Panel] = []
    while waiting:
        halves = _cross(matrix_at, [span for panel in waiting for span in _halved(panel)], rule)
        nodes += STAGES * len(halves)
        following: list[_Panel] = []
        for whole, first, second in zip(waiting, halves[::2], halves[1::2], strict=True):
            merged = _merged(whole, first, second)
            if merged.is_resolved or whole.right - whole.left < MIN_PANEL_WIDTH:
                done.append(merged)
            else:
                following.extend([first, second])
        waiting = following
        if len(done) + len(waiting) > MAX_PANELS:
            raise QuadratureNotConvergedError(
                f"{MAX_PANELS} panels of {STAGES} stages do not resolve the equations of the perturbations"
            )
    done.sort(key=lambda panel: panel.left)
    return _assemble(done, nodes)


def _first_spans(orbit: Libration | Rotation) -> list[tuple[float, float]]:
    edges = time_map_of(orbit).edges.tolist()
    return list(pairwise(sorted({*np.linspace(0.0, 2.0, 5).tolist(), *orbit.corners, *edges})))


def _require_integrable(matrix_at: MatrixAt, orbit: Libration | Rotation) -> None:
    """Raise StabilityUndefinedError where |A| times the distance from a pole does not fall towards it."""
    for corner in orbit.corners:
        for side in (-1, 1):
            far, near = (
                _norm(matrix_at(arb.pi() * corner + side * distance)) * float(distance)
                for distance in POLE_PHASE_DISTANCES
            )
            if not near < 0.5 * far:
                raise StabilityUndefinedError(
                    "the motion passes a pole at which the field is not twice differentiable: perturbations "
                    "are not continued through it by a linear equation, and no multipliers exist",
                    pointer="/outputs",
                )


def _halved(panel: _Panel) -> tuple[tuple[float, float], tuple[float, float]]:
    middle = 0.5 * (panel.left + panel.right)
    return (panel.left, middle), (middle, panel.right)


def _cross(matrix_at: MatrixAt, spans: list[tuple[float, float]], rule: Collocation) -> list[_Panel]:
    rates = np.array([_rates(matrix_at, left, right, rule.stages) for left, right in spans])
    propagators = rule.propagators(rates)
    return [_Panel(left, right, found) for (left, right), found in zip(spans, propagators, strict=True)]


def _rates(matrix_at: MatrixAt, left: float, right: float, stages: FloatArray) -> FloatArray:
    """Return dy/dx / y at the stages of a panel that is mapped onto −1 ≤ x ≤ 1."""
    middle, half = (arb(left) + arb(right)) / 2, (arb(right) - arb(left)) / 2
    values = [matrix_at(arb.pi() * (middle + half * arb(float(x)))) for x in stages]
    return np.pi * float(half) * np.array(values)


def _merged(whole: _Panel, first: _Panel, second: _Panel) -> _Panel:
    product = second.propagator @ first.propagator
    size = _norm(product)
    change = _norm(product - whole.propagator)
    # tr A = 0: the determinant is 1 and shows roundings that halving does not.
    stray = abs(float(np.linalg.det(product)) - 1.0) + PROPAGATOR_ROUNDINGS * EPSILON
    return _Panel(whole.left, whole.right, product, change + stray * size)


def _assemble(panels: list[_Panel], nodes: int) -> Monodromy:
    propagators = [panel.propagator for panel in panels]
    one = np.eye(len(propagators[0]))
    before = list(accumulate(propagators, lambda done, step: step @ done, initial=one))
    after = list(accumulate(reversed(propagators), np.matmul, initial=one))[::-1]
    # An error E of one factor moves the trace by tr(after · E · before).
    errors = [
        panel.error * _norm(earlier @ later)
        for panel, earlier, later in zip(panels, before[:-1], after[1:], strict=True)
    ]
    longest = largest(_norm(matrix, 2) for matrix in before)
    return Monodromy(before[-1], sum(errors), longest / max(1.0, _norm(before[-1], 2)), nodes)


def _norm(matrix: FloatArray, order: int | None = None) -> float:
    """Return Frobenius' norm, or the spectral one (2)."""
    return float(np.linalg.norm(matrix, order))


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
