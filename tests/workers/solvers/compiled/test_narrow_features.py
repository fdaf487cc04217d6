"""Bumps and wells that no node of a panel need see: their periods are right, or not decided by doubles."""

from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.problem import PlanarMotion
from tests.support.effort import each_once
from tests.support.planar import body, formula
from workers.solvers.compiled.evaluation.curve import place, radicands
from workers.solvers.compiled.evaluation.program import make_program
from workers.solvers.compiled.records import new_records
from workers.solvers.compiled.solve import solve_spectral
from workers.solvers.compiled.solve_set import new_formula
from workers.solvers.compiled.workspace import PLACES

DOUBLE = body(2, 1)
ONE = PlanarMotion(Fraction(1))


def bumped(factor, width, place_="3/10"):
    return f"-g1+(2*g1^2+g3^2)*({factor})*exp(-10^{2 * width}*(g2-({place_}))^2)"


def period(factor, width, centre=0.3):
    """Integrate 2 ∫ Z dv/(c √P), P = (1 − 2 g1 F(g2))/2 > 0, by Gauss's rule on pieces graded to the bump."""
    G = (5.0**0.5 - 1.0) / 2.0
    Z = G**0.5

    def at(v):
        s = np.sin(v)
        c = np.sqrt(Z * Z + G * G * (1.0 + s * s))
        return G * s * s, c * np.cos(v), c

    low, high = 0.0, np.pi
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if at(middle)[1] > centre else (low, middle)
    steps = np.geomspace(1e-12, np.pi, 600)
    edges = np.unique(np.clip(np.concatenate([low - steps, [low], low + steps]), 0.0, np.pi))
    x, w = np.polynomial.legendre.leggauss(12)
    half = 0.5 * np.diff(edges)[:, None]
    v = 0.5 * (edges[1:] + edges[:-1])[:, None] + half * x
    g1, g2, c = at(v)
    P = 0.5 * (1.0 - 2.0 * g1 * factor * np.exp(-(10.0 ** (2 * width)) * (g2 - centre) ** 2))
    # Both halves of the loop are alike.
    return 2.0 * float(np.sum(half * w * Z / (c * np.sqrt(P)))) if P.min() > 0.0 else None


@each_once(tier=["draft", "standard"], width=list(range(1, 9)), factor=["1/100", "-1/100", "-2", "1/100000"])
def test_a_period_with_a_bump_is_right_or_left_open(tier, width, factor):
    found = solve_spectral(DOUBLE, formula(bumped(factor, width), DOUBLE), ONE, tier=tier)
    if found is not None:
        # Gauss's rule on graded pieces leaves roundings.
        assert abs(found.period.hi - period(float(Fraction(factor)), width)) <= found.period.error + 1e-13


def test_the_reference_sees_the_bump():
    assert period(0.01, 2) - period(0.0, 2) > 1e-4
    assert period(2.0, 3) is None


@each_once(tier=["draft", "standard", "high"], width=list(range(1, 9)))
def test_a_wall_is_not_walked_through(tier, width):
    found = solve_spectral(DOUBLE, formula(bumped("2", width), DOUBLE), ONE, tier=tier)
    assert found is None or "rest" in found.ends


def rates_at(loop, worked, places):
    """Return dt/du at 60 places."""
    radicands(worked, loop, places, 60)
    K = places.radicand[:60]
    if not loop.rotates:
        K = K / (places.below[:60] * places.above[:60])
    return np.pi * loop.z / (places.c[:60] * np.sqrt(K))


@pytest.mark.parametrize(
    ("rigid_body", "text", "lambda_"),
    [
        (body(2, 1), "-g1", "1"),
        (body(2, 1), "-g1 + 1/(20*g3^2)", "1"),
        (body(2, 1), bumped("1/100", 1), "1"),
        (body("17/10", 1), "(A*g1^2+C*g3^2)*(g2^2-1/2)", "4/5"),
        (body(3, 5), "(A*g1^2+C*g3^2)*(g2^2-1/2)", "4/5"),
        (body(3, 1), "(3*g1^2+g3^2)*(g2^2-1/2+g2^3/5)", "4/5"),
    ],
)
def test_the_series_departs_from_the_rate_by_no_more_than_is_proved(rigid_body, text, lambda_):
    # A V of low degree is not proved; times 1, written so that this is not seen, it is.
    potential = formula(f"({text})*(cos(g2)^2 + sin(g2)^2)", rigid_body)
    found = solve_spectral(rigid_body, potential, PlanarMotion(Fraction(lambda_)), tier="draft")
    assert found is not None
    program, constants = make_program(potential.tape)
    worked, places = new_formula(*program[:3], constants), new_records(PLACES)[0]
    draws, closest = np.random.default_rng(2), 0.0
    for panel in found.panels:
        # Next to a rest point the rounding is divided by the distance.
        x = draws.uniform(0.1, 0.95, 60) * (-1.0 if panel.last < 1.0 else 1.0)
        w = 0.5 * (panel.low * (1.0 - x) + panel.high * (1.0 + x))
        for k in range(60):
            places.below[k], places.above[k], places.sine[k], places.cosine[k], places.speed[k] = place(
                found.loop, int(panel.anchor), w[k]
            )
        rates = rates_at(found.loop, worked, places)
        half = 0.5 * (panel.high - panel.low)
        series = panel.slopes / half
        departure = np.abs(np.polynomial.chebyshev.chebval(x, series) / rates - 1.0).max()
        # Roundings of the rate itself.
        assert departure <= panel.proved * (1.0 + 1e-6) + 2e-13
        closest = max(closest, departure / panel.proved if departure > 1e-12 else 0.0)
    # The bound is no ornament: it is reached to within a factor.
    assert closest == 0.0 or closest > 1e-4
