"""Places on the sphere where p² is infinite: windows end there in collisions, and such a place is no zero."""

from itertools import pairwise
from math import log, pi, sin, sqrt

import numpy as np
import pytest
from flint import arb, ctx

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.vanishing import vanishing_parts
from service.dynamics.potentials.families.written import general_potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.tight_form import tight_form
from service.dynamics.reduction.structure import EssentialSingularityError, SignsUnsettledError
from service.dynamics.reduction.window import Arc, Window, height
from service.dynamics.reduction.windows import find_windows, find_windows_together
from service.dynamics.verdict.simple_form import simplified
from tests.support.effort import one_in
from tests.support.planar import body, formula

DOUBLE = body(2, 1)
MOTION = PlanarMotion(1)
Q = "(2*g1^2+g3^2)"
SAME = 1e-12
"""Ends are doubles next to balls of 160 bits."""


def windows(text: str) -> tuple[Window, ...]:
    return find_windows(DOUBLE, simplified(formula(text, DOUBLE)), MOTION)


def heights(found: tuple[Window, ...]) -> list[tuple[str, float, float]]:
    return sorted((window.kind, *window.g2) for window in found)


def zero_of(f, low: float, high: float) -> float:
    """Return a zero by bisection."""
    at_low = f(low) > 0
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if (f(middle) > 0) == at_low else (low, middle)
    return low


def g1_at(y: float) -> float:
    """Return g1 on g3² = g1, where g1² + g1 = 1 − y²."""
    return 0.5 * (sqrt(5.0 - 4.0 * y * y) - 1.0)


def edge(G, low: float, high: float) -> float:
    """Return the g2 at which a motion in V = −g1 + Q G turns back: p² ~ 1 − 2 g1 G (theory.md, 3.3)."""
    return zero_of(lambda y: 1.0 - 2.0 * g1_at(y) * G(y), low, high)


@pytest.mark.parametrize("order", [1, 3, 5])
def test_a_pole_of_odd_order_is_a_collision_on_one_side(order):
    """On the side where p² > 0; on the other there is a window that ends at a true zero."""
    found = windows(f"-g1-{Q}/20/(1/2-g2)^{order}")
    rest = edge(lambda y: -1.0 / 20.0 / (0.5 - y) ** order, 0.5 + 1e-9, 1.0 - 1e-12)
    expected = [("collision", -1.0, 0.5), ("periodic", rest, 1.0)]
    assert heights(found) == [
        (kind, pytest.approx(a, abs=SAME), pytest.approx(b, abs=SAME)) for kind, a, b in expected
    ]


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    "size",
    [
        "(1/2-g2)^2",
        "(1/2-g2)^4",
        "abs(1/2-g2)",
        "abs(1/2-g2)^(1/3)",
        "(g2^2-g2+1/4)",
        "(1-cos(g2-1/2))",
        "(2-2*cos(1/2-g2))^2",
        "abs(cos(2*g2-1)-1)",
    ],
)
@pytest.mark.parametrize("sign", "-+")
def test_a_pole_of_even_order_ends_motions_on_both_sides_or_none(size, sign):
    found = windows(f"-g1{sign}{Q}/20/{size}")
    if sign == "-":
        assert [(kind, *map(float, np.round(ends, 12))) for kind, *ends in heights(found)] == [
            ("collision", -1.0, 0.5),
            ("collision", 0.5, 1.0),
        ]
        return
    # Both turn back before it.
    assert all(window.kind == "periodic" and not window.g2[0] <= 0.5 <= window.g2[1] for window in found)


