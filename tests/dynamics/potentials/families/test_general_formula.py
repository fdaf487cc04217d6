"""V1 of sums of certain powers of w has a formula: against its integral, and through poles in every tier."""

import json
from fractions import Fraction
from functools import cache

import mpmath
import pytest
from flint import arb, ctx, fmpq

from service.dynamics.potentials.families.general_formula import formula_of
from service.dynamics.potentials.families.written import FormulaText, general_potential
from service.dynamics.potentials.potential import Potential
from service.dynamics.verdict.simple_form import is_simplified, simplified
from service.jobs.records import Solved
from tests.support.planar import body
from workers.computation.compute import solve_checked

CANCELS = "-sqrt(2)/3/sqrt(1-g2^2)"
"""G that leaves −|g1| of V1[−√w/2], for A = 2C = 2 and φ0 = π/4."""
ODD = {"pp": "-sqrt(w)/2", "mp": "sqrt(w)/2", "pm": "-sqrt(w)/2", "mm": "sqrt(w)/2"}
KNOWN: dict[str, tuple[object, object, FormulaText, FormulaText, str]] = {
    # A, C, F, G, φ0
    "B": (2, 1, "-sqrt(w)/2", "0", "pi/4"),
    "factors that are no fractions": (2, 1, "-w^(3/2)+sqrt(2*w)/pi", "sin(g2)", "1"),
    "B and C": (3, 1, "w^(1/3)+w^(2/3)-w^(5/3)+w^(-1)+2", "1", "pi/5"),
    "B_n beside a multiple of Q": (3, 2, "w^(2/3)-3/w^2+w^(4/3)", "0", "pi/4"),
    "A < C": ("3/5", 1, "w^(5/3)+w^(10/3)-w^(-1)-w^-2", "0", "pi/4"),
    "A < C, of a degree that is whole": (1, 2, "w^2-1/w+3/w^3", "0", "1/3"),
    "A < C, terms without end on the other side": (2, 5, "w^(5/2)+1/w", "0", "pi/4"),
    "moments that are no units": (4, 2, "w^(5/2)-w^(3/2)", "0", "pi/4"),
    "constant": ("17/10", 1, "7", "g2^2", "pi/4"),
    "a quotient of sums": (2, 1, "-sqrt(w)/2*(1+w)/(1+w)", CANCELS, "pi/4"),
    "powers of sums": (2, 1, "(1+w)^3/(1+w)^2*sqrt(w)", "0", "pi/4"),
    "quadrants": (
        2,
        1,
        {"pp": "-sqrt(w)/2", "mp": "sqrt(pi*w)/2", "pm": "1/w", "mm": "3"},
        {"pp": "g2", "mp": "1", "pm": "0", "mm": "sin(g2)"},
        "1/2",
    ),
}
POINTS = [((2, 7), (6, 7), 1), ((-6, 7), (2, 7), 1), ((-3, 5), (-1, 5), 1), ((1, 100), (-1, 7), -1)]


def values(
    potential: Potential, first: tuple[int, int], third: tuple[int, int], side: int
) -> tuple[arb, arb]:
    g1, g3 = arb(fmpq(*first)), arb(fmpq(*third))
    return potential.value_and_D_ball(g1, side * (1 - g1 * g1 - g3 * g3).sqrt(), g3)


@pytest.mark.parametrize("name", KNOWN)
def test_the_formula_is_the_integral(name: str) -> None:
    A, C, F, G, angle = KNOWN[name]
    stated = general_potential(body(A, C), F, G, {}, angle)
    formula = formula_of(stated)
    assert formula is not None
    with ctx.workprec(256):
        for place in POINTS:
            for known, found in zip(values(stated, *place), values(formula, *place), strict=True):
                assert found.overlaps(known)
                # 256 bits are 77 digits; powers up to 20 at a size of 1/100 lose some of them.
                assert found.rad() < arb("1e-45") * (1 + abs(known))
                assert known.rad() < arb("1e-40") * (1 + abs(known))


@pytest.mark.parametrize(
    "F", ["w^(3/7)", "exp(-w)", "w/(2+w)", "sqrt(1+w)", "log(w)", "w^11", "w", "w^(21/2)"]
)
def test_other_functions_stay_integrals(F: str) -> None:
    stated = general_potential(body(2, 1), F, "0", {})
    assert formula_of(stated) is None
    assert simplified(stated) is stated


