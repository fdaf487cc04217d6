r"""Splits a dense output into pieces on which angles and quaternion are resolved too.

On a piece of half-length η the increments of the angles are antiderivatives, and
the quaternion is that of the piece's start times Φ with

.. math:: \Phi(x) = 1 + \frac{\eta}{2}\int_{-1}^{x} \Phi\,\omega\,dx ,

solved by collocation at Chebyshev's points: a Volterra equation, for which
Picard's iteration converges like a power series of the exponential. Φ does not
depend on what comes before, so all pieces are solved at once.
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from service.dynamics.equations.orientation import azimuth_rate, quaternion_product
from service.dynamics.errors import DynamicsError
from service.dynamics.solution.dense_output import (
    EPSILON,
    DenseOutput,
    FloatArray,
    chebyshev_coefficients,
    chebyshev_points,
)
from workers.solvers.assembly.dense import integration_matrix

MIN_DEGREE = 20
"""Smallest degree of the series; that of the motion's own if it is higher."""
MAX_TAIL = 1e-15
"""Largest tail of a resolved series: the rounding of values of size one."""
MAX_PICARD_TURN = 1.0
"""η |ω|: beyond it Picard's iteration loses digits by cancellation, like the exponential's series."""
PICARD_STEPS = 24
"""Number of steps of Picard's iteration: 1/24! is below 2^-53 by many orders."""
MIN_HALF_PIECE_ULPS = 8
"""Half a piece in ulp of its times, below which it is not halved."""
MAX_PIECES = 400_000
PIECES_TOGETHER = 2048
"""Pieces looked at together, for the sake of memory."""


class OrientationNotResolvedError(DynamicsError):
    """The attitude needs more pieces than allowed."""

    code = "orientation_not_resolved"


class VerticalAxisError(DynamicsError):
    """An axis of the body comes so close to the vertical that its azimuth loses its meaning."""

    code = "vertical_axis"

    def __init__(self, axis: int) -> None:
        super().__init__(
            f"axis {axis + 1} of the body passes the vertical so closely that rounding hides its azimuth",
            pointer="/outputs",
        )
        self.axis = axis


