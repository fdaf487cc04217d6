"""Bounds that a bit of the phase, or of luck, had made too small: against certified motions."""

from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx

from service.dynamics.problem import PlanarMotion, StartAtPoint, StartAtRest
from tests.support.planar import body, formula
from workers.solvers.choose import enclose
from workers.solvers.compiled.solve import solve_spectral

TERMS = "a*g1 + b/g3^2 + c*(g1^2-g2^2)"
MIRRORED = "a*g3 + b/g1^2 + c*(g3^2-g2^2)"
TINY = Fraction(1, 10**8)


def zeros(first: Fraction, second: Fraction, c: Fraction) -> dict[str, Fraction]:
    """Coefficients on nu = 1 that make the radicand vanish at |g1| (mirrored |g3|) = first and second."""
    return {"a": -2 * c * (first + second), "b": c * first * second, "c": c}


# nu = 1: the equator is at x = (√5 − 1)/2 = 0.6180339887498948482…
EQUATOR = Fraction("0.61803398874989484820458683436563811772")
HALF = Fraction(1, 2)
CASES = {
    # A second zero just below the one where the motion rests: it is slow there, and starts there.
    "next to rest, mirrored": (
        body(1, 2),
        formula(MIRRORED, body(1, 2), zeros(HALF * (1 - TINY), HALF, -HALF)),
        PlanarMotion(
            Fraction(1),
            window=1,
            g3_sign=1,
            start=StartAtPoint(Fraction("0.7071067813"), g2_sign=-1, s_sign=1),
        ),
    ),
    # The zero beyond the equator is next to it: the motion is slow there, and starts near it.
    "next to the equator": (
        body(2, 1),
        formula(TERMS, body(2, 1), zeros(Fraction(1, 10), EQUATOR * (1 + TINY), HALF)),
        PlanarMotion(None, nu=Fraction(1), start=StartAtPoint(Fraction("0.618033"), g2_sign=-1, s_sign=1)),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_the_rounding_of_a_start_next_to_a_separatrix_is_in_the_claim(name):
    rigid_body, potential, motion = CASES[name]
    found = solve_spectral(rigid_body, potential, motion, tier="high")
    assert found is not None
    times = np.linspace(-1.0, 1.0, 41) * found.period.hi
    states = enclose(rigid_body, potential, motion, [Fraction(t) for t in times.tolist()], 128).states
    exact = np.array([[float(value) for value in state] for state in states])
    # The rounding of the reference to doubles is within the claim's own.
    assert np.abs(found.sample(times) - exact).max() <= found.error_at(times) <= 1e-11


@pytest.mark.parametrize("g1", ["0.618033", "0.6180339887", "0.6180339887498"])
@pytest.mark.parametrize("tier", ["draft", "standard"])
def test_the_rounding_of_g1_at_a_start_next_to_the_equator_is_in_the_claim(tier, g1):
    rigid_body = body(2, 1)
    potential = formula(TERMS, rigid_body, zeros(Fraction(1, 10), EQUATOR * Fraction(101, 100), HALF))
    motion = PlanarMotion(None, nu=Fraction(1), start=StartAtPoint(Fraction(g1), g2_sign=-1))
    found = solve_spectral(rigid_body, potential, motion, tier=tier)
    assert found is not None
    times = np.linspace(-1.0, 1.0, 21) * found.period.hi
    states = enclose(rigid_body, potential, motion, [Fraction(t) for t in times.tolist()], 128).states
    exact = np.array([[float(value) for value in state] for state in states])
    assert np.abs(found.sample(times) - exact).max() <= found.error_at(times) <= 1e-6


@pytest.mark.parametrize(("first", "width"), [("0.45", "0.002"), ("0.45", "0.0002"), ("0.3", "0.02")])
def test_the_period_of_a_small_libration_is_not_taken_for_more_exact_than_it_is(first, width):
    """Its integrand hardly varies: the mean's first change is small, and the next is not its square."""
    rigid_body, low = body(2, 1), Fraction(first)
    potential = formula(TERMS, rigid_body, zeros(low, low + Fraction(width), HALF))
    motion = PlanarMotion(None, nu=Fraction(1))
    found = solve_spectral(rigid_body, potential, motion, tier="high")
    assert found is not None
    with ctx.workprec(400):
        exact = enclose(rigid_body, potential, motion, [], 256).period
        assert abs(exact - arb(found.period.hi) - arb(found.period.lo)) <= found.period.error
    # Good for 1e8 periods, to the last digit.
    assert found.period.error <= 1e-24 * found.period.hi


def test_an_end_next_to_a_pole_is_off_by_more_than_its_formula_is_rounded():
    """There v is nearly π, and its double is off by 2e-16; sin v = 0.007 is not told as well."""
    rigid_body, motion = body(2, 1), PlanarMotion(None, nu=Fraction(1))
    potential = formula("g1/10000 - (g1^2-g2^2)", rigid_body)
    period = enclose(rigid_body, potential, motion, [], 128).period
    for tier in ("draft", "standard"):
        found = solve_spectral(rigid_body, potential, motion, tier=tier)
        assert found is not None
        # The claim of standard was 2.4e-12, the error is 2.6e-12.
        assert abs(arb(found.period.hi) - period) <= found.period.error < 1e-9


def test_a_start_at_an_end_is_exact():
    """Turning back 200 times as fast as it goes, a motion would be off by as much as its start is late."""
    rigid_body = body(2, 1)
    potential = formula("-g1 + 1/(4000*g3^2)", rigid_body)
    for start in (StartAtRest(1), StartAtRest(-1)):
        motion = PlanarMotion(Fraction(2), start=start)
        found = solve_spectral(rigid_body, potential, motion, tier="high")
        assert found is not None
        loop, period = found.loop, found.period
        assert not loop.by_roots
        assert found.bounds.speed > 100.0
        # One end is where times begin, up to sines of twice the digits; the other is half a period later.
        late = period.hi / 2 if loop.start == 1.0 else 0.0
        rest = period.lo / 2 if loop.start == 1.0 else 0.0
        assert abs((loop.origin - late) + (loop.origin_lo - rest)) <= 2.0**-100 * period.hi
        times = np.concatenate([[0.0], 0.5 + np.linspace(-1e-3, 1e-3, 21)]) * period.hi
        states = enclose(rigid_body, potential, motion, [Fraction(t) for t in times.tolist()], 128).states
        exact = np.array([[float(value) for value in state] for state in states])
        assert np.abs(found.sample(times) - exact).max() <= found.error_at(times)