# Of V = −g1 + Q G: where p² → ∞, and on which side of it, that of larger g2 (1) or smaller, it is positive.
SIDES = {
    "tan": (f"-g1-{Q}*tan(2*g2)/10", [(pi / 4, -1), (-pi / 4, -1)]),
    "cotangent": (f"-g1-{Q}*cos(2*g2)/sin(2*g2)/10", [(0.0, 1)]),
    "1/log": (f"-g1-{Q}/20/log(g2+1/2)", [(0.5, 1)]),
    "1/sin": (f"-g1-{Q}/20/sin(g2-1/3)", [(1 / 3, 1)]),
    "1/(exp - 3/2)": (f"-g1-{Q}/20/(exp(g2)-3/2)", [(np.log(1.5), 1)]),
    "quotient": (f"-g1-{Q}/20*(1+g2)/(1/2-g2)", [(0.5, -1)]),
    "two terms of one pole": (f"-g1-{Q}/20/(1/2-g2)-{Q}/30/(1-2*g2)^3", [(0.5, -1)]),
    "two poles": (f"-g1-{Q}/20/((1/2-g2)*(g2+1/3))", [(0.5, -1), (-1 / 3, 1)]),
    "irrational": (f"-g1-{Q}/20/(2*g2^2-1)", [(sqrt(0.5), 1), (-sqrt(0.5), -1)]),
    "of rho": (f"-g1-{Q}/20/(3/4-g1^2-g3^2)", [(0.5, 1), (-0.5, -1)]),
    "power with an edge": (f"-g1-{Q}/20/(1/2-g2)^(1/3)", [(0.5, -1)]),
    "root with an edge": (f"-g1-{Q}/20/sqrt(1/2-g2)", [(0.5, -1)]),
    "5/3": (f"-g1-{Q}/20*(1+g2)/(1/2-g2)^(5/3)", [(0.5, -1)]),
    "logarithm": (f"-g1+{Q}*log(abs(g2-1/2))/20", [(0.5, 1), (0.5, -1)]),
    "logarithm at its edge": (f"-g1+{Q}*log(g2+1/3)/20", [(-1 / 3, 1)]),
    "equator": (f"-g1-{Q}/20/g2", [(0.0, 1)]),
    "equator, even": (f"-g1-{Q}/20/g2^2", [(0.0, 1), (0.0, -1)]),
    "equator, |g2|": (f"-g1-{Q}/20/abs(g2)", [(0.0, 1), (0.0, -1)]),
    "near the end": (f"-g1-{Q}/20/(999999/1000000-g2)", [(0.999999, -1)]),
    "weak": (f"-g1-{Q}*1e-9/(1/2-g2)", [(0.5, -1)]),
    "weaker than doubles": (f"-g1-{Q}*1e-20/(1/2-g2)", [(0.5, -1)]),
    "F constant": (f"-{Q}/(1/2-g2)", [(0.5, -1)]),
    "double zero of a function": (f"-g1-{Q}/20/(exp(g2-1/2)-1/2-g2)", [(0.5, 1), (0.5, -1)]),
    "the same on the equator": (f"-g1-{Q}/20/(exp(g2)-1-g2)", [(0.0, 1), (0.0, -1)]),
    "the same at no rational": (
        f"-g1-{Q}/20/(exp(g2-sin(1/3))-1-g2+sin(1/3))",
        [(sin(1 / 3), 1), (sin(1 / 3), -1)],
    ),
    "triple zero of a function": (f"-g1-{Q}/20/(g2-sin(g2))", [(0.0, 1)]),
    "0/0 on the equator": (f"-g1-{Q}/20*sin(g2)/g2^2", [(0.0, 1)]),
    "0/0 at no rational": (f"-g1-{Q}/20*(g2-sin(1/3))/(exp(g2)-exp(sin(1/3)))^2", [(sin(1 / 3), 1)]),
    "root of 0/0": (f"-g1-{Q}/20*sqrt((exp(g2-1/2)-1)/(g2-1/2)^4)", [(0.5, 1)]),
}


@pytest.mark.parametrize("name", one_in(5, SIDES))
def test_windows_end_where_p_squared_is_infinite(name):
    """Each such side is the end of one window of the kind ``collision``, and no other window is of it."""
    text, sides = SIDES[name]
    found = windows(text)
    ends = []
    for window in found:
        places = [(arc.loop, v, end, side) for arc in window.arcs for v, end, side in sides_of(arc)]
        infinite = [(loop, v, side) for loop, v, end, side in places if end == "collision"]
        assert window.kind == "collision" if infinite else window.kind in ("periodic", "edge")
        # On the other half of the loop there are the mirror images.
        ends += [(height(loop, v), side) for loop, v, side in infinite if v > 0 and v < arb.pi()]
    assert sorted(ends) == [(pytest.approx(y, abs=SAME), side) for y, side in sorted(sides)]


def sides_of(arc: Arc) -> list[tuple[arb, str | None, int]]:
    """Return the ends of an arc, and on which side of each it lies: g2 falls along v."""
    return [(arc.lower, arc.lower_end, -1), (arc.upper, arc.upper_end, 1)]


