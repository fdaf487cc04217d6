"""Verdicts, multipliers and trusted times from given monodromies; and what is refused."""

import numpy as np
import pytest
from flint import ctx
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.errors import MissingMomentError
from service.dynamics.solution.dense_output import Period
from tests.workers.solvers.stability.cases import Case, bobylev_steklov, case, lambda_, nu
from workers.solvers.errors import PrecisionLostError
from workers.solvers.orbits.orbit import make_orbit
from workers.solvers.quadrature.errors import QuadratureNotConvergedError
from workers.solvers.stability import assessment
from workers.solvers.stability import monodromy as turns
from workers.solvers.stability.assessment import (
    MAX_PERIODS,
    UNIT_ROUNDOFF,
    hill_monodromy,
    power_norms,
    rotating_norms,
    trusted_time,
)
from workers.solvers.stability.monodromy import Monodromy, StabilityUndefinedError

PERIOD = Period(2.0 * np.pi, 0.0, 0.0)
"""T = 2π: frequency 1."""


def monodromy(*entries: float) -> Monodromy:
    return Monodromy(np.array(entries).reshape(2, 2), error=0.0, excursion=1.0, nodes=0)


@given(st.floats(-3.0, 3.0), st.floats(-2.0, 2.0), st.floats(0.1, 3.0))
def test_norms_of_powers(a, b, c):
    # det = a d − b c = 1 with d chosen, or a shear.
    M = np.array([[a, b], [c, (1.0 + b * c) / a]]) if abs(a) > 0.1 else np.array([[1.0, b], [0.0, 1.0]])
    norms = power_norms(M, 6)
    expected = [np.linalg.norm(np.linalg.matrix_power(M, k)) for k in range(7)]
    # A rounding of every factor; near trace 2 the angle is known to the root of one only.
    scale = np.linalg.norm(M) ** np.arange(7) + 7.0
    assert np.all(np.abs(norms - expected[: len(norms)]) <= 1e-12 * scale[: len(norms)])


def test_trusted_time_of_an_unstable_motion_is_logarithmic():
    M = monodromy(4.0, 0.0, 0.0, 0.25)
    times = [trusted_time(M, 1.0, PERIOD, tolerance) for tolerance in (1e-9, 1e-9 * 4.0**5)]
    # Five periods for five factors of mu = 4; the other multiplier's share of the sum is 1e-7.
    assert times[1] - times[0] == pytest.approx(5.0 * PERIOD.hi, rel=1e-6)
    # ln(tolerance/u)/exponent itself, but for the sum of the roundings of all periods, 4/3 and √2.
    alone = np.log(1e-9 / UNIT_ROUNDOFF) / (np.log(4.0) / PERIOD.hi)
    assert alone - 0.3 * PERIOD.hi <= times[0] <= alone


def test_trusted_time_of_a_rotation_is_proportional():
    M = monodromy(0.6, 0.8, -0.8, 0.6)
    # Every period adds one rounding of norm √2.
    assert trusted_time(M, 1.0, PERIOD, 1e5 * np.sqrt(2.0) * UNIT_ROUNDOFF) == pytest.approx(
        (1e5 - 1.0) * PERIOD.hi
    )
    assert trusted_time(M, 1.0, PERIOD, 2.0 * MAX_PERIODS * UNIT_ROUNDOFF) is None
    assert trusted_time(M, 1.0, PERIOD, UNIT_ROUNDOFF) == 0.0


def test_trusted_time_of_a_shear_grows_like_the_root():
    M = monodromy(1.0, 3.0, 0.0, 1.0)
    one, two = (trusted_time(M, 1.0, PERIOD, 3.0 * n**2 / 2.0 * UNIT_ROUNDOFF) for n in (1e3, 2e3))
    # Sum of 3 k for k <= n; what is left out is of order 1/n.
    assert one == pytest.approx(1e3 * PERIOD.hi, rel=2e-3)
    assert two == pytest.approx(2.0 * one, rel=2e-3)


def test_faster_motions_and_smaller_roundings():
    M = monodromy(4.0, 0.0, 0.0, 0.25)
    plain = trusted_time(M, 1.0, PERIOD, 1e-8)
    # A rounding of a speed four times as large costs one period; one four times as small gains it.
    assert trusted_time(M, 4.0, PERIOD, 1e-8) == pytest.approx(plain - PERIOD.hi, rel=1e-6)
    gained = trusted_time(M, 1.0, PERIOD, 1e-8, UNIT_ROUNDOFF / 4.0)
    assert gained == pytest.approx(plain + PERIOD.hi, rel=1e-6)


