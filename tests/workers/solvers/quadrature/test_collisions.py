"""Motions that end where p² is infinite on the sphere: their times against independent quadratures."""

from dataclasses import replace
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from service.dynamics.problem import PlanarMotion, StartAtEquator, StartAtPoint
from service.dynamics.verdict.simple_form import simplified
from tests.support.euler_poisson import rates_of
from tests.support.planar import body, formula, planar
from tests.support.solving import solve_planar
from workers.solvers.quadrature.family import MotionEndedError

DOUBLE = body(2, 1, "3/2")
Q = "(2*g1^2+g3^2)"
TRUTH = "0.3640004182936566138400526"
"""Time for V = −g1 − Q/20/(1/2 − g2), from the equator: by a Taylor series at 300 bits."""


def time_to(G, c, *, moves: bool, since=0, power: int = 2):
    r"""Return :math:`\int dg_2/(Q s)` from g2 = ``since`` to c, s² = 2 (h − V)/(A C Q), on g3² = g1.

    G is a function of c − g2 and g2. With c − g2 = u^power, p² ~ (c − g2)^−k leaves u^(power (1 + k/2) − 1),
    smooth enough for 30 digits. Beside Q G there is −g1 where it ``moves``, with h = 1/2.
    """
    with mpmath.workdps(40):
        c = mpmath.mpf(c)

        def rate(u):
            away = u**power
            y = c - away
            x = (mpmath.sqrt(5 - 4 * y * y) - 1) / 2
            q = 2 * x * x + x
            h_minus_v = (mpmath.mpf(1) / 2 + x if moves else 0) - q * G(away, y)
            return power * u ** (power - 1) / (q * mpmath.sqrt(h_minus_v / q))

        reach = (c - since) ** (mpmath.mpf(1) / power)
        return mpmath.quad(rate, mpmath.linspace(0, reach, 5))


def solve(text, times, window, **options):
    motion = PlanarMotion(Fraction(1), window=window, start=StartAtEquator(-1))
    problem = planar(DOUBLE, text, motion, times, **options)
    return solve_planar(replace(problem, potential=simplified(problem.potential)))


def test_the_quadrature_of_this_test_has_the_known_time():
    time = time_to(lambda away, _: -1 / (20 * away), "0.5", moves=True)
    with mpmath.workdps(40):
        # All its digits.
        assert abs(time - mpmath.mpf(TRUTH)) < 1e-25


CASES = {
    "order 1": (f"-g1-{Q}/20/(1/2-g2)", 1, "0.5", lambda away, _: -1 / (20 * away), True, 2),
    "order 2": (f"-g1-{Q}/20/(1/2-g2)^2", 1, "0.5", lambda away, _: -1 / (20 * away**2), True, 2),
    "order 3": (f"-g1-{Q}/20/(1/2-g2)^3", 1, "0.5", lambda away, _: -1 / (20 * away**3), True, 2),
    "order 1/3": (
        f"-g1-{Q}/20/(1/2-g2)^(1/3)",
        0,
        "0.5",
        lambda away, _: -1 / (20 * mpmath.cbrt(away)),
        True,
        6,
    ),
    "weak": (f"-g1-{Q}*1e-9/(1/2-g2)", 1, "0.5", lambda away, _: -mpmath.mpf("1e-9") / away, True, 2),
    "F constant": (f"-{Q}/(1/2-g2)", 0, "0.5", lambda away, _: -1 / away, False, 2),
    "tan": (f"-g1-{Q}*tan(2*g2)/10", 2, None, lambda away, _: -mpmath.cot(2 * away) / 10, True, 2),
    "1 - cos": (
        f"-g1-{Q}/50/(1-cos(g2-1/2))",
        1,
        "0.5",
        lambda away, _: -1 / (100 * mpmath.sin(away / 2) ** 2),
        True,
        2,
    ),
    "next to a pole": (
        f"-g1-{Q}/20/(9999/10000-g2)",
        1,
        "0.9999",
        lambda away, _: -1 / (20 * away),
        True,
        2,
    ),
}


