"""Motions that never close: collisions, separatrices, equilibria, ends at a pole."""

from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.problem import PlanarMotion, StartAtPoint, TimePeriods, TimeSpan
from service.dynamics.reduction.window import LeavesDomainError, StartNeededError
from service.dynamics.sampling import PeriodNeededError
from tests.support.planar import body, formula, planar
from tests.support.solving import solve_planar
from workers.solvers.integration.solve import integrate_state
from workers.solvers.quadrature.family import MotionEndedError

DOUBLE = body(2, 1, "3/2")
NU_1 = PlanarMotion(None, Fraction(1))
SEPARATRIX = "-g1 + (1+sqrt(5))/4*(g1^2-g2^2)"
"""p² = nu x (1 − x/x1)/2, x = g1, x1 the equator: a double zero of the loop's radicand there."""
INNER_SEPARATRIX = "g1 - (g1^2-g2^2) - 1/(16*g3^2)"
"""N(x) has the double root 1/4, between a collision and an oscillation."""


def solve(text, times, motion=NU_1, **options):
    return solve_planar(planar(DOUBLE, text, motion, times, **options))


def from_point(g1, **options):
    return PlanarMotion(None, Fraction(1), start=StartAtPoint(Fraction(g1)), **options)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("strength", "expected"),
    [("1/20", "1.06647559407919763218981408942"), ("1/5", "0.82119911108083424708898369890624")],
    ids=["real roots", "complex roots"],
)
def test_the_time_of_a_collision_is_the_golden_one(strength, expected):
    motion = solve(f"-g1 - 1/2*(g1^2-g2^2) - {strength}/g3^2", ("0", "1/2", 2))
    assert motion.aperiodic == "collision"
    for side, end in ((-1, motion.past), (1, motion.future)):
        assert end.kind == "collision"
        assert end.gamma == (0.0, -side, 0.0)  # s > 0 goes south
        # The claim holds, and is a few roundings of the time.
        assert abs(end.time.value - side * float(expected)) <= end.time.error <= 4e-15
    assert list(motion.times) == [0.0, 0.5]


def test_times_after_a_collision_only_are_refused_with_its_time():
    with pytest.raises(MotionEndedError, match=r"until t = 1\.0664755940792"):
        solve("-g1 - 1/2*(g1^2-g2^2) - 1/20/g3^2", (2, 3))


def test_a_pole_approached_for_ever_has_its_closed_form():
    # 1/x obeys y'² = 4 (y² − nu y − 1): x = 1/(1/2 + √(5/4) cosh 2t) for nu = C = 1.
    motion = solve("-(g1^2-g2^2)", (0, 1, -3, 10, 40, 1000))
    expected = 1.0 / (0.5 + np.sqrt(1.25) * np.cosh(np.minimum(2.0 * motion.times, 700.0)))
    assert motion.aperiodic == "pole"
    # Rounding of t, a few ulp of a span of 100, moves x by 1e-14 where it moves most.
    assert np.abs(motion.samples[:, 3] - expected).max() <= min(motion.error, 1e-13)
    assert motion.future.gamma == (0.0, -1.0, 0.0)
    # g3 = √x dies out like exp(−t).
    assert abs(motion.future.rate.value - 1.0) <= motion.future.rate.error <= 1e-15


