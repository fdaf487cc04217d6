"""Zeros of p² of high order are ends that are approached for ever; those of no order are met by name."""

import math
import random
from fractions import Fraction
from math import factorial

import pytest

from service.dynamics.body import RigidBody
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.root_finding.gap import SeparatrixUndecidedError
from service.dynamics.reduction.window import FlatZeroError, StandstillError, Window, require_known_ends
from service.dynamics.reduction.windows import find_windows
from tests.support.effort import each_once, one_in
from tests.support.planar import body, formula

RIGID_BODY = body(2, 1)
MOTION = PlanarMotion(1, g3_sign=1)
DRAWS = random.Random(41)
PLACES = {"sin(1/3)": math.sin(1 / 3), "-log(3/2)": -math.log(1.5), "-exp(-2)": -math.exp(-2)}


def windows(factor: str, rigid_body: RigidBody = RIGID_BODY) -> tuple[Window, ...]:
    """Return the windows where p² is (2 g1² + g3²)'s share of ``factor``, a function of g2."""
    return find_windows(rigid_body, formula(f"-(2*g1^2+g3^2)*({factor})", rigid_body), MOTION)


def place() -> float:
    return DRAWS.choice((-1, 1)) * DRAWS.randrange(5, 90) / 100


def ends(found: tuple[Window, ...]) -> list[tuple[float, float]]:
    return sorted(window.g2 for window in found)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("order", [2, 3, 4, 8])
def test_zero_of_high_order_is_an_equilibrium_between_two_windows(order):
    """About c both sides move where the order is even, and one where it is odd; nothing goes across."""
    c = place()
    found = windows(f"(g2-({c}))^{order}")
    allowed = [(-1.0, c), (c, 1.0)] if order % 2 == 0 else [(c, 1.0)]
    assert ends(found) == [pytest.approx(expected, abs=1e-12) for expected in allowed]
    assert all(window.kind == "separatrix" for window in found)
    for window in found:
        require_known_ends(window)