def test_what_cancels_is_found() -> None:
    found = simplified(general_potential(body(2, 1), KNOWN["a quotient of sums"][2], CANCELS, {}))
    assert is_simplified(found)
    assert found.tree == simplified(general_potential(body(2, 1), "-sqrt(w)/2", CANCELS, {})).tree
    place = (3, 5), (1, 5), 1
    assert values(found, *place)[0].contains(arb(fmpq(-3, 5)))
    # What differs between quadrants has a formula for all of them only where no sign is left over.
    G = {quadrant: CANCELS if F.startswith("-") else f"-({CANCELS})" for quadrant, F in ODD.items()}
    odd = simplified(general_potential(body(2, 1), ODD, G, {}))
    for first in (3, -3):
        assert values(odd, (first, 5), (1, 5), 1)[0].contains(arb(fmpq(-first, 5)))
    plain = general_potential(body(2, 1), ODD, "0", {})
    assert simplified(plain) is plain


TIERS = {"draft": 1e-6, "standard": 1e-10, "high": 1e-13, "certified": 1e-15}


@pytest.mark.one_in(2)
@pytest.mark.parametrize("tier", TIERS)
def test_every_tier_passes_the_poles(tier: str) -> None:
    problem = {
        "body": {"A": 2, "C": 1},
        "potential": {"type": "general", "F": "-sqrt(w)/2", "G": "0"},
        "motion": {"type": "planar", "lambda": 1},
        "time": {"periods": 1, "samples": 9},
        "accuracy": {"tier": tier},
    }
    outcome = solve_checked(json.dumps(problem))
    assert isinstance(outcome, Solved)
    assert outcome.summary["error"] <= TIERS[tier]
    assert [warning["code"] for warning in outcome.summary["warnings"]] == ["simpler_potential"]
    # The error of a double, which is what every tier but the last has, and the last in more digits.
    assert abs(Fraction(outcome.summary["period"]["value"]) - known_period()) < Fraction("2e-15")


@cache
def known_period() -> Fraction:
    """Return the period by the theory of A = 2C: x = g1, ν = g3²/x = 1, and g1² + g3² = x² + x.

    x'² = 2 (1 − x² − x) N with N = x − 2 x² G, and G = (√2/3)/√(x² + x) is what the reference angle adds to
    −x; all six variables come back after twice the time from a pole to the equator and back.
    """
    with mpmath.workdps(30):

        def rate(x: mpmath.mpf) -> mpmath.mpf:
            return 1 / mpmath.sqrt(2 * x * (1 - x - x * x) * (1 - mpmath.sqrt(8 * x / (1 + x)) / 3))

        equator = (mpmath.sqrt(5) - 1) / 2
        # The double exponential rule, whose nodes crowd at the roots at both ends.
        return Fraction(mpmath.nstr(4 * mpmath.quad(rate, [0, equator / 2, equator]), 25))


@pytest.mark.long
def test_an_integral_beside_a_formula_that_cancels_at_the_poles():
    """Doubles know nothing of 1 − g2² in G next to a pole, and balls need 1400 bits more than V1 does."""
    F, G = "-sqrt(w)/2*(1+w)/(2+w)", CANCELS
    problem = {
        "body": {"A": 2, "C": 1},
        "potential": {"type": "general", "F": F, "G": G},
        "motion": {"type": "planar", "lambda": 1},
        "time": {"periods": 1, "samples": 9},
    }
    outcome = solve_checked(json.dumps(problem))
    assert isinstance(outcome, Solved)
    period = outcome.summary["period"]
    # By mpmath at 30 digits: 4 ∫ dx/x' from pole to equator, where Q = 2 x² + x, ρ = x² + x, w = 1 and
    # x'² = −4 x² (1 − x − x²)(F/Q + V1/Q + G), V1/Q = −∫ F(ρ z²/(1 + z)) dz / ((2 + z)² ρ) from 1 to 1/x;
    # the double exponential rule over θ, x = X sin²θ, and Legendre's over log z. Steps 1/16 and 1/24, with 80
    # and 100 nodes inside, agree to 24 digits.
    assert abs(Fraction("7.19549420120514161955356") - Fraction(period["value"])) <= Fraction(period["error"])
