"""Zeros of p² of high order are ends that are approached for ever; those of no order are met by name."""

import random
from fractions import Fraction

import pytest

from service.dynamics.body import RigidBody
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.ends import FlatZeroError, require_known_ends
from service.dynamics.reduction.window import Window
from service.dynamics.reduction.windows import find_windows
from tests.support.planar import body, formula

RIGID_BODY = body(2, 1)
MOTION = PlanarMotion(1, g3_sign=1)
DRAWS = random.Random(41)


def windows(factor: str, rigid_body: RigidBody = RIGID_BODY) -> tuple[Window, ...]:
    """Return the windows where p² is (2 g1² + g3²)'s share of ``factor``, a function of g2."""
    return find_windows(rigid_body, formula(f"-(2*g1^2+g3^2)*({factor})", rigid_body), MOTION)


def place() -> float:
    return DRAWS.choice((-1, 1)) * DRAWS.randrange(5, 90) / 100


def ends(found: tuple[Window, ...]) -> list[tuple[float, float]]:
    return sorted(window.g2 for window in found)


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


@pytest.mark.parametrize("order", [4])
def test_zero_of_high_order_at_the_equator(order):
    (window, *_) = windows(f"g2^{order}")
    assert window.kind == "separatrix"
    assert 0.0 in [pytest.approx(end, abs=1e-12) for end in window.g2]


@pytest.mark.parametrize(
    "shape",
    [
        "exp(-{width}/(g2-({c}))^2)",
        "exp(-{width}/(g2-({c}))^2)*(2+g2)",
        "(g2-({c}))*exp(-{width}/(g2-({c}))^2)",
        "exp(-{width}/abs(g2-({c})))",
        "abs(g2-({c}))",
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