def remainder(function: str, order: int, x: str) -> str:
    """Return a function less its Taylor polynomial: a zero of this order at x = 0, and none near it."""
    terms = {
        "exp": lambda k: Fraction(1, factorial(k)),
        "sin": lambda k: Fraction((-1) ** (k // 2) * (k % 2), factorial(k)),
        "cos": lambda k: Fraction((-1) ** (k // 2) * (1 - k % 2), factorial(k)),
        "log": lambda k: Fraction((-1) ** (k + 1), k) if k else Fraction(0),
    }[function]
    argument = f"1+({x})" if function == "log" else x
    return f"{function}({argument})" + "".join(f"-({terms(k)})*({x})^{k}" for k in range(order))


@pytest.mark.parametrize(
    ("function", "order", "sign", "c"),
    one_in(
        4,
        [
            ("sin", 3, 1, "0"),
            ("sin", 3, -1, "1/2"),
            ("exp", 3, -1, "-3/10"),
            ("log", 3, -1, "-3/10"),
            ("cos", 4, -1, "0"),
            ("cos", 4, 1, "1/2"),
            ("exp", 5, 1, "1/2"),
            ("exp", 6, 1, "-3/10"),
            ("sin", 7, -1, "0"),
            # No algebraic number: the place is where a part of the formula vanishes.
            ("exp", 3, -1, "sin(1/3)"),
            ("exp", 4, 1, "sin(1/3)"),
            ("sin", 5, -1, "-log(3/2)"),
            ("log", 3, -1, "-exp(-2)"),
        ],
    ),
)
def test_zero_of_high_order_of_a_function_is_a_separatrix(function, order, sign, c):
    """What cancels leaves no sign to bounds of any of the first derivatives, from far away on."""
    found = windows(f"({sign})*({remainder(function, order, f'g2-({c})')})")
    at = PLACES[c] if c in PLACES else float(Fraction(c))
    # The sign of the first term that is left, times that of p² / factor.
    first = {"sin": (-1) ** (order // 2), "cos": (-1) ** (order // 2), "exp": 1, "log": (-1) ** (order + 1)}
    above = sign * first[function]
    below = above * (-1) ** order
    allowed = [side for side, sign in (((-1.0, at), below), ((at, 1.0), above)) if sign > 0]
    if not allowed:
        allowed = [(at, at)]
    assert ends(found) == [pytest.approx(expected, abs=1e-12) for expected in allowed]
    assert {window.kind for window in found} == {"equilibrium" if allowed == [(at, at)] else "separatrix"}
    for window in found:
        require_known_ends(window)


@each_once(
    order=[2, 3, 4, 8],
    u=["g2-sin(1/3)", "exp(g2)-exp(1)/2", "log(g2+3/2)-sin(1/4)", "g2-0.3271946967961522"],
)
def test_a_power_of_a_part_that_vanishes_anywhere_is_a_zero_of_its_order(u, order):
    """A part u has one zero, and D = u^n times something without one: there is an equilibrium, wherever."""
    found = windows(f"(2+g2)*({u})^{order}")
    at = {
        "g2-sin(1/3)": math.sin(1 / 3),
        "exp(g2)-exp(1)/2": 1 - math.log(2),
        "log(g2+3/2)-sin(1/4)": math.exp(math.sin(1 / 4)) - 1.5,
        "g2-0.3271946967961522": 0.3271946967961522,
    }[u]
    allowed = [(-1.0, at), (at, 1.0)] if order % 2 == 0 else [(at, 1.0)]
    assert ends(found) == [pytest.approx(expected, abs=1e-12) for expected in allowed]
    assert all(window.kind == "separatrix" for window in found)
    for window in found:
        require_known_ends(window)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("G", "at"),
    [
        ("(g2-sin(1/3))^2*(exp(g2)-exp(sin(1/3)))", math.sin(1 / 3)),
        ("(exp(g2)-2)*(g2-log(2))^2", math.log(2)),
        ("(2*g2-exp(-1))*(sin(g2)-sin(exp(-1)/2))*(g2-exp(-1)/2)", math.exp(-1) / 2),
    ],
)
def test_parts_that_vanish_at_one_number_make_one_zero_of_it(G, at):
    """The field has such rules: exp(g2) − exp(sin(1/3)) is 0 where g2 is sin(1/3)."""
    (found,) = windows(G)
    assert ends([found]) == [pytest.approx((at, 1.0), abs=1e-12)]
    assert found.kind == "separatrix"
    require_known_ends(found)


def test_zeros_that_may_be_one_of_high_order_are_told_within_a_narrow_interval():
    """No rule tells that exp(sin(1/3))² cancels: one zero of order three, or one and a double one."""
    with pytest.raises(SeparatrixUndecidedError, match=r"at g2 = 0\.327194696796"):
        windows("(g2-sin(1/3))^2*(exp(2*g2)-exp(sin(1/3))^2)")


@pytest.mark.parametrize("other", ["g2/10^7", "-g2/10^7"])
def test_zeros_next_to_one_of_high_order_are_told_apart_from_it(other):
    """sin(g2) - g2 ± 1e-7 g2 has one zero, or three within 1e-3."""
    found = windows(f"g2-sin(g2)+({other})")
    r = 7.7459666924e-4  # √(6e-7), from g2²/6 = 1e-7
    if other.startswith("-"):
        assert ends(found) == [pytest.approx((-r, 0.0), abs=1e-9), pytest.approx((r, 1.0), abs=1e-9)]
    else:
        assert ends(found) == [pytest.approx((0.0, 1.0), abs=1e-12)]


@pytest.mark.parametrize(
    "shape",
    [
        "(g2-({c}))*abs(g2-({c}))^(1/3)",
        "abs(g2-({c}))^(4/3)*(2+g2)",
        # Touched from both sides: the motion may turn back there, or go through.
        "abs(sin(g2-({c})))",
        "abs(g2-({c}))^(9/5)",
        "abs(g2-({c}))^(6/7)",
    ],
)
def test_an_end_that_is_reached_and_left_at_any_time_has_its_own_word(shape):
    c = place()
    found = windows(shape.format(c=c))
    assert found
    for window in found:
        assert window.kind == "standstill"
        assert "standstill" in {end for arc in window.arcs for end in (arc.lower_end, arc.upper_end)}
        assert min(abs(end - c) for end in window.g2) < 1e-9
        with pytest.raises(StandstillError, match=rf"p² vanishes at g2 = {c}"):
            require_known_ends(window)


@pytest.mark.parametrize("order", [4])
def test_zero_of_high_order_at_the_equator(order):
    (window, *_) = windows(f"g2^{order}")
    assert window.kind == "separatrix"
    assert 0.0 in [pytest.approx(end, abs=1e-12) for end in window.g2]


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    "shape",
    [
        "exp(-{width}/(g2-({c}))^2)",
        "exp(-{width}/(g2-({c}))^2)*(2+g2)",
        "(g2-({c}))*exp(-{width}/(g2-({c}))^2)",
        "exp(-{width}/abs(g2-({c})))",
    ],
)
def test_zero_of_no_whole_order_is_met_by_name(shape):
    c, width = place(), DRAWS.choice(("1/20", "1", "3"))
    found = windows(shape.format(c=c, width=width))
    assert all(min(abs(end - c) for end in window.g2) < 1e-9 for window in found)
    assert found
    for window in found:
        with pytest.raises(FlatZeroError, match=r"p² vanishes at g2 = "):
            require_known_ends(window)


def test_flat_pole_is_met_by_name():
    for window in windows("exp(-1/(1-g2))*(g2+1/2)"):
        with pytest.raises(FlatZeroError, match="g2 = 1,"):
            require_known_ends(window)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("c", ["-9/10", "-223/250", "-22/25", "-4/5", "1/3", "7/10"])
def test_isolated_flat_zero_is_found_wherever_the_search_ends(c):
    """At the zero itself the formula has no value: a search that ends there found nothing."""
    found = windows(f"-exp(-1/((g2-({c}))/(11/20))^2)")
    assert [(window.kind, window.g2) for window in found] == [
        ("equilibrium", (pytest.approx(float(Fraction(c)), abs=1e-12),) * 2)
    ]


def test_isolated_flat_zero_is_a_rest_for_ever():
    (window,) = windows("-exp(-1/(g2-1/4)^2)")
    assert window.kind == "equilibrium"
    assert window.g2 == pytest.approx((0.25, 0.25), abs=1e-9)
    require_known_ends(window)
