"""Section 4 of the paper in numbers: its integrals against golden periods and the service's own."""

from collections.abc import Callable
from fractions import Fraction

import pytest
from mpmath import mp, mpf, quad

from service.dynamics.potentials.families.coefficients import rational_potential
from tests.paper.orbits import agree, ball, motion_on, orbit_states, working_precision
from tests.support.golden import GOLDEN
from tests.support.planar import body, planar
from tests.support.solving import solve_planar

DIGITS = 45

GOLDEN_OF = {golden.name: golden for golden in GOLDEN}
# By the name of the golden case: C, a1, b1, c1, ν, periods of g1 in one of the six variables.
ELLIPTIC = {
    "G1": ((1, -1, 0, 0, 1), 2),
    "G2": (("1.5", -2, 0, 0, "0.3"), 2),
    "G4": ((1, -1, "0.05", 0, 1), 2),
    "G6": ((1, -1, "0.02", "1.2", 1), 1),
}
HYPERELLIPTIC = ((-2, "1/20"), ("1/50", "-1/500"), ("1/5", "1/10"))


def between_zeros(radicand: Callable[[mpf], mpf], low: mpf, high: mpf) -> mpf:
    """Return ∫dx/√radicand between two simple zeros of it, by x = middle - reach cos θ."""
    middle, reach = (low + high) / 2, (high - low) / 2

    def integrand(angle: mpf) -> mpf:
        return reach * mp.sin(angle) / mp.sqrt(radicand(middle - reach * mp.cos(angle)))

    return quad(integrand, [0, mp.pi / 2, mp.pi], method="gauss-legendre")


@pytest.mark.parametrize(("C", "nu"), [("1", "1"), ("3/2", "4/3")])
def test_t_of_the_hyperelliptic_integral(C, nu):
    """t = λ² √(C/2) ∫dx/√g before (Vg), λ read as ν, a1, a2, b1, b2, c1, c2 ≠ 0: the service's period."""
    lists = [[Fraction(number) for number in row] for row in HYPERELLIPTIC]
    potential = rational_potential(*lists)
    found = solve_planar(planar(body(2 * Fraction(C), C), potential, motion_on(nu, nu=True)))
    period, window = found.dense.period, found.window
    assert period is not None
    assert window is not None
    assert window.ends == ("rest", "equator")
    with mp.workdps(DIGITS):
        n, moment = (mpf(k.numerator) / k.denominator for k in (Fraction(nu), Fraction(C)))
        (a1, a2), (b1, b2), (c1, c2) = [[mpf(k.numerator) / k.denominator for k in row] for row in lists]

        def g(x: mpf) -> mpf:
            inner = 2 * c2 * x**5 - 2 * (4 * a2 - c2 * n) * x**4
            inner -= 2 * (2 * a2 * n + c1 + c2) * x**3 + (a1 - a2 * n**2) * x**2
            return (1 - x**2 - n * x) / x * (n**4 * inner - 2 * (b1 * n**2 + 3 * b2) * x + 2 * b2 * n)

        low, high = (mp.findroot(g, mpf(end)) for end in window.g1)
        t = n**2 * mp.sqrt(moment / 2) * between_zeros(g, low, high)
        # A period of the six variables is four passages. Its two doubles are 1e-17 of it off at best.
        assert abs(4 * t - mpf(period.hi) - mpf(period.lo)) < 1e-15


@pytest.mark.parametrize("name", ELLIPTIC)
def test_tg_elliptic_integral(name):
    """(tg): t = √(C/2) ν ∫dx/√((x²+νx-1)(2b1 + ν²a1 x + 2ν²c1 x²)) is half the golden period of g1."""
    numbers, turns = ELLIPTIC[name]
    with mp.workdps(DIGITS):
        C, a1, b1, c1, nu = (mpf(number) for number in numbers)

        def radicand(x: mpf) -> mpf:
            return (x**2 + nu * x - 1) * (2 * b1 + nu**2 * a1 * x + 2 * nu**2 * c1 * x**2)

        low, high = _ends(a1, b1, c1, nu)
        t = mp.sqrt(C / 2) * nu * between_zeros(radicand, low, high)
        # Golden has 34 digits at least; the integrand loses a few of 45 at its ends.
        assert abs(2 * turns * t - mpf(GOLDEN_OF[name].period)) < mpf(10) ** -32


