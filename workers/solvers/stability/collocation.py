r"""Gauss-Legendre collocation of y' = A(x) y, for many intervals at once.

With the STAGES zeros x_i of a Legendre polynomial and a_ij = ∫_{−1}^{x_i} L_j dx,
b_j = ∫_{−1}^{1} L_j dx of their Lagrange polynomials L_j(x),

.. math:: Y_i = 1 + \sum_j a_{ij} A_j Y_j,\qquad Y(1) = 1 + \sum_j b_j A_j Y_j ,

which is of order 2·STAGES and keeps det Y = 1 where tr A = 0 (Hairer, Lubich
and Wanner, Geometric Numerical Integration, II.1.3 and IV.2). The stages never
lie at an end of the interval: A may be undefined there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

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
