"""The time map: series of dt/dx and of t that fit, panels that join, and what is said of both."""

from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.problem import PlanarMotion
from tests.support.effort import one_in
from tests.support.planar import body, formula
from workers.solvers.compiled.evaluation.curve import place, rates
from workers.solvers.compiled.evaluation.program import make_program
from workers.solvers.compiled.frame import make_frame
from workers.solvers.compiled.records import MAX_PANELS, NODES, PANEL, new_records
from workers.solvers.compiled.solve import TOLERANCES, Batch, solve_batch
from workers.solvers.compiled.solve_set import new_formula
from workers.solvers.compiled.time_map.error import (
    DEGREE,
    add_roundings,
    build_time_map,
    larger,
    map_error,
    seen_between,
)
from workers.solvers.compiled.time_map.panels import MATRIX, POINTS, at, distance, slope_at, time_at
from workers.solvers.compiled.time_map.sampling import extent
from workers.solvers.compiled.workspace import WORKSPACE

DOUBLE = body(2, 1)
chebyshev = np.polynomial.chebyshev


FORMULAS = "-g1 + 1/(20*g3^2)", "-g1*(cos(g2)^2 + sin(g2)^2) + 1/(20*g3^2)"


@pytest.fixture(scope="module", params=one_in(2, FORMULAS))
def solved(request):
    """A motion whose series are taken as they are, and the same one with series that are proved."""
    program, constants = make_program(formula(request.param, DOUBLE).tape)
    frame = make_frame(DOUBLE, PlanarMotion(Fraction(1)))
    run = solve_batch(Batch(program, constants[None, :], frame.shared, "standard"))
    return run, new_formula(*program[:3], constants)


def test_the_matrix_turns_values_into_series():
    for k in range(NODES):
        values = np.cos(k * np.arccos(POINTS))
        # A sum of NODES numbers up to 1.
        assert np.allclose(values @ MATRIX, np.eye(NODES)[k], rtol=0, atol=1e-14)


def test_time_is_the_integral_of_its_rate(solved):
    run, _ = solved
    for panel in run.panels:
        integral = chebyshev.chebint(panel.slopes)
        ends = chebyshev.chebval(np.array([panel.first, panel.last]), integral)
        # Roundings of NODES terms.
        assert abs((ends[1] - ends[0]) - panel.length) < 1e-14 * max(1.0, panel.length)
        assert at(panel, panel.first)[0] == pytest.approx(0.0, abs=1e-15)


def test_panels_join(solved):
    run, _ = solved
    panels, loop = run.panels, run.loops[0]
    starts = [panel.start + panel.start_lo for panel in panels]
    lengths = [panel.length for panel in panels]
    assert np.allclose(np.cumsum(lengths[:-1]), starts[1:], rtol=1e-15, atol=0)
    turn = 1.0 if loop.rotates else 0.5
    length = sum(lengths)
    assert loop.period_hi * turn == pytest.approx(length, rel=1e-15)
    times = [time_at(panels, len(panels), u)[0] for u in np.linspace(0.0, 1.0, 101)]
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(length, rel=1e-15)
    assert (np.diff(times) > 0.0).all()


def test_what_is_said_of_the_map_is_found_again(solved):
    run, worked = solved
    panels, workspace = new_records(PANEL, MAX_PANELS), new_records(WORKSPACE)[0]
    number, _ = build_time_map(worked, run.loops[0], TOLERANCES["standard"], panels, workspace)
    assert number == len(run.panels)
    astray = np.empty(number)
    error, rate_error = map_error(worked, run.loops[0], panels, number, workspace.places, astray)
    add_roundings(panels, number, astray)
    found = run.found[0]
    assert (found.rate_error, found.period_error) == (
        rate_error,
        error * (1.0 if run.loops[0].rotates else 2.0),
    )
    said = extent(run.loops[0], panels, number, workspace.moments, astray)
    assert (found.speed, found.largest, found.moved) == said


def test_what_times_are_worth_is_a_product_at_a_place(solved):
    run, _ = solved
    panels, number, moments = run.panels, len(run.panels), new_records(WORKSPACE)[0].moments
    speed, _, all_alike = extent(run.loops[0], panels, number, moments, np.full(number, 0.5))
    # Where all panels are off by as much, the place of the largest speed decides.
    assert all_alike == 0.5 * speed
    products = [extent(run.loops[0], panels, number, moments, row)[2] for row in np.eye(number)]
    # A step between places belongs to one panel, to two of them at most where it ends one.
    assert max(products) == speed
    assert min(products) < speed
    assert np.isnan(extent(run.loops[0], panels, number, moments, np.full(number, np.nan))[2])


@pytest.mark.parametrize("tier", ["draft", "standard"])
def test_series_depart_by_no_more_than_what_is_said(solved, tier):
    run, worked = solved
    panels, workspace = new_records(PANEL, MAX_PANELS), new_records(WORKSPACE)[0]
    loop = run.loops[0]
    number, _ = build_time_map(worked, loop, TOLERANCES[tier], panels, workspace)
    _, rate_error = map_error(worked, loop, panels, number, workspace.places, np.empty(number))
    places = workspace.places
    for panel in panels[:number]:
        # Next to a rest the formula's own rounding grows, and what is said of p and r is said of the panel.
        first, last = (
            x if x != 0.0 else 0.38 * (panel.first + panel.last) for x in (panel.first, panel.last)
        )
        for count, x in enumerate(np.linspace(first, last, 53)[1:-1].tolist()):
            at_x = place(loop, panel.anchor, distance(panel, x))
            k = count % 16
            places.below[k], places.above[k], places.sine[k], places.cosine[k], places.speed[k] = at_x
            rates(worked, loop, places, k + 1)
            series = slope_at(panel, x) / (0.5 * (panel.high - panel.low))
            # A rounding of the series beside it.
            assert abs(series / places.rate[k] - 1.0) <= rate_error + 4e-16


def test_nan_is_the_larger():
    assert np.isnan(larger(np.nan, 1.0))
    assert np.isnan(larger(1.0, np.nan))
    assert larger(1.0, 2.0) == larger(2.0, 1.0) == 2.0


@pytest.mark.parametrize("pole", [1.1, 1.5, 3.0])
def test_what_is_seen_between_the_nodes_is_there(pole):
    """With p for f = 1/(pole − x) and q for 1/f², |p² q − 1| is nowhere more than what is said."""
    nodes = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
    f = 1.0 / (pole - nodes)
    p, q = chebyshev.chebfit(nodes, f, DEGREE), chebyshev.chebfit(nodes, 1.0 / f**2, DEGREE)
    x = np.linspace(-1.0, 1.0, 2001)
    off = np.abs(chebyshev.chebval(x, p) ** 2 * chebyshev.chebval(x, q) - 1.0).max()
    seen = seen_between(p, q)
    # numpy's fit has roundings of its own.
    assert off <= seen + 1e-12
    assert seen < 64.0 * off + 1e-12