@pytest.mark.parametrize("G", ["sin(g2)/g2", "(exp(g2-1/2)-1)/(g2-1/2)", "(exp(g2)-1-g2)/g2^2"])
def test_a_quotient_that_is_bounded_where_it_is_0_over_0_ends_no_motion(G):
    """p² ~ 1 − 2 g1 G/20 > 0 from pole to pole: g1 < 1 and |G| < 2."""
    assert heights(windows(f"-g1-{Q}/20*{G}")) == [("periodic", -1.0, 1.0)]


def test_an_end_that_is_the_extremum_of_g1_is_called_a_collision():
    (window,) = windows(f"-g1-{Q}/20/g2^2")
    # Both hemispheres, from the pole to the equator, which is not crossed.
    assert (window.ends, window.g2, len(window.arcs)) == (("pole", "collision"), (0.0, 1.0), 2)


def test_curves_that_are_looked_at_together_end_in_the_same_collisions():
    potential = formula(f"-g1-{Q}/20/(1/2-g2)", DOUBLE)
    motions = [PlanarMotion(lambda_) for lambda_ in (1, 2, 3)]
    together = find_windows_together(DOUBLE, potential, motions)
    for motion, found in zip(motions, together, strict=True):
        alone = find_windows(DOUBLE, potential, motion)
        assert [(w.kind, w.ends, w.g1, w.g2) for w in found] == [(w.kind, w.ends, w.g1, w.g2) for w in alone]


@pytest.mark.parametrize(
    "term",
    [
        "1/(exp(g2+2)-(1+g2)*exp(1)^2)",  # a double pole, if exp(2) is exp(1)²: no rule says so
        "abs(g2-1/2)/(g2-1/2)*(-100)",  # a jump from one sign to the other
    ],
)
def test_what_is_not_proved_is_refused_and_is_no_zero(term):
    with pytest.raises(SignsUnsettledError) as refused:
        windows(f"-g1-{Q}/20*{term}")
    assert refused.value.code == "signs_unsettled"


@pytest.mark.parametrize(
    "term",
    [
        *(f"{sign}{Q}/20*{f}(1/(g2-1/2))" for sign in "-+" for f in ("exp", "sin")),
        # With the other sign p² < 0 on both sides, which needs no power.
        f"-{Q}/20*exp(log(abs(g2-1/2))^2)",
    ],
)
def test_what_outgrows_every_power_has_its_own_word(term):
    """exp(1/x) is infinite on one side of 0 and flat on the other; sin(1/x) has infinitely many zeros."""
    with pytest.raises(EssentialSingularityError, match=r"between g2 = 0\.[45]") as refused:
        windows(f"-g1{term}")
    assert refused.value.code == "essential_singularity"


# G, and the zeros of 1 − 2 g1 G between -1 and 1.
@pytest.mark.one_in(3)
@pytest.mark.parametrize("size", [1, 40])
@pytest.mark.parametrize(
    ("G", "value"),
    [
        ("(g2-1/2)*log(abs(g2-1/2))", lambda x: x * log(abs(x))),
        ("(g2-1/2)^2*log((g2-1/2)^2)", lambda x: 2 * x * x * log(abs(x))),
        ("(g2-1/2)*log(abs(g2-1/2))^3", lambda x: x * log(abs(x)) ** 3),
        ("sqrt(abs(g2-1/2))*log(abs(g2-1/2))", lambda x: sqrt(abs(x)) * log(abs(x))),
        ("sin(g2-1/2)*(3+log(abs(sin(g2-1/2))))", lambda x: sin(x) * (3 + log(abs(sin(x))))),
    ],
)
def test_a_term_that_vanishes_with_an_infinite_slope_is_no_end_where_p_squared_is_positive(G, value, size):
    found = windows(f"-g1-{Q}*{size}/20*{G}")

    def P(y):
        return 1.0 + 2.0 * g1_at(y) * size / 20 * value(y - 0.5)

    # Ends by signs on a grid that does not meet 1/2, where P = 1, refined by bisection.
    grid = np.linspace(-1.0, 1.0, 4002)[1:-1]
    zeros = [zero_of(P, a, b) for a, b in pairwise(grid.tolist()) if P(a) * P(b) < 0]
    inner = sorted(y for window in found for y in window.g2 if abs(y) < 1 - 1e-9)
    # Windows over the equator have two ends on one side of it, of which the table has one.
    assert set(np.round(inner, 9)) <= set(np.round([*zeros, *(-y for y in zeros)], 9)) | {0.0}
    covered = [any(window.g2[0] <= y <= window.g2[1] for window in found) for y in (0.499, 0.5, 0.501)]
    assert all(covered)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("F", "G", "sides"),
    [
        ("0", "-1/(1/2-g2)", [0.5]),
        ("-sqrt(w)/2", "-1/20/g2^2", [0.0]),
        ("-sqrt(w)/2", "-1/20/abs(g2-1/3)", [1 / 3, 1 / 3]),
        ("-sqrt(w)/2", "log(g2-1/3)/20", [1 / 3]),
        ("-exp(-w)", "-1/20/sqrt(1/2-g2)", [0.5]),
    ],
)
def test_potentials_that_are_given_by_an_integral(F, G, sides):
    """F = −√w/2 is V = −g1 but for a term in Q: the windows end where G is infinite."""
    found = find_windows(DOUBLE, general_potential(DOUBLE, F, G, {}, "pi/4"), MOTION)
    inner = [
        y
        for window in found
        for y in window.g2
        if window.kind == "collision" and min(abs(1 - y), abs(1 + y)) > 1e-9
    ]
    assert sorted(inner) == [pytest.approx(y, abs=SAME) for y in sorted(sides)]


