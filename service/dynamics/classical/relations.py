"""The relations of a case along states in the client's axes: residuals, and how far a state is from them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.dynamics.classical.cases import hess, staude
from service.dynamics.classical.placed import Placed

FloatArray = NDArray[np.float64]
Residuals = Callable[[NDArray[np.complex128]], Mapping[str, NDArray[np.complex128]]]
"""Returns what vanishes on a case, by name, shape (n,) each, at states p, q, r, g1, g2, g3, shape (n, 6)."""

_STEP = 1e-40
"""Imaginary step of the derivatives: it loses nothing to cancellation, however small it is."""


@dataclass(frozen=True, slots=True)
class CaseRelations:
    """The relations of a motion, and how many of them are independent."""

    residuals: Residuals
    rank: int

    def values(self, states: FloatArray) -> dict[str, FloatArray]:
        """Return the residuals by name, shape (n,) each."""
        return {name: np.real(each) for name, each in self.residuals(states.astype(complex)).items()}

    def steps(self, states: FloatArray) -> FloatArray:
        """Return the least displacement that satisfies the relations to first order, shape (n, 6).

        Of dependent relations only as many directions are used as are independent on the case itself:
        beside it the others are nearly so, and would make of rounding a long step.
        """
        values = np.stack(list(self.values(states).values()), axis=1)
        slopes = np.empty((*values.shape, 6))
        for k in range(6):
            shifted = states.astype(complex)
            shifted[:, k] += 1j * _STEP
            slopes[:, :, k] = (
                np.stack([np.imag(each) for each in self.residuals(shifted).values()], axis=1) / _STEP
            )
        sizes = np.linalg.norm(slopes, axis=2, keepdims=True)
        sizes = np.where(sizes > 0.0, sizes, 1.0)
        left, widths, right = np.linalg.svd(slopes / sizes, full_matrices=False)
        rank = min(self.rank, widths.shape[1])
        along = np.einsum("nij,ni->nj", left, values / sizes[:, :, 0])[:, :rank] / widths[:, :rank]
        steps: FloatArray = -np.einsum("nj,njk->nk", along, right[:, :rank])
        return steps

    def drifts(self, states: FloatArray) -> dict[str, float]:
        """Return the largest residual of each relation."""
        return {name: float(np.abs(each).max(initial=0.0)) for name, each in self.values(states).items()}

    def distance(self, states: FloatArray) -> float:
        """Return the largest length of :meth:`steps`; NaN if one is not finite."""
        return float(np.linalg.norm(self.steps(states), axis=1).max(initial=0.0)) if len(states) else 0.0


def relations_of(placed: Placed) -> CaseRelations:
    """Return the relations of a motion."""
    match placed.case.form:
        case "hess":
            return CaseRelations(_of_hess(placed), 2)
        case "steady":
            return CaseRelations(_of_staude(placed), 5)
    return CaseRelations(_of_loop(placed), 5)


def _of_loop(placed: Placed) -> Residuals:
    assert placed.reduced is not None
    reduced = placed.reduced.converted(float)
    speed, strength = placed.motion.direction * float(placed.speed), float(placed.strength)

    def residuals(states: NDArray[np.complex128]) -> Mapping[str, NDArray[np.complex128]]:
        columns = list(states.T)
        own = placed.own_state(columns[:3], columns[3:], speed, strength)
        found = dict(reduced.relations(reduced.constants, own))
        return found | ({} if len(found) > 4 else {"|gamma|^2 - 1": unit_length(states)})

    return residuals


def _of_hess(placed: Placed) -> Residuals:
    A, _, C = (float(moment) for moment in placed.fitting.moments)
    frame = placed.fitting.frame
    a, _, c = (float(x) for x in frame.vector(placed.motion.centre))
    G = float(np.hypot(a, c))

    def residuals(states: NDArray[np.complex128]) -> Mapping[str, NDArray[np.complex128]]:
        p, _, r = frame.axial(list(states.T)[:3])
        along = hess.momentum_along(A, C, a / G, c / G, p, r)
        return {"momentum along the centre": along, "|gamma|^2 - 1": unit_length(states)}

    return residuals


def _of_staude(placed: Placed) -> Residuals:
    moments = [float(moment) for moment in placed.fitting.moments]
    centre = [float(x) for x in placed.motion.centre]

    def residuals(states: NDArray[np.complex128]) -> Mapping[str, NDArray[np.complex128]]:
        columns = list(states.T)
        found = dict(staude.relations(moments, centre, columns[:3], columns[3:]))
        return {**found, "|gamma|^2 - 1": unit_length(states)}

    return residuals


def unit_length(states: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return |γ|² − 1, shape (n,)."""
    lengths: NDArray[np.complex128] = (states[:, 3:] ** 2).sum(axis=1) - 1.0
    return lengths
