from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx
from scipy.integrate import solve_ivp

from tests.support.witnesses.band_edges import band_edges
from workers.solvers.stability.monodromy import equator, transverse_stability

MOMENTS = ("0.6", "1", "1.5", "2", "2.5", "3", "4")
TRACES = {
    "0.3": "2.810230411810 2 0.996244256876 0.385106630609 -0.000207850348 -0.259448901350 -0.580593841300",
    "1": "0.272591193785 2 -0.431022634189 -1.784120475788 -1.969065344260 -1.534812781286 -0.005495326278",
    "2": "-1.553262001949 2 -1.229640939942 -1.608543553235 1.788589694010 7.205281206786 19.690002913594",
}
GROWTH = {("0.3", "0.6"): 2.39221, ("2", "3"): 7.06371, ("2", "4"): 19.6391}
TRIPS_AT_1 = "-1.507511589934 -2 -1.252588266675 -0.464628372155 0.175882505496 0.682046346456 1.412269334696"


@pytest.mark.parametrize("nu", TRACES)
@pytest.mark.parametrize("column", range(len(MOMENTS)))
def test_golden_traces(nu, column):
    B = MOMENTS[column]
    with ctx.workprec(128):
        found = transverse_stability(Fraction(nu), Fraction(B))
    # The table has 12 decimals, rounded.
    assert abs(float(found.trace) - float(TRACES[nu].split()[column])) <= 6e-13
    assert found.trace.rad() < 1e-30
    if (nu, B) in GROWTH:
        assert found.stability == "unstable"
        assert abs(float(found.growth) - GROWTH[nu, B]) <= 1e-4
    else:
        assert found.stability == ("edge" if B == "1" else "stable")
        assert found.growth == 1
    if nu == "1":
        assert abs(float(found.trip_trace) - float(TRIPS_AT_1.split()[column])) <= 6e-13


@pytest.mark.parametrize(
    ("nu", "B"), [("1.7", "0.4"), ("0.8", "0.9"), ("2.4", "1.2"), ("2.4", "2.9"), ("0.5", "3")]
)
def test_against_the_variational_equation(nu, B):
    """q'' = −(g1 + nu (2C−B)/(2B)) q along the motion, a = −1, C = 1, over one period of g1."""
    nu, B = Fraction(nu), Fraction(B)
    x1 = float(equator(nu))

    def rates(_, y):
        # x = g1 with x'' from x'² = 2 x (1 − nu x − x²), and two solutions of the equation.
        x, v, *q = y
        factor = -(x + float(nu * (2 - B) / (2 * B)))
        return [v, 1.0 - 2.0 * float(nu) * x - 3.0 * x * x, q[1], factor * q[0], q[3], factor * q[2]]

    agm = float(arb(x1 + 1.0 / x1).sqrt().agm(arb(1.0 / x1).sqrt()))
    # x'² = 2 x (x1 − x)(x − x2): the trip takes 2π / M(√(2(x1 − x2)), √(−2 x2)).
    trip = 2.0 * np.pi / (2.0**0.5 * agm)
    found = solve_ivp(
        rates, (0.0, trip), [x1, 0.0, 1.0, 0.0, 0.0, 1.0], method="DOP853", rtol=1e-12, atol=1e-12
    )
    assert abs(found.y[0, -1] - x1) < 1e-9
    trace = found.y[2, -1] + found.y[5, -1]
    # The integrator's tolerance over one trip.
    assert abs(trace - float(transverse_stability(nu, B).trip_trace)) <= 1e-9


@pytest.mark.parametrize("nu", ["2", "1.5", "1"])
def test_the_trace_is_2_at_band_edges_and_above_it_on_one_side(nu):
    with ctx.workprec(160):
        for edge in band_edges(Fraction(nu)):
            assert edge is not None
            at = Fraction(edge.mid().str(44, radius=False))
            step = Fraction(1, 10**12)
            below, here, above = (transverse_stability(Fraction(nu), at + k * step) for k in (-1, 0, 1))
            # The edge is known to 1e-44: its trace to that, times a slope of order 1.
            assert abs(here.trace - 2) < arb("1e-20")
            assert (below.stability, above.stability) == ("stable", "unstable")
            assert below.trace < 2
            assert above.trace > 2
            assert above.growth > 1


def test_physical_bodies_are_stable_up_to_nu_three_halves():
    """At nu = 3/2 the edge is exactly B = 3C, the thinnest disc."""
    edge = band_edges(Fraction(3, 2))[1]
    assert edge is not None
    assert edge.contains(3)
    assert transverse_stability(Fraction(3, 2), Fraction(3)).stability == "edge"
    assert transverse_stability(Fraction(149, 100), Fraction(3)).stability == "stable"
    assert transverse_stability(Fraction(151, 100), Fraction(3)).stability == "unstable"


def test_lagranges_top_is_at_an_edge_exactly():
    found = transverse_stability(Fraction(7, 5), Fraction(1))
    assert found.trip_trace == -2
    assert found.trace == 2


def test_no_upper_edge_for_small_nu():
    # It exists for nu > 1/√2.
    assert band_edges(Fraction("0.7071"))[1] is None
    assert band_edges(Fraction("0.7072"))[1] is not None
