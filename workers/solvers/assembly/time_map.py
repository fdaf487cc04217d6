"""Time as a function of the phase in series on panels, and back: t(u), and u(t) by Newton's method."""

from dataclasses import dataclass

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import Period

FloatArray = NDArray[np.float64]

LAST_NEWTON_STEP = 2e-15
"""A step of Newton's method in [−1, 1] that is the rounding of the series; it is still taken."""
SPEED_POINTS = (-0.6, 0.0, 0.6)
"""Places in a panel at which a function of time is looked at: a feature is about as wide as its panels."""

CHECKED_POINTS = (-0.71, 0.29)
"""Places in a piece, none a node, where the series of the variables are compared with balls."""
UNSEEN_DEPARTURE_FACTOR = 4.0
"""Largest departure between the places that are looked at, in parts of the largest departure at them."""


@dataclass(frozen=True, slots=True)
class TimeMap:
    """t(u) on one turn; for the quadrature u is θ/π, from 0 to 2."""

    edges: FloatArray
    """u at the panels' ends, shape (panels + 1,), growing."""
    rates: FloatArray
    """Chebyshev coefficients of dt/du, shape (degree + 1, panels)."""
    integrals: FloatArray
    """Coefficients of ∫ dt/dx dx from the panel's left end, shape (degree + 2, panels)."""
    times: FloatArray
    """t at the edges."""
    period: Period
    error: float
    """Bound of the error of t(u) within the turn, beside the rounding of doubles."""
    nodes: int
    """Evaluations of the integrand."""
    unproved: int
    """Panels whose error is an estimate."""
    kinks: FloatArray
    """t at the kinks of the rate that panels were cut at."""
    rounding: float = 0.0
    """Rounding of times: where the rate is next to 0, at a pole, no phase is known better."""

    def time_at(self, u: FloatArray) -> FloatArray:
        """Return t(u) on the turn."""
        panel = np.clip(np.searchsorted(self.edges, u, side="right") - 1, 0, len(self.edges) - 2)
        left, right = self.edges[panel], self.edges[panel + 1]
        x = ((u - left) - (right - u)) / (right - left)
        return self.times[panel] + sum_series(self.integrals, panel, x)

    def phase_at(self, times: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Return the panel and the place x in [−1, 1] in it with t(u) = ``times``, in [0, period].

        Newton's method inside a bracket that never grows; t is monotone.
        """
        panel = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        target = times - self.times[panel]
        lengths = self.times[panel + 1] - self.times[panel]
        # A panel may be shorter than doubles tell its ends apart: any place in it will do.
        share = np.divide(target, lengths, out=np.full(len(times), 0.5), where=lengths > 0.0)
        low, high = np.full(len(times), -1.0), np.full(len(times), 1.0)
        half = 0.5 * (self.edges[panel + 1] - self.edges[panel])
        x = self._guess(panel, half, lengths, np.clip(share, 0.0, 1.0))
        # Both series at once: the rates have one coefficient less.
        both = np.stack(
            [self.integrals[:, panel], np.vstack([self.rates, 0.0 * self.times[:-1]])[:, panel]], axis=1
        )
        for _ in range(60):
            passed, rates = _sum(both, x)
            miss = passed - target
            low, high = np.where(miss <= 0.0, x, low), np.where(miss >= 0.0, x, high)
            # Where the series of an unproved panel is 0 there is no step, and the bracket is halved.
            with np.errstate(divide="ignore", invalid="ignore"):
                step = miss / (half * rates)
            is_small, is_met = np.abs(step) <= LAST_NEWTON_STEP, np.abs(miss) <= self.rounding
            newton = np.clip(x - step, -1.0, 1.0)
            # At a pole a step is rounding by rounding: what is met stays unless the step is small, too.
            other = np.where(is_met, x, 0.5 * (low + high))
            x = np.where(is_small | ((newton > low) & (newton < high)), newton, other)
            if np.all(is_small | is_met):
                break
        return panel, x

    def _guess(
        self, panel: NDArray[np.intp], half: FloatArray, lengths: FloatArray, share: FloatArray
    ) -> FloatArray:
        """Return about the place in its panel after a ``share`` of the panel's time.

        Time is taken for the power of the distance from the slower end that has the same rate at the other:
        next to a pole it is about that, and Newton's method alone would come near it by a part at a time.
        """
        even, odd = (self.rates[first::2, panel].sum(axis=0) * half for first in (0, 1))
        power = np.divide(2.0 * (even + np.abs(odd)), lengths, out=np.ones(len(share)), where=lengths > 0.0)
        is_slow_first = odd > 0.0
        since = np.where(is_slow_first, share, 1.0 - share) ** (1.0 / np.maximum(power, 1.0))
        guess: FloatArray = np.where(is_slow_first, 2.0 * since - 1.0, 1.0 - 2.0 * since)
        return guess

    def features(self) -> tuple[FloatArray, FloatArray]:
        """Return times inside every panel, and how long it takes: where a function of time may have features.

        What is narrow in time is in panels as narrow, which resolve it.
        """
        widths = np.diff(self.times)
        panels = np.repeat(np.arange(len(widths)), len(SPEED_POINTS))
        x = np.tile(np.array(SPEED_POINTS), len(widths))
        return self.times[panels] + sum_series(self.integrals, panels, x), widths[panels]

    def evidence(self) -> dict[str, float | int | str]:
        """Return what it took."""
        unproved: dict[str, float | int | str] = {"unproved_panels": self.unproved} if self.unproved else {}
        return {"nodes": self.nodes, "panels": len(self.edges) - 1, **unproved}

    def theta(self, panel: int, x: float) -> arb:
        """Return the phase θ = πu of a place, without rounding it to a double."""
        left, right = arb(float(self.edges[panel])), arb(float(self.edges[panel + 1]))
        # Sums of doubles, halved: exact, and the product nearly so.
        return arb.pi() * ((left + right) / 2 + (right - left) / 2 * x)


def sum_series(coefficients: FloatArray, panel: NDArray[np.intp], x: FloatArray) -> FloatArray:
    """Sum the series of each place's panel, of shape (terms, ..., panels)."""
    return _sum(coefficients[..., panel], x)


def _sum(series: FloatArray, x: FloatArray) -> FloatArray:
    """Sum series of shape (terms, ..., n) at places of shape (n,), by Clenshaw's recurrence."""
    first, second, twice = np.zeros(series.shape[1:]), np.zeros(series.shape[1:]), 2.0 * x
    for row in series[:0:-1]:
        next_one = twice * first
        next_one += row
        next_one -= second
        first, second = next_one, first
    result: FloatArray = series[0] + x * first - second
    return result