@pytest.mark.parametrize("B", ["1/2", "1", "2", "3", "4"])
def test_multipliers_solve_their_equation(B):
    stability = bobylev_steklov(2, B).assess()
    one, other = stability.multipliers
    # Roundings of numbers of size trace.
    assert abs(one + other - stability.trace) <= 4e-16 * max(2.0, abs(stability.trace))
    assert abs(one * other - 1.0) <= 4e-16
    assert abs(one) >= abs(other)
    assert stability.exponent == pytest.approx(
        max(0.0, np.log(abs(one))) / bobylev_steklov(2, B).period.hi, abs=1e-15 + stability.exponent_error
    )


def test_the_moment_B_is_needed():
    missing = case(2, None, 1, "-g1", nu(1))
    for needed in (missing.assess, missing.jacobian):
        with pytest.raises(MissingMomentError, match="stability needs the moment B"):
            needed()


def test_an_undefined_stability_says_so_with_its_place():
    with pytest.raises(StabilityUndefinedError) as caught:
        case(3, 2, 1, "-abs(g1)^(4/3)", lambda_(1)).assess()
    assert (caught.value.code, caught.value.pointer) == ("stability_undefined", "/outputs")


def test_too_few_bits_are_noticed():
    found = bobylev_steklov(1, 2)
    with ctx.workprec(56), pytest.raises(PrecisionLostError):
        hill_monodromy(found.body, found.potential, make_orbit(found.start), found.period)


def test_more_panels_than_allowed(monkeypatch):
    monkeypatch.setattr(turns, "MAX_PANELS", 3)
    with pytest.raises(QuadratureNotConvergedError, match="3 panels"):
        bobylev_steklov(1, 2).hill()


def test_next_to_a_separatrix_panels_follow_the_motion():
    # c1 = (1 + √5)/4 is a separatrix; 1e-8 beside it the motion rests for most of 41 time units.
    found: Case = case(2, "3/2", 1, "-g1 + 809017/1000000*(g1^2 - g2^2)", nu(1))
    hill = found.hill()
    assert found.period.hi > 40.0
    # Roundings of some fifty panels.
    assert hill.error <= 5e-12
    assert abs(np.linalg.det(hill.matrix) - 1.0) <= hill.error


@pytest.mark.one_in(4)
@pytest.mark.parametrize("trace", [0.3, -1.9999, 2.0, 2.0 + 1e-7, 5.0])
@pytest.mark.parametrize("tolerance", [1e-15, 1e-11, 1e-9, 1e-4])
def test_trusted_time_is_the_same_however_many_periods_are_looked_at_together(trace, tolerance, monkeypatch):
    M = monodromy(trace, -1.0, 1.0, 0.0)
    in_parts = trusted_time(M, 1.0, PERIOD, tolerance)
    monkeypatch.setattr(assessment, "PERIODS_TOGETHER", MAX_PERIODS + 1)
    # Roundings of sums of a million norms, in another order where harmonics were summed.
    assert trusted_time(M, 1.0, PERIOD, tolerance) == (
        in_parts if in_parts is None else pytest.approx(in_parts, rel=1e-11)
    )


@given(st.floats(-1.999, 1.999), st.floats(0.01, 100.0), st.integers(0, 3000))
@settings(deadline=None)
def test_sums_of_norms_by_harmonics(trace, stretch, last):
    """Against the norms themselves; harmonics are there unless the powers are all but those of a shear."""
    phi = np.arccos(0.5 * trace)
    turn = np.array([[np.cos(phi), stretch * np.sin(phi)], [-np.sin(phi) / stretch, np.cos(phi)]])
    rotating = rotating_norms(turn)
    assert rotating is not None
    norms = power_norms(turn, last)
    # Harmonics leave out 1e-14 of a norm each; angles of 3000 powers are known to 1e-12.
    assert rotating.total(last) == pytest.approx(norms.sum(), rel=1e-10)
    goal = 0.5 * (norms[:-1].sum() + norms.sum())
    found = rotating.reach(goal, 0)
    assert found is None or found[0] == last
    assert norms.max() <= rotating.largest * (1.0 + 1e-12)


@pytest.mark.parametrize("trace", [2.0, -2.0, 5.0])
def test_no_harmonics_unless_all_powers_are_bounded(trace):
    assert rotating_norms(monodromy(trace, -1.0, 1.0, 0.0).matrix) is None
