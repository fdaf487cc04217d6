r"""Gauss' collocation of Hill's equation on one interval, compiled.

With the stages and the integrals a_ij, b_j of :mod:`workers.solvers.stability.monodromy`, and α = ω dt/dx,
β = c/(B ω) dt/dx at the stages, y = (q, M/(B ω)) obeys

.. math:: q_i = q_0 - \sum_j a_{ij} α_j m_j, \qquad m_i = m_0 + \sum_j a_{ij} β_j q_j .

The second eliminates m from the first: one linear system in as many unknowns as there are stages.
"""

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.transverse.hill import WIDTH

FloatArray = NDArray[np.float64]

STAGES, WEIGHTS = legendre.leggauss(WIDTH)
_P = legendre.legvander(STAGES, WIDTH)
INTEGRALS = np.ascontiguousarray(
    0.5 * (np.column_stack([STAGES + 1.0, _P[:, 2:] - _P[:, :-2]]) @ _P[:, :-1].T) * WEIGHTS
)
"""a_ij, shape (stages, stages); from ∫ P_k dx = (P_{k+1} − P_{k−1}) / (2k + 1)."""


@kernel
def solve_in_place(matrix: FloatArray, right: FloatArray) -> None:
    """Replace ``right``, shape (n, 2), by the solution of a linear system, by elimination with pivots."""
    size = len(matrix)
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        if best != k:
            for j in range(k, size):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
            for j in range(2):
                right[k, j], right[best, j] = right[best, j], right[k, j]
        inverse = 1.0 / matrix[k, k]
        for i in range(k + 1, size):
            factor = matrix[i, k] * inverse
            if factor != 0.0:
                for j in range(k + 1, size):
                    matrix[i, j] -= factor * matrix[k, j]
                right[i, 0] -= factor * right[k, 0]
                right[i, 1] -= factor * right[k, 1]
    for k in range(size - 1, -1, -1):
        for j in range(2):
            total = right[k, j]
            for i in range(k + 1, size):
                total -= matrix[k, i] * right[i, j]
            right[k, j] = total / matrix[k, k]


@kernel
def cross(alpha: FloatArray, beta: FloatArray, q: FloatArray, m: FloatArray, end: FloatArray) -> None:
    """Fill in the solutions from (1, 0) and (0, 1) at the stages (2, stages), and at the end (2, 2)."""
    matrix, right = np.zeros((WIDTH, WIDTH)), np.empty((WIDTH, 2))
    for i in range(WIDTH):
        right[i, 0], right[i, 1] = 1.0, 0.0
        for k in range(WIDTH):
            weight = INTEGRALS[i, k] * alpha[k]
            right[i, 1] -= weight
            for j in range(WIDTH):
                matrix[i, j] += weight * (INTEGRALS[k, j] * beta[j])
        matrix[i, i] += 1.0
    solve_in_place(matrix, right)
    for i in range(WIDTH):
        q[0, i], q[1, i] = right[i, 0], right[i, 1]
    for j in range(2):
        for i in range(WIDTH):
            total = 0.0 + j
            for k in range(WIDTH):
                total += INTEGRALS[i, k] * beta[k] * q[j, k]
            m[j, i] = total
        first, second = 1.0 - j, 0.0 + j
        for k in range(WIDTH):
            first -= WEIGHTS[k] * alpha[k] * m[j, k]
            second += WEIGHTS[k] * beta[k] * q[j, k]
        end[0, j], end[1, j] = first, second