def test_tg_elliptic_integral_of_the_service():
    """(tg): half the period of the service at C = 3/2, a1 = -2, b1 = 1/30, c1 = 7/2, ν = 4/3."""
    exact = [Fraction(number) for number in ("3/2", "-2", "1/30", "7/2", "4/3")]
    C, a1, b1, c1, nu = exact
    potential = rational_potential([a1], [b1], [c1])
    found = solve_planar(planar(body(2 * C, C), potential, motion_on(nu, nu=True)))
    period, window = found.dense.period, found.window
    assert period is not None
    assert window is not None
    assert window.ends == ("rest", "rest")
    with mp.workdps(DIGITS):
        C, a1, b1, c1, nu = (mpf(k.numerator) / k.denominator for k in exact)

        def radicand(x: mpf) -> mpf:
            return (x**2 + nu * x - 1) * (2 * b1 + nu**2 * a1 * x + 2 * nu**2 * c1 * x**2)

        t = mp.sqrt(C / 2) * nu * between_zeros(radicand, *_ends(a1, b1, c1, nu))
        # The period is two doubles, 1e-17 of it off at best.
        assert abs(2 * t - mpf(period.hi) - mpf(period.lo)) < 1e-15


@pytest.mark.parametrize("t", [0, 1, 10])
def test_tg_inverted(t):
    """Text after (tg): g1 is an elliptic function of t, here rational in cn: a1 = -1, b1 = 1/20, C = ν = 1.

    x'² = (x - lo)(hi - x) k(x), tan² v = κ² (1-cn)/(1+cn), x = lo cos² v + hi sin² v, t from x = lo.
    """
    with mp.workdps(DIGITS):
        low, high = mpf(1) / 10, (mp.sqrt(5) - 1) / 2
        k_low, k_high = 2 * (low + 1 / high), 2 * (high + 1 / high)
        total = 2 * (low + high) + 4 / high  # S = 2 k_2 lo hi + k_1 (lo + hi) + 2 k_0
        rate = mp.sqrt(mp.sqrt(k_low * k_high))
        m = mpf(1) / 2 - total / (4 * rate**2)
        assert abs(4 * mp.ellipk(m) / rate - mpf(GOLDEN_OF["G4"].period) / 2) < mpf(10) ** -38
        # Golden time starts at x = hi, half a period of g1 later.
        cn = mp.ellipfun("cn", rate * t + 2 * mp.ellipk(m), m=m)
        cosine, sine = 1 + cn, mp.sqrt(k_low / k_high) * (1 - cn)  # squares, up to one factor
        golden = mpf(GOLDEN_OF["G4"].states[t][2])
        assert abs((low * cosine + high * sine) / (cosine + sine) - golden) < mpf(10) ** -33


@pytest.mark.parametrize("nu", ["4/3", "-4/3"])
def test_solution_of_Vg(nu):
    """Display before (tg): squares of g3, g2, p, r as printed (x in g2 is g1), along the service's motions.

    g3² = ν g1, g2² = 1 - ν g1 - g1², p² = -P/(2Cν g1), r² = -2P/(Cν²), P = 2b1 + a1ν²g1 + 2c1ν²g1².
    """
    slope = "2" if nu.startswith("-") else "-2"
    text = f"{slope}*g1 + 1/30/g3^2 + 7/5*(g1^2 - g2^2)"
    with working_precision():
        a1, b1, c1, C, number = (ball(k) for k in (slope, "1/30", "7/5", "3/2", nu))
        for at in orbit_states((3, "3/2"), text, motion_on(nu, nu=True)):
            P = 2 * b1 + a1 * number**2 * at.g1 + 2 * c1 * number**2 * at.g1**2
            assert agree(at.g3**2, number * at.g1)
            assert agree(at.g2**2, 1 - number * at.g1 - at.g1**2)
            assert agree(at.p**2, -P / (2 * C * number * at.g1))
            assert agree(at.r**2, -2 * P / (C * number**2))


def test_solution_of_Vg_signs():
    """Display before (tg): the printed signs (g2, g3, r > 0 > p) do not stay: all four change on one motion.

    p and r at rest points, g2 at the equator, g3 at the poles (b1 = 0).
    """
    resting = orbit_states((2, 1), "-g1 + 1/(20*g3^2)", motion_on(1))
    passing = orbit_states((2, 1), "-g1", motion_on(1))
    assert {bool(at.p > 0) for at in resting} == {bool(at.r > 0) for at in resting} == {True, False}
    assert {bool(at.g2 > 0) for at in resting} == {bool(at.g3 > 0) for at in passing} == {True, False}


def _ends(a1: mpf, b1: mpf, c1: mpf, nu: mpf) -> tuple[mpf, mpf]:
    """Return the smallest and largest g1 of the motion: 0 or the zeros of 2b1 + ν²a1 x + 2ν²c1 x²."""
    if c1 == 0:
        return -2 * b1 / (nu**2 * a1), 2 / (nu + mp.sqrt(nu**2 + 4))
    root = mp.sqrt(nu**2 * a1**2 - 16 * b1 * c1)
    low, high = ((-nu * a1 + sign * root) / (4 * nu * c1) for sign in (-1, 1))
    return low, high
