r"""The angular part V1[F] of an admissible potential, in doubles.

H. M. Yehia's general solution is V = V1[F] + Q G(g2). On the curve
|g3| = λ |g1|^{C/A} the quantity

.. math:: w = |A-C|^{\alpha-1}\,|g_3|^{2\alpha}/g_1^2,\qquad \alpha = A/C,

is constant, and V1 is the potential with the energy −F(w) that vanishes in the
direction |g3/g1| = tan φ0. With ζ = (g3/g1)² and ρ = g1² + g3²

.. math:: V_1 = -(\alpha-1)\,\frac{Q}{C\rho}\int_{\tan^2\varphi_0}^{\zeta}
          F\bigl(w(\rho,z)\bigr)\frac{dz}{(\alpha+z)^2},\qquad
          w(\rho,z) = (|A-C|\rho)^{\alpha-1} z^\alpha(1+z)^{1-\alpha}.

Integrated over y = log z: what is not smooth in z is so at z = 0 and ∞, which
the weight e^{-|y|} makes negligible, and where F varies at all it does so on
the scale of log w.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody

FloatArray = NDArray[np.float64]
IntegrandFunction = Callable[[FloatArray], FloatArray]
"""Returns values of shape (functions, *shape of w), at w of any shape."""

NODES = 20
RESOLVED = 1e-8
"""Largest tail of a panel's Legendre series against its size. The rule is exact up to the degree
2·20 − 1: what it leaves out is of the order of the tail squared, 1e-16."""
NEGLIGIBLE = 1e-17
"""Panels whose tail is below this share of the whole need not be resolved."""
MAX_HALVINGS = 60
"""Where the halving stops: what is unresolved then is returned as NaN."""
CHUNK = 4096
"""Panels evaluated at once: some MB per operation."""


def angular_values(
    body: RigidBody, functions: IntegrandFunction, g1: FloatArray, g3: FloatArray, reference_angle: float
) -> FloatArray:
    """Return V1 of several functions at points of one shape: shape (functions, *points)."""
    g1, g3 = np.broadcast_arrays(np.asarray(g1, dtype=np.float64), np.asarray(g3, dtype=np.float64))
    alpha = float(body.alpha)
    with np.errstate(all="ignore"):
        radius = np.hypot(g1, g3)  # its square may underflow
        y = 2.0 * (np.log(np.abs(g3)) - np.log(np.abs(g1)))
        log_scale = (alpha - 1.0) * (math.log(abs(float(body.A - body.C))) + 2.0 * np.log(radius))
        T = alpha * (g1 / radius) ** 2 + (g3 / radius) ** 2
    line = _Line(functions, alpha, log_scale.ravel())
    start = 2.0 * math.log(math.tan(reference_angle))
    integrals = _integrate(line, np.full(y.size, start), y.ravel())
    result: FloatArray = -(alpha - 1.0) * T * integrals.reshape(len(integrals), *y.shape)
    return result


def curve_parameter(body: RigidBody, g1: FloatArray, g3: FloatArray) -> FloatArray:
    """Return w at the points, same shape; NaN or 0 or inf where g1 g3 = 0."""
    alpha = float(body.alpha)
    with np.errstate(all="ignore"):
        # The quotient is moderate where its parts squared overflow or underflow.
        root = np.abs(g3) ** alpha / np.abs(g1)
        result: FloatArray = np.float64(abs(body.A - body.C)) ** (alpha - 1.0) * root * root
    return result


@dataclass(frozen=True, slots=True)
class _Line:
    """The integrands over y, one set for every point."""

    functions: IntegrandFunction
    alpha: float
    log_scale: FloatArray
    """(α − 1) log(|A − C| ρ), shape (points,)."""

    def __call__(self, point: NDArray[np.intp], y: FloatArray) -> FloatArray:
        """Return F(w) z/(α + z)² at ``y`` of shape (panels, nodes), shape (functions, panels, nodes)."""
        alpha = self.alpha
        with np.errstate(all="ignore"):
            # α y + (1 − α) log(1 + e^y), without cancellation for large y.
            shape = np.where(y > 0.0, y, alpha * y) + (1.0 - alpha) * np.log1p(np.exp(-np.abs(y)))
            w = np.exp(self.log_scale[point, None] + shape)
            z = np.exp(y)
            weight = 1.0 / ((alpha + z) * (alpha / z + 1.0))
            values: FloatArray = self.functions(w) * weight
        return values


def _integrate(line: _Line, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the integrals from ``start`` to ``end``, both (points,), shape (functions, points).

    Panels are halved until their Legendre series has converged.
    """
    rule = _rule()
    pending = [(np.arange(len(start)), start, end)]
    total: FloatArray | None = None
    size: FloatArray = np.zeros(len(start))
    for _ in range(MAX_HALVINGS + 1):
        unresolved = []
        for point, left, right in _chunks(pending):
            with np.errstate(all="ignore"):
                half = 0.5 * (right - left)
                y = 0.5 * (left + right)[:, None] + half[:, None] * rule.points
            values = line(point, y)
            lengths = half * (values @ rule.weights)
            if total is None:
                total = np.zeros((len(lengths), len(start)))
            with np.errstate(all="ignore"):
                series = np.abs(values @ rule.tail)
                tail = series.max(axis=-1)
                largest = np.abs(values).max(axis=-1)
                np.maximum.at(size, point, (np.abs(half) * largest).max(axis=0))
                # NaN fails the comparison and is not halved either: it stays.
                rough = (tail > RESOLVED * largest) & (np.abs(half) * tail > NEGLIGIBLE * size[point])
            again = rough.any(axis=0)
            keep = ~again
            for function, length in zip(total, lengths, strict=True):
                np.add.at(function, point[keep], length[keep])
            if again.any():
                middle = 0.5 * (left + right)[again]
                unresolved += [(point[again], left[again], middle), (point[again], middle, right[again])]
        pending = unresolved
        if not pending:
            break
    if total is None:  # no points: the functions give the shape
        return np.zeros((len(line(np.zeros(0, dtype=np.intp), np.zeros((0, NODES)))), 0))
    for point, _, _ in pending:
        total[:, point] = np.nan
    return total


def _chunks(
    pending: list[tuple[NDArray[np.intp], FloatArray, FloatArray]],
) -> list[tuple[NDArray[np.intp], FloatArray, FloatArray]]:
    if not pending:
        return []
    point, left, right = (np.concatenate(parts) for parts in zip(*pending, strict=True))
    return [
        (point[k : k + CHUNK], left[k : k + CHUNK], right[k : k + CHUNK]) for k in range(0, len(point), CHUNK)
    ]


@dataclass(frozen=True, slots=True)
class _Rule:
    """Gauss and Legendre's rule on [−1, 1]."""

    points: FloatArray
    weights: FloatArray
    tail: FloatArray
    """Matrix that takes values at the points to the last two Legendre coefficients, shape (NODES, 2)."""


@cache
def _rule() -> _Rule:
    points, weights = np.polynomial.legendre.leggauss(NODES)
    vandermonde = np.polynomial.legendre.legvander(points, NODES - 1)[:, -2:]
    degrees = np.arange(NODES - 2, NODES)
    return _Rule(points, weights, weights[:, None] * vandermonde * (degrees + 0.5))