@pytest.mark.one_in(3)
@pytest.mark.parametrize(("text", "window", "c", "G", "moves", "power"), CASES.values(), ids=CASES)
def test_the_time_of_a_collision_is_that_of_another_quadrature(text, window, c, G, moves, power):
    with mpmath.workdps(40):
        expected = time_to(G, mpmath.pi / 4 if c is None else c, moves=moves, power=power)
    motion = solve(text, (0, "1/20"), window)
    assert motion.aperiodic == "collision"
    end = motion.future
    assert (end.kind, end.rate) == ("collision", None)
    # The claim holds, and is a few roundings of the whole time, which is less than 6.
    assert abs(mpmath.mpf(end.time.value) - expected) <= end.time.error <= 1e-14
    assert end.gamma[1] == pytest.approx(float(mpmath.pi / 4 if c is None else mpmath.mpf(c)), abs=1e-15)


def test_a_logarithm_ends_in_finite_time_too():
    """p² ~ −log(c − g2) is infinite at c, where the equations have no further solution."""
    motion = solve(f"-g1+{Q}*log(abs(g2-1/2))/20", (0, "1/10"), 1)

    with mpmath.workdps(30):
        # Double exponential quadrature does not mind the end.
        expected = time_to(lambda away, _: mpmath.log(away) / 20, "0.5", moves=True, power=1)
    assert abs(mpmath.mpf(motion.future.time.value) - expected) <= motion.future.time.error + mpmath.mpf(
        "1e-18"
    )


@pytest.mark.parametrize(("s_sign", "ends"), [(1, ("past", "future")), (-1, ("future", "past"))])
def test_the_way_round_both_poles_takes_the_time_that_is_left(s_sign, ends):
    """Towards s > 0 it passes the south pole and comes to the mirror image of the same place."""
    motion = PlanarMotion(Fraction(1), window=1, start=StartAtEquator(s_sign))
    found = solve_planar(planar(DOUBLE, f"-g1-{Q}/20/(1/2-g2)", motion, (0, "1/10")))
    near, far = (getattr(found, end) for end in ends)
    assert abs(near.time.value) == pytest.approx(float(TRUTH), abs=1e-15)
    # (0.5, 0.5, ±√(1/2)) is where g3² = g1 meets g2 = 1/2.
    assert near.gamma == pytest.approx((0.5, 0.5, np.sqrt(0.5)), abs=1e-15)
    assert far.gamma == pytest.approx((0.5, 0.5, -np.sqrt(0.5)), abs=1e-15)


def test_samples_shortly_before_a_collision_obey_the_equations():
    text = f"-g1-{Q}/20/(1/2-g2)"
    step = Fraction(1, 10**6)
    times = [Fraction(7, 20) + k * step for k in (-1, 0, 1)]
    motion = solve(text, tuple(times), 1)
    before, here, after = motion.samples
    slope = (after - before) / (2 * float(step))
    potential = formula(text, DOUBLE)
    rates = rates_of((2.0, 1.5, 1.0), potential.gradient_at)(0.0, here)
    # Central differences: third derivatives, some 1e6 there, times the step's square, and roundings over it.
    assert np.abs(slope - rates).max() < 1e-5


def test_times_beyond_a_collision_are_left_out_and_refused_if_there_are_no_others():
    text = f"-g1-{Q}/20/(1/2-g2)"
    assert list(solve(text, (0, "1/4", 1), 1).times) == [0.0, 0.25]
    with pytest.raises(MotionEndedError, match=r"until t = 0\.36400041829365"):
        solve(text, ("2/5", 1), 1)


def test_between_two_collisions_there_is_a_motion_from_one_to_the_other():
    text = f"-g1-{Q}/20/((1/2-g2)*(g2+1/3))"
    found = solve(text, (0, "1/10"), 2)

    third = mpmath.mpf(1) / 3
    with mpmath.workdps(40):
        up = time_to(lambda away, y: -1 / (20 * away * (y + third)), "0.5", moves=True)
        # The same from the other end, with g2 turned round.
        down = time_to(lambda away, y: -1 / (20 * (mpmath.mpf(1) / 2 + y) * away), third, moves=True)
    assert abs(mpmath.mpf(found.future.time.value) - up) <= found.future.time.error
    assert abs(mpmath.mpf(found.past.time.value) + down) <= found.past.time.error


def test_a_start_at_a_point_of_such_a_window():
    text = f"-g1-{Q}/20/g2^2"
    motion = PlanarMotion(Fraction(1), start=StartAtPoint(Fraction(1, 2), g2_sign=1, s_sign=1))
    found = solve_planar(planar(DOUBLE, text, motion, (0, "1/10")))
    assert (found.aperiodic, found.future.kind, found.future.gamma[1]) == ("collision", "collision", 0.0)
