"""Time as a function of the phase: t(θ) = ∫ (dt/dθ) dθ, and back.

The phase is counted in half turns, u = θ/π: a turn is exactly 0 ≤ u ≤ 2 in
doubles, and the period is not off by the rounding of π.

dt/dθ is resolved by Chebyshev series on panels, halved where the series does
not converge: near a separatrix and near a pole that is passed without
smoothness panels shrink geometrically, elsewhere a handful serves. Lengths of
the panels are summed in balls, so the period has more digits than a double.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.dense_output import Period, chebyshev_coefficients
from service.dynamics.errors import DynamicsError

FloatArray = NDArray[np.float64]

DEGREE = 32
RESOLVED = 4e-16
"""Largest tail of a resolved panel's series against its largest term: the rounding of doubles."""
CHANGE = 3e-13
"""Largest relative change of a resolved panel's length when its nodes were last doubled:
demanded on top, since it sees below the rounding of the series."""
ALIASING = 1.0 / 16.0
"""Share of the series' tail that can reach the length: T_k integrates to 2/(1 − k²), and what
is beyond the degree n is taken for T_(2n−k), both about 1/500 next to n = 32; a factor 30 is kept."""
NEGLIGIBLE = 1e-17
"""Panels whose unresolved tail is below this share of the whole need not be resolved."""
SMALLEST_PANEL = 1e-15
SETTLED = 2e-15
"""A step of Newton's method in [−1, 1] that is the rounding of the series; it is still taken."""
MAX_PANELS = 4000


class QuadratureNotConvergedError(DynamicsError):
    """Halving the panels stopped before the integrand was resolved."""

    code = "quadrature_not_converged"


class PrecisionLostError(DynamicsError):
    """The balls of the integrand became too wide: more bits are needed."""

    code = "precision_lost"