def test_a_separatrix_ends_at_its_equilibrium():
    motion = solve(SEPARATRIX, (0, 1, 20, 300, -300), from_point("1/10"))
    x1 = (np.sqrt(5.0) - 1.0) / 2.0
    assert (motion.aperiodic, motion.future.kind, motion.future.time) == ("separatrix", "equilibrium", None)
    for end, row in ((motion.future, motion.samples[3]), (motion.past, motion.samples[4])):
        # Ends are rounded to doubles; at t = 300 exp(-300) is left of the way.
        assert np.abs(row - [0, 0, 0, *end.gamma]).max() <= 1e-15
        assert abs(abs(end.gamma[2]) - np.sqrt(x1)) <= 2e-16
        # x'² = (2/x1) x (x1 − x)² (x + 1/x1), nu = C = 1: x1 − x dies out with the rate √(2 (x1 + 1/x1)),
        # and it is of second order in the distance along the circle.
        assert abs(end.rate.value - np.sqrt(2.0 * (x1 + 1.0 / x1)) / 2.0) <= end.rate.error + 4e-16


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("text", "start", "times"),
    [
        (SEPARATRIX, from_point("1/10"), (1, -1, 5)),
        (INNER_SEPARATRIX, from_point("1/10", window=0), (1, 5, "-1/4")),
        (INNER_SEPARATRIX, PlanarMotion(None, Fraction(1), window=1), (1, 5, -5)),
        ("-g1 - 1/2*(g1^2-g2^2) - 1/20/g3^2", NU_1, (1, "1/2", "-1/2")),
        ("-(g1^2-g2^2)", NU_1, (1, 3, -3)),
    ],
    ids=["separatrix", "equilibrium to collision", "homoclinic", "collision", "pole"],
)
def test_integration_agrees(text, start, times):
    motion = solve(text, times, start)
    omega, gamma = np.split(motion.dense(np.zeros(1))[0], 2)
    witness = integrate_state(
        DOUBLE, formula(text, DOUBLE), list(omega), list(gamma), motion.times, tolerance=1e-7
    )
    # The equilibria are unstable: the integration knows its own error, and is good to 1e-9 here.
    gap = np.abs(witness.samples - motion.samples).max()
    assert gap <= witness.error + motion.error
    assert gap <= 1e-9


def test_a_body_with_the_smaller_first_moment_collides_at_the_same_time():
    # (A, C; g1, g3; p, r) → (C, A; g3, g1; −r, −p); λ → λ^(−A/C).
    text = "-g3 - 1/2*(g3^2-g2^2) - 1/20/g1^2"
    mirrored = solve_planar(planar(body(1, 2), text, PlanarMotion(Fraction(1)), (0, "1/2")))
    motion = solve("-g1 - 1/2*(g1^2-g2^2) - 1/20/g3^2", (0, "1/2"))
    assert abs(mirrored.future.time.value - motion.future.time.value) <= 2 * motion.future.time.error
    p, q, r, g1, g2, g3 = motion.samples.T
    expected = np.array([-r, q, -p, g3, g2, g1]).T
    assert np.abs(mirrored.samples - expected).max() <= mirrored.error + motion.error


def test_an_equilibrium_stays():
    motion = solve("-g1 + 1/(20*g3^2) + 5/4*(g1^2-g2^2)", (0, 1, 1000))
    assert (motion.aperiodic, motion.window.kind) == ("equilibrium", "equilibrium")
    # The double root is x = 1/5: g1 = 1/5, g3² = x.
    expected = [0, 0, 0, 0.2, np.sqrt(1 - 0.04 - 0.2), np.sqrt(0.2)]
    assert np.abs(motion.samples - expected).max() <= motion.error <= 1e-15


def test_periods_of_a_motion_that_has_none_are_refused():
    with pytest.raises(PeriodNeededError):
        solve(INNER_SEPARATRIX, TimePeriods(Fraction(1), 11), PlanarMotion(None, Fraction(1), window=1))


def test_a_separatrix_between_equilibria_needs_a_start():
    with pytest.raises(StartNeededError, match=r"between 0 and 0\.618034"):
        solve(SEPARATRIX, (0, 1))


def test_the_energy_is_kept_to_the_end():
    motion = solve(SEPARATRIX, TimeSpan(Fraction(-60), Fraction(60), 301), from_point("1/10"))
    p, _, r, g1, g2, _ = motion.samples.T
    h = p**2 + r**2 / 2 - g1 + (1 + np.sqrt(5)) / 4 * (g1**2 - g2**2)
    # Sums of five numbers of size 1, each with the claimed error.
    assert np.abs(h - motion.energy.value).max() <= 5 * motion.error + 2e-15


def test_the_edge_of_the_domain_ends_the_search_not_in_silence():
    with pytest.raises(LeavesDomainError, match=r"g2 between -0\.5 and 1"):
        solve_planar(planar(body(3, 1), "(3*g1^2+g3^2)*(sqrt(g2+1/2)-2)", PlanarMotion(Fraction(1))))
