"""Time as a function of the phase, and back, where time stands still next to a pole."""

import numpy as np
import pytest
from numpy.polynomial import chebyshev

from service.dynamics.solution.dense_output import Period
from workers.solvers.assembly import dense as module
from workers.solvers.assembly.dense import TimeMap


def powers(n: int) -> TimeMap:
    """Return the map of t = 1 ∓ |1 − u|^n before and after u = 1: a pole is passed at t = 1."""
    x = chebyshev.chebpts1(33)
    series = chebyshev.chebfit(x, n * ((1.0 - x) / 2.0) ** (n - 1), 32)
    rates = np.column_stack([series, series * (-1.0) ** np.arange(33)])
    integrals = 0.5 * chebyshev.chebint(rates, lbnd=-1.0, axis=0)
    edges = np.array([0.0, 1.0, 2.0])
    return TimeMap(edges, rates, integrals, edges, Period(2.0, 0.0, 0.0), 0.0, 66, 0, np.zeros(0), 4e-16)


@pytest.mark.parametrize("n", [1, 2, 5, 9, 20])
def test_phases_are_those_of_their_times(n, monkeypatch):
    found, sums, original = powers(n), [], module._sum

    def counted(*parts: np.ndarray) -> np.ndarray:
        sums.append(parts)
        return original(*parts)

    monkeypatch.setattr(module, "_sum", counted)
    times = np.concatenate([np.linspace(0.0, 2.0, 41), 1.0 + np.array([-1e-9, -1e-15, 0.0, 1e-15, 1e-9])])
    panels, x = found.phase_at(times)
    # From a guess that is next to the power Newton's method doubles digits: 1e-2, 1e-4, 1e-8, 1e-16. Next to
    # the pole roundings cost a few halvings of the bracket more. A step from the pole itself would cost 30.
    assert len(sums) <= 16
    assert np.all(np.abs(x) <= 1.0)
    off = found.times[panels] + module.sum_series(found.integrals, panels, x) - times
    # A few roundings of sums of 33 terms of the size 1.
    assert np.abs(off).max() <= 2e-15
    away = np.abs(1.0 - panels - 0.5 * (x + 1.0))
    # Next to the pole a phase is the root of a time with its roundings.
    assert np.abs(away - np.abs(times - 1.0) ** (1.0 / n)).max() <= 1.1 * (4e-15) ** (1.0 / n)
