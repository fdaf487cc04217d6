"""The compiled resolution of a motion in time is that of arrays, and says where it leaves it to these."""

import numpy as np
import pytest

from service.dynamics.problem import PlanarMotion
from tests.support.planar import body, formula
from workers.solvers.assembly.dense import FIRST_PIECES, MAX_RELATIVE_FINENESS, resolve_motion
from workers.solvers.compiled.motion import NODES, resolve_one
from workers.solvers.compiled.records import new_records
from workers.solvers.compiled.solve import solve_spectral
from workers.solvers.compiled.workspace import WORKSPACE

BODY = body(2, 1)


def motion():
    found = solve_spectral(
        BODY, formula("-g1 + 1/(20*g3^2)", BODY), PlanarMotion(None, nu=1), tier="standard"
    )
    assert found is not None
    return found


@pytest.mark.parametrize("atol", [1e-8, 1e-14])
def test_pieces_are_those_of_arrays(atol):
    found = motion()
    compiled = found.resolved(FIRST_PIECES, atol)
    hi = found.period.hi
    by_arrays = resolve_motion(found.sample, (0.0, hi), np.zeros(0), scale=hi, atol=atol)
    assert compiled is not None
    # Breaks are halves of one another, rounded; the last is the period.
    np.testing.assert_allclose(compiled.breaks, by_arrays.breaks, rtol=1e-15, atol=0)
    assert compiled.breaks[-1] == hi
    # Sums of 21 products of the size 1, in another order, of samples at times an ulp apart.
    np.testing.assert_allclose(compiled.coefficients, by_arrays.coefficients, rtol=0, atol=1e-13)
    assert compiled.evaluations == by_arrays.evaluations
    assert compiled.departure == pytest.approx(by_arrays.departure, rel=1e-3, abs=2e-15)


def test_a_draft_of_few_pieces_departs_no_more_than_it_says():
    found = motion()
    resolved = found.resolved(4, 1e-8)
    assert resolved is not None
    times = np.linspace(0.0, found.period.hi, 5001)[:-1]
    piece = np.searchsorted(resolved.breaks, times, side="right") - 1
    left, right = resolved.breaks[piece], resolved.breaks[piece + 1]
    x = (2.0 * times - left - right) / (right - left)
    values = np.array(
        [
            np.polynomial.chebyshev.chebval(at, resolved.coefficients[n])
            for at, n in zip(x, piece, strict=True)
        ]
    )
    # Samples of the map and the series are sums of roundings besides.
    assert np.abs(values - found.sample(times)).max() <= resolved.error + 1e-14


@pytest.mark.parametrize("most", [8, 9])
def test_more_pieces_than_there_is_room_for_are_left_to_others(most):
    found = motion()
    done, _, _ = resolve_one(
        found.loops, found.panels, found.period.hi, 8, 1e-14, MAX_RELATIVE_FINENESS, new_records(WORKSPACE),
        np.empty(most), np.empty((most, NODES, 6)),
    )  # fmt: skip
    assert done == 0


def test_a_motion_that_is_not_finite_is_left_to_others():
    found = motion()
    found.loops["z"][0] = np.nan
    assert found.resolved(FIRST_PIECES, 1e-14) is None