@pytest.mark.parametrize(
    "text",
    [
        f"-g1-{Q}/20/(1/2-g2)^3+{Q}*(g2^2-1/4)/(1-2*g2)",
        f"{Q}*tan(2*g2)/(3/4-g1^2-g3^2)",
        f"{Q}*log(abs(g2^2-1/9))/(g2-1/3)",
        f"{Q}/(sin(g2)*log(g2+3/2))",
    ],
)
def test_a_formula_written_with_a_vanishing_part_has_the_same_values(text):
    tape = tight_form(formula(text, DOUBLE).tape)
    parts = vanishing_parts(tape)
    assert parts
    with ctx.workprec(128):
        for y in ("0.1", "-0.37", "0.83"):
            g2 = arb(y)
            g1 = (1 - g2 * g2).sqrt() * arb("0.6")
            g3 = (1 - g2 * g2).sqrt() * arb("0.8")
            # The sphere holds to 128 bits only, which polynomials of g1² + g3² are rewritten by.
            value = tape.evaluate(BallAlgebra(), (g1, g2, g3))
            for part in parts:
                u = part.part.evaluate(BallAlgebra(), (g1, g2, g3))
                again = part.whole.evaluate(BallAlgebra(), (g1, g2, g3, u))
                assert value.overlaps(again)
                assert again.rel_accuracy_bits() > 100


@pytest.mark.parametrize("g3_sign", [1, -1])
def test_of_windows_that_end_at_one_size_of_g1_the_northern_is_first(g3_sign):
    """At g2 = ±1/2, where p² is infinite: a window passes each pole, and is not the other's mirror image."""
    text = f"-g1+{Q}*(1/100+g2/1000)/(1/4-g2^2)"
    north, south, *_ = find_windows(DOUBLE, formula(text, DOUBLE), PlanarMotion(1, g3_sign=g3_sign))
    assert (north.ends, north.g2) == (("pole", "collision"), (0.5, 1.0))
    assert (south.ends, south.g2) == (("pole", "collision"), (-1.0, -0.5))


@pytest.mark.one_in(3)
@pytest.mark.parametrize("F", ["-sqrt(w)/2", "-exp(-w)"])
@pytest.mark.parametrize(
    ("G", "edge"), [("sqrt(g2-1/5)/10", 0.2), ("(1/2-g2)^(3/2)/50", 0.5), ("sqrt(g2)/10", 0.0)]
)
def test_a_motion_in_a_potential_by_an_integral_ends_at_the_edge_of_its_formula(F, G, edge):
    """On one side of it G has no value, at any number of bits; on the other p² > 0 up to it."""
    (window,) = find_windows(DOUBLE, general_potential(DOUBLE, F, G, {}, "pi/4"), MOTION)
    assert window.kind == "edge"
    assert min(abs(y - edge) for y in window.g2) < SAME