@dataclass(frozen=True, slots=True)
class TimeMap:
    """t(u) on one turn."""

    edges: FloatArray
    """u at the panels' ends, shape (panels + 1,), from 0 to 2."""
    rates: FloatArray
    """Chebyshev coefficients of dt/du, shape (DEGREE + 1, panels)."""
    integrals: FloatArray
    """Coefficients of ∫ dt/dx dx from the panel's left end, shape (DEGREE + 2, panels)."""
    times: FloatArray
    """t at the edges."""
    period: Period
    nodes: int
    """Evaluations of the integrand."""

    def time_at(self, u: FloatArray) -> FloatArray:
        """Return t(u) for 0 ≤ u ≤ 2."""
        panel = np.clip(np.searchsorted(self.edges, u, side="right") - 1, 0, len(self.edges) - 2)
        left, right = self.edges[panel], self.edges[panel + 1]
        x = ((u - left) - (right - u)) / (right - left)
        return self.times[panel] + _series(self.integrals, panel, x)

    def phase_at(self, times: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Return the panel and the place x in [−1, 1] in it with t(u) = ``times``, in [0, period].

        Newton's method inside a bracket that never grows; t is monotone.
        """
        panel = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        target = times - self.times[panel]
        share = target / (self.times[panel + 1] - self.times[panel])
        low, high = np.full(len(times), -1.0), np.full(len(times), 1.0)
        x = np.clip(2.0 * share - 1.0, -1.0, 1.0)
        half = 0.5 * (self.edges[panel + 1] - self.edges[panel])
        for _ in range(60):
            miss = _series(self.integrals, panel, x) - target
            low, high = np.where(miss <= 0.0, x, low), np.where(miss >= 0.0, x, high)
            step = miss / (half * _series(self.rates, panel, x))
            settled = np.abs(step) <= SETTLED
            newton = np.clip(x - step, -1.0, 1.0)
            x = np.where(settled | ((newton > low) & (newton < high)), newton, 0.5 * (low + high))
            if np.all(settled):
                break
        return panel, x

    def evidence(self) -> dict[str, float | int | str]:
        """Return what it took."""
        return {"nodes": self.nodes, "panels": len(self.edges) - 1}

    def theta(self, panel: int, x: float) -> arb:
        """Return the phase θ = πu of a place, without rounding it to a double."""
        left, right = float(self.edges[panel]), float(self.edges[panel + 1])
        return arb.pi() * (arb(left) * (1 - arb(x)) + arb(right) * (1 + arb(x))) / 2


@dataclass(frozen=True, slots=True)
class _Rule:
    """Clenshaw and Curtis (1960): integration on [−1, 1] by the points cos(πj/DEGREE)."""

    points: tuple[arb, ...]
    weights: tuple[arb, ...]
    coarse_weights: tuple[arb, ...]
    """Of the rule with every other point."""


@dataclass(frozen=True, slots=True)
class _Panel:
    left: float
    right: float
    series: FloatArray
    length: arb
    change: float
    """Relative change of the length from half the nodes."""

    @property
    def tail(self) -> float:
        """Bound of what the series leaves out of the length, up to a small factor."""
        return float(np.abs(self.series[-2:]).sum()) * (self.right - self.left)

    @property
    def is_resolved(self) -> bool:
        size = float(np.abs(self.series).max())
        return float(np.abs(self.series[-2:]).max()) <= RESOLVED * size and self.change <= CHANGE

    @property
    def error(self) -> float:
        """Estimate of the error of the length."""
        return self.tail * ALIASING if self.is_resolved else self.tail


def make_time_map(rate: Callable[[arb], arb], corners: tuple[float, ...], *, is_even: bool) -> TimeMap:
    """Integrate ``rate``, dt/dθ as a function of θ, over one turn.

    Parameters
    ----------
    corners
        u where the rate may not be smooth; panels end there.
    is_even
        The rate at 2π − θ is that at θ: only half a turn is computed.

    Raises
    ------
    QuadratureNotConvergedError
        The rate is not resolved by the largest number of panels.
    PrecisionLostError
        The rate is not known to a double's precision.
    """
    end = 1.0 if is_even else 2.0
    starts = {0.0, end, *np.linspace(0.0, end, 3).tolist(), *(c for c in corners if 0.0 < c < end)}
    edges = sorted(starts)
    waiting = list(pairwise(edges))[::-1]
    done: list[_Panel] = []
    scale, nodes, rule = 0.0, 0, _rule()
    while waiting:
        left, right = waiting.pop()
        panel = _integrate(rate, left, right, rule)
        nodes += DEGREE + 1
        scale = max(scale, float(panel.length))
        if panel.is_resolved or panel.tail <= NEGLIGIBLE * scale or right - left < SMALLEST_PANEL:
            done.append(panel)
        else:
            middle = 0.5 * (left + right)
            waiting.extend([(middle, right), (left, middle)])
        if len(done) + len(waiting) > MAX_PANELS:
            raise QuadratureNotConvergedError(
                f"{MAX_PANELS} panels of degree {DEGREE} do not resolve the integrand; "
                f"the last tail was {panel.tail / scale:.1e} of the whole"
            )
    return _assemble(done, nodes, is_even=is_even)


def _integrate(rate: Callable[[arb], arb], left: float, right: float, rule: _Rule) -> _Panel:
    middle, half, pi = (arb(left) + arb(right)) / 2, (arb(right) - arb(left)) / 2, arb.pi()
    values = [pi * rate(pi * (middle + half * x)) for x in rule.points]
    if min(value.rel_accuracy_bits() for value in values) < 60:
        raise PrecisionLostError("the integrand is known to fewer than 60 bits")
    doubles = np.array([float(value) for value in values])
    if not np.isfinite(doubles).all():
        raise QuadratureNotConvergedError("the time of a part of the way is beyond all doubles")
    length = _sum(rule.weights, values)
    coarse = _sum(rule.coarse_weights, values[::2])
    series = chebyshev_coefficients(doubles)
    change = abs(float((length - coarse) / length))
    return _Panel(left, right, series, (length * half).mid(), change)


def _sum(weights: tuple[arb, ...], values: list[arb]) -> arb:
    total = arb(0)
    for weight, value in zip(weights, values, strict=True):
        total += weight * value
    return total


def _assemble(panels: list[_Panel], nodes: int, *, is_even: bool) -> TimeMap:
    if is_even:
        signs = (-1.0) ** np.arange(DEGREE + 1)
        turned = [_Panel(2.0 - p.right, 2.0 - p.left, p.series * signs, p.length, p.change) for p in panels]
        panels = panels + turned[::-1]
    edges = np.array([panels[0].left, *(panel.right for panel in panels)])
    half = 0.5 * np.diff(edges)
    rates = np.stack([panel.series for panel in panels], axis=1)
    integrals = np.polynomial.chebyshev.chebint(rates, lbnd=-1.0, axis=0) * half
    total, times = arb(0), [0.0]
    for panel in panels:
        total = (total + panel.length).mid()
        times.append(float(total))
    hi = float(total)
    error = sum(panel.error for panel in panels)
    period = Period(hi, float(total - arb(hi)), error)
    return TimeMap(edges, rates, integrals, np.array(times), period, nodes)


def _series(coefficients: FloatArray, panel: NDArray[np.intp], x: FloatArray) -> FloatArray:
    """Sum the series of each place's panel by Clenshaw's recurrence."""
    chosen = coefficients[:, panel]
    first, second = np.zeros_like(x), np.zeros_like(x)
    for row in chosen[:0:-1]:
        first, second = row + 2.0 * x * first - second, first
    result: FloatArray = chosen[0] + x * first - second
    return result


def _rule() -> _Rule:
    points = tuple((arb.pi() * k / DEGREE).cos() for k in range(DEGREE + 1))
    return _Rule(points, _weights(DEGREE), _weights(DEGREE // 2))


def _weights(degree: int) -> tuple[arb, ...]:
    cosines = [(arb.pi() * k / degree).cos() for k in range(2 * degree)]
    weights = []
    for j in range(degree + 1):
        total = arb(1)
        for k in range(1, degree // 2 + 1):
            factor = 1 if 2 * k == degree else 2
            total -= factor * cosines[2 * k * j % (2 * degree)] / (4 * k * k - 1)
        weights.append(total * (1 if j in (0, degree) else 2) / degree)
    return tuple(weights)
