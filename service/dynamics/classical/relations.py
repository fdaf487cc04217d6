"""The relations of a case along states in the client's axes: residuals, and how far a state is from them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.classical.cases import hess, staude
from service.dynamics.classical.placed import Placed, ball
from service.dynamics.classical.reduced import Number

FloatArray = NDArray[np.float64]
States = NDArray[Number]
"""p, q, r, g1, g2, g3, shape (n, 6), complex or balls."""
Residuals = Callable[[States], Mapping[str, NDArray[Number]]]
"""Returns what vanishes on a case, by name, shape (n,) each."""
OfNumbers = Callable[[Callable[[arb], Number]], Residuals]
"""The residuals with constants that a function makes of balls."""

_STEP = 1e-40
"""Imaginary step of the derivatives: it loses nothing to cancellation, however small it is."""
_BITS = 128
"""Bits of residuals in balls: where slopes nearly vanish, a rounding of doubles would be divided by them."""


@dataclass(frozen=True, slots=True)
class CaseRelations:
    """The relations of a motion, and how many of them are independent."""

    of_numbers: OfNumbers
    rank: int

    def values(self, states: FloatArray) -> dict[str, FloatArray]:
        """Return the residuals by name, shape (n,) each."""
        return {name: np.real(each) for name, each in self.of_numbers(float)(states.astype(complex)).items()}

    def steps(self, states: FloatArray, values: FloatArray | None = None) -> FloatArray:
        """Return the least displacement that satisfies the relations to first order, shape (n, 6).

        Of dependent relations only as many directions are used as are independent on the case itself:
        beside it the others are nearly so, and would make of rounding a long step. ``values`` are residuals
        that are known, shape (n, relations).
        """
        residuals = self.of_numbers(float)
        if values is None:
            values = np.stack(list(self.values(states).values()), axis=1)
        slopes = np.empty((*values.shape, 6))
        for k in range(6):
            shifted = states.astype(complex)
            shifted[:, k] += 1j * _STEP
            slopes[:, :, k] = (
                np.stack([np.imag(each) for each in residuals(shifted).values()], axis=1) / _STEP
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

    def distance(self, states: FloatArray, known: float = 0.0) -> float:
        """Return the largest length of :meth:`steps`; NaN if one is not finite.

        Where slopes nearly vanish, roundings of the residuals alone make long steps. Those that are longer
        than ``known`` are therefore found again from residuals in balls, in some 0.05 ms each.
        """
        if not len(states):
            return 0.0
        lengths = np.linalg.norm(self.steps(states), axis=1)
        long = ~(lengths <= known)
        if long.any():
            lengths[long] = np.linalg.norm(self.steps(states[long], self._in_balls(states[long])), axis=1)
        return float(lengths.max())

    def _in_balls(self, states: FloatArray) -> FloatArray:
        """Return the residuals, free of roundings of their own, shape (n, relations)."""
        with ctx.workprec(_BITS):
            found = self.of_numbers(lambda number: number)(np.vectorize(arb, otypes=[object])(states))
            return np.stack([each.astype(float) for each in found.values()], axis=1)


def relations_of(placed: Placed) -> CaseRelations:
    """Return the relations of a motion."""
    match placed.case.form:
        case "hess":
            return CaseRelations(partial(_of_hess, placed), 2)
        case "steady":
            return CaseRelations(partial(_of_staude, placed), 5)
    return CaseRelations(partial(_of_loop, placed), 5)


def _of_loop(placed: Placed, number: Callable[[arb], Number]) -> Residuals:
    assert placed.reduced is not None
    reduced = placed.reduced.converted(number)
    speed, strength = number(placed.motion.direction * placed.speed), number(placed.strength)

    def residuals(states: States) -> Mapping[str, NDArray[Number]]:
        columns = list(states.T)
        own = placed.own_state(columns[:3], columns[3:], speed, strength)
        found = dict(reduced.relations(reduced.constants, own))
        return found | ({} if len(found) > 4 else {"|gamma|^2 - 1": unit_length(states)})

    return residuals


def _of_hess(placed: Placed, number: Callable[[arb], Number]) -> Residuals:
    A, _, C = (ball(moment) for moment in placed.fitting.moments)
    frame = placed.fitting.frame
    a, _, c = (ball(x) for x in frame.vector(placed.motion.centre))
    G = (a * a + c * c).sqrt()
    A, C, ex, ez = (number(each) for each in (A, C, a / G, c / G))

    def residuals(states: States) -> Mapping[str, NDArray[Number]]:
        p, _, r = frame.axial(list(states.T)[:3])
        along = hess.momentum_along(A, C, ex, ez, p, r)
        return {"momentum along the centre": along, "|gamma|^2 - 1": unit_length(states)}

    return residuals


def _of_staude(placed: Placed, number: Callable[[arb], Number]) -> Residuals:
    moments = [number(ball(moment)) for moment in placed.fitting.moments]
    centre = [number(ball(x)) for x in placed.motion.centre]

    def residuals(states: States) -> Mapping[str, NDArray[Number]]:
        columns = list(states.T)
        found = dict(staude.relations(moments, centre, columns[:3], columns[3:]))
        return {**found, "|gamma|^2 - 1": unit_length(states)}

    return residuals


def unit_length(states: States) -> NDArray[Number]:
    """Return |γ|² − 1, shape (n,)."""
    lengths: NDArray[Number] = (states[:, 3:] ** 2).sum(axis=1) - 1
    return lengths