@dataclass(frozen=True, slots=True)
class Pieces:
    """Pieces with everything about the attitude but where it starts."""

    parent: NDArray[np.intp]
    """Each one's piece of the given dense output."""
    low: FloatArray
    """Where it begins in its parent's x in [−1, 1]."""
    high: FloatArray
    motion: FloatArray
    """Coefficients of the six variables, shape (pieces, degree + 1, 6)."""
    propagators: FloatArray
    """Coefficients of Φ, shape (pieces, degree + 1, 4)."""
    increments: FloatArray
    """Coefficients of the angles' increments since the piece's start, shape (pieces, degree + 1, axes)."""
    tails: FloatArray
    """Largest of the last coefficients of Φ and of each increment, shape (pieces, 1 + axes)."""
    weights: FloatArray
    """∫ Σ |∂ψ̇/∂(variables)| dt over the piece, shape (pieces, axes)."""
    is_resolved: NDArray[np.bool_]

    def chosen(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> "Pieces":
        """Return some of the pieces."""
        return Pieces(*(getattr(self, name)[which] for name in self.__slots__))


def resolve_attitude(dense: DenseOutput, axes: tuple[int, ...], *, closest: float) -> Pieces:
    """Halve the pieces of ``dense`` until the attitude and the azimuths of ``axes`` (0, 2) are resolved.

    Raises
    ------
    VerticalAxisError
        One of ``axes`` comes closer to the vertical than the angle ``closest``.
    OrientationNotResolvedError
        More than MAX_PIECES pieces would be needed, or shorter ones than times can tell.
    """
    solver = _Solver(dense, axes, closest)
    done: list[Pieces] = []
    for start in range(0, len(dense.breaks) - 1, PIECES_TOGETHER):
        parent = np.arange(start, min(start + PIECES_TOGETHER, len(dense.breaks) - 1))
        low, high = np.full(len(parent), -1.0), np.full(len(parent), 1.0)
        while len(parent):
            pieces = solver.solve(parent, low, high)
            done.append(pieces.chosen(pieces.is_resolved))
            rest = pieces.chosen(~pieces.is_resolved)
            middle = 0.5 * (rest.low + rest.high)
            parent = np.concatenate([rest.parent, rest.parent])
            low, high = np.concatenate([rest.low, middle]), np.concatenate([middle, rest.high])
            if len(parent) + sum(len(part.parent) for part in done) > MAX_PIECES:
                raise OrientationNotResolvedError(f"the attitude would need more than {MAX_PIECES} pieces")
    joined = Pieces(*(np.concatenate([getattr(part, name) for part in done]) for name in Pieces.__slots__))
    return joined.chosen(np.lexsort((joined.low, joined.parent)))


class _Solver:
    """The collocation on pieces of one dense output."""

    def __init__(self, dense: DenseOutput, axes: tuple[int, ...], closest: float) -> None:
        self._dense, self._axes, self._closest = dense, axes, closest
        degree = max(MIN_DEGREE, dense.coefficients.shape[1] - 1)
        self._points = chebyshev_points(degree)
        self._gap = np.pi / degree
        self._interpolation = chebyshev_coefficients(np.eye(degree + 1))
        self._integration = integration_matrix(degree)

    def solve(self, parent: NDArray[np.intp], low: FloatArray, high: FloatArray) -> Pieces:
        left, right = self._dense.breaks[parent], self._dense.breaks[parent + 1]
        half = 0.25 * (right - left) * (high - low)
        motion, values = self._motion(parent, low, high)
        omega = values[:, :, :3]
        turn = half * np.sqrt(np.square(omega).sum(axis=2).max(axis=1))
        propagators = self._interpolation @ self._propagators(omega, half)
        increments, weights, is_seen = self._angles(values, half)
        series = self._interpolation @ increments
        tails = np.concatenate(
            [np.abs(propagators[:, -2:]).max(axis=(1, 2))[:, None], np.abs(series[:, -2:]).max(axis=1)],
            axis=1,
        )
        sizes = np.maximum(1.0, np.abs(increments).max(axis=1))
        is_short = half <= MIN_HALF_PIECE_ULPS * np.spacing(np.maximum(np.abs(left), np.abs(right)))
        # Close to the vertical the rounding of the variables themselves is seen enlarged.
        allowed = MAX_TAIL * sizes + EPSILON * weights
        is_fine = (tails[:, 0] <= MAX_TAIL) & (tails[:, 1:] <= allowed).all(axis=1)
        if np.any(is_short & (turn > MAX_PICARD_TURN)):
            raise OrientationNotResolvedError("the body turns faster than times in doubles can tell")
        is_resolved = (is_fine & is_seen & (turn <= MAX_PICARD_TURN)) | is_short
        return Pieces(parent, low, high, motion, propagators, series, tails, weights, is_resolved)

    def _motion(
        self, parent: NDArray[np.intp], low: FloatArray, high: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the coefficients and the values at the points of the six variables."""
        given = self._dense.coefficients[parent]
        middle, share = 0.5 * (low + high), 0.5 * (high - low)
        x = middle[:, None] + share[:, None] * self._points
        table = chebyshev.chebvander(x, given.shape[1] - 1)
        padded = np.pad(given, ((0, 0), (0, len(self._points) - given.shape[1]), (0, 0)))
        # A whole piece keeps its numbers to the last bit. On a part of it no polynomial has a higher degree:
        # as sums of values at the points, high coefficients would have the rounding of the largest one.
        is_whole = (share == 1.0)[:, None, None]
        return np.where(is_whole, padded, np.triu(self._interpolation @ table) @ given), table @ given

    def _propagators(self, omega: FloatArray, half: FloatArray) -> FloatArray:
        """Return Φ at the points; meaningless where the piece turns too far."""
        rate = 0.5 * half[:, None, None] * np.pad(omega, ((0, 0), (0, 0), (1, 0)))
        rate = rate * np.where(np.abs(rate).max(axis=(1, 2), keepdims=True) <= MAX_PICARD_TURN, 1.0, 0.0)
        identity = np.array([1.0, 0.0, 0.0, 0.0])
        phi = np.broadcast_to(identity, rate.shape)
        for _ in range(PICARD_STEPS):
            phi = identity + self._integration @ quaternion_product(phi, rate)
        return phi

    def _angles(
        self, values: FloatArray, half: FloatArray
    ) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """Return the azimuths' increments at the points, their weights, and whether nothing hides between.

        There an axis comes closer to the vertical by half the distance of the points at most, at its own
        speed: that of an axis about which the body spins, next to the vertical, is small.
        """
        is_seen = np.ones(len(values), dtype=np.bool_)
        increments = np.empty((*values.shape[:2], len(self._axes)))
        weights = np.empty((len(values), len(self._axes)))
        for k, axis in enumerate(self._axes):
            rate, slopes, square = azimuth_rate(values, axis)
            if square.min() < self._closest**2:
                raise VerticalAxisError(axis)
            others = [other for other in range(3) if other != axis]
            goes = half * self._gap * np.sqrt(np.square(values[:, :, others]).sum(axis=2).max(axis=1))
            is_seen &= goes <= np.sqrt(square.min(axis=1))
            increments[:, :, k] = half[:, None] * (rate @ self._integration.T)
            weights[:, k] = half * (np.abs(slopes).sum(axis=2) @ self._integration[0])
        return increments, weights, is_seen
