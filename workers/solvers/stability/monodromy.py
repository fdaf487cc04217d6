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
"""

from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Protocol

import numpy as np
from flint import arb
from numpy.polynomial import legendre
from numpy.typing import NDArray

from service.dynamics.errors import DynamicsError
from service.dynamics.numerics import largest
from service.dynamics.solution.dense_output import EPSILON
from workers.solvers.orbits.orbit import Libration, Rotation
from workers.solvers.quadrature.errors import QuadratureNotConvergedError
from workers.solvers.quadrature.squared_speed import time_map_of

FloatArray = NDArray[np.float64]

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


class LinearSystem(Protocol):
    """dy/dθ = A(θ) y with tr A = 0, A being given at single phases."""

    def matrix(self, theta: arb) -> FloatArray:
        """Return A(θ), shape (N, N)."""
        ...


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


def turn_monodromy(system: LinearSystem, orbit: Libration | Rotation) -> Monodromy:
    """Return the monodromy of ``system`` over one turn of ``orbit``, at the current precision.

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
    _require_integrable(system, orbit)
    rule = gauss_collocation()
    waiting = _cross(system, _first_spans(orbit), rule)
    nodes = STAGES * len(waiting)
    done: list[_Panel] = []
    while waiting:
        halves = _cross(system, [span for panel in waiting for span in _halved(panel)], rule)
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


def _require_integrable(system: LinearSystem, orbit: Libration | Rotation) -> None:
    """Raise StabilityUndefinedError where |A| times the distance from a pole does not fall towards it."""
    for corner in orbit.corners:
        for side in (-1, 1):
            far, near = (
                _norm(system.matrix(arb.pi() * corner + side * distance)) * float(distance)
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


def _cross(system: LinearSystem, spans: list[tuple[float, float]], rule: Collocation) -> list[_Panel]:
    rates = np.array([_rates(system, left, right, rule.stages) for left, right in spans])
    propagators = rule.propagators(rates)
    return [_Panel(left, right, found) for (left, right), found in zip(spans, propagators, strict=True)]


def _rates(system: LinearSystem, left: float, right: float, stages: FloatArray) -> FloatArray:
    """Return dy/dx / y at the stages of a panel that is mapped onto −1 ≤ x ≤ 1."""
    middle, half = (arb(left) + arb(right)) / 2, (arb(right) - arb(left)) / 2
    values = [system.matrix(arb.pi() * (middle + half * arb(float(x)))) for x in stages]
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
