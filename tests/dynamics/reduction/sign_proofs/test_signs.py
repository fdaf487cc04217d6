"""Walls, wells, steps and spikes of any width are seen wherever they stand."""

import math
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import example, given, settings
from hypothesis import strategies as st

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.structure import SignsUnsettledError
from service.dynamics.reduction.window import height
from service.dynamics.reduction.windows import find_windows
from tests.support.effort import examples
from tests.support.planar import body, formula

BODY, MOTION = body(2, 1), PlanarMotion(Fraction(1))
Q = "(2*g1^2+g3^2)"
STEEP = np.linspace(-40.0, 40.0, 8001)
"""(g2 − c)/w: beyond, every shape is what it tends to, to e^-40."""
EVERYWHERE = np.linspace(-1.0, 1.0, 2001)[1:-1]

SHAPES = {
    "bump": ("exp(-(({y})/{w})^2)", lambda u: np.exp(-(u**2))),
    "step": ("1/(1+exp(-({y})/{w}))", lambda u: 1.0 / (1.0 + np.exp(-u))),
    "spike": ("exp(-abs({y})/{w})", lambda u: np.exp(-np.abs(u))),
    "peak": ("1/(1+(({y})/{w})^2)^8", lambda u: (1.0 + u**2) ** -8.0),
}


def first(g2):
    """Return g1 on the curve g3² = g1."""
    rest = 1.0 - g2**2
    return 2.0 * rest / (1.0 + np.sqrt(1.0 + 4.0 * rest))


def places_of_rest(shape, size, sign, c, w):
    """Return the zeros of p² and whether it is positive next to the poles.

    V = sign·(−g1 + size·Q·G(g2)) has D = sign·g3·(1 − 2·size·g1·G), hence p² the sign of that over g1.
    The distance from c is counted in w: nothing is lost where it is narrow.
    """

    def factor(u, g2):
        return 1.0 - 2.0 * size * first(g2) * shape(u)

    with np.errstate(over="ignore"):
        u = np.unique(np.concatenate([STEEP, (EVERYWHERE - c) / w]))
        u = u[(c + w * u > -1.0) & (c + w * u < 1.0)]
        values = factor(u, c + w * u)
        zeros = []
        for k in np.flatnonzero(values[:-1] * values[1:] < 0.0):
            low, high = u[k], u[k + 1]
            for _ in range(80):
                middle = 0.5 * (low + high)
                is_below = factor(middle, c + w * middle) * values[k] > 0.0
                low, high = (middle, high) if is_below else (low, middle)
            zeros.append(c + w * low)
    return zeros, sign * values[0] > 0.0, float(np.abs(values).min())


def rests(windows):
    """Return g2 where motions turn back, each once: beyond a pole they turn at the same heights."""
    found = set()
    for arc in (arc for window in windows for arc in window.arcs):
        for end, v in ((arc.lower_end, arc.lower), (arc.upper_end, arc.upper)):
            if end == "rest":
                found.add(round(height(arc.loop, v), 13))
    return sorted(found)


@st.composite
def obstacles(draw):
    w = Fraction(draw(st.integers(10, 99)), 10 ** draw(st.integers(2, 9)))
    c = Fraction(draw(st.integers(-95000, 95000)), 100000)
    return draw(st.sampled_from(sorted(SHAPES))), draw(st.sampled_from([1, -1])), c, w


@given(obstacles(), st.sampled_from([Fraction(2), Fraction(7), Fraction(1, 2)]))
@settings(max_examples=examples(10, 60), deadline=None)
def test_an_obstacle_of_any_width_is_seen_at_its_very_place(obstacle, size):
    name, sign, c, w = obstacle
    text, shape = SHAPES[name]
    zeros, is_open, nearest = places_of_rest(shape, float(size), sign, float(c), float(w))
    if nearest < 1e-9:
        # So near to touching that the reference cannot tell.
        return
    G = text.format(y=f"g2-({c})", w=f"({w})")
    potential = formula(f"{sign}*(-g1 + {size}*{Q}*{G})", BODY)
    windows = find_windows(BODY, potential, MOTION)
    arcs = sum(len(window.arcs) for window in windows)
    stretches = len(zeros) // 2 + 1 if is_open else (len(zeros) + 1) // 2
    assert arcs == stretches
    # Doubles know (g2 − c)/w to 1e-16/w: the zeros of the reference are as good as that, times w.
    assert rests(windows) == pytest.approx(zeros, abs=1e-12)


def test_a_wall_between_all_nodes_ends_the_motion_before_it():
    """At the ends of the windows 4 g1 exp(-10^6 (g2 − 3/10)²) = 1, by bisection in 200 bits."""
    potential = formula(f"-g1+{Q}*2*exp(-10^6*(g2-3/10)^2)", BODY)
    above, below = find_windows(BODY, potential, MOTION)
    with ctx.workprec(200):

        def defect(g2):
            rest = 1 - g2 * g2
            g1 = 2 * rest / (1 + (1 + 4 * rest).sqrt())
            return 4 * g1 * (-(10**6) * (g2 - arb(3) / 10) ** 2).exp() - 1

        for end, far in ((below.g2[1], "0.29"), (above.g2[0], "0.31")):
            inside, outside = arb(3) / 10, arb(far)
            for _ in range(150):
                middle = ((inside + outside) / 2).mid()
                inside, outside = (middle, outside) if defect(middle) > 0 else (inside, middle)
            # 2^-52 of 0.3, twice.
            assert abs(end - float(inside)) < 2e-16
    assert (above.kind, below.kind) == ("periodic", "periodic")


def test_a_narrow_well_makes_a_window_where_there_was_none():
    well = formula(f"g1-{Q}*2*exp(-10^6*(g2-3/10)^2)", BODY)
    wall = formula(f"-g1+{Q}*2*exp(-10^6*(g2-3/10)^2)", BODY)
    (window,) = find_windows(BODY, well, MOTION)
    # p² changes its sign with V: the window of one is what the other leaves out.
    # Both round to 13 digits.
    assert rests([window]) == rests(find_windows(BODY, wall, MOTION))
    assert rests([window]) == pytest.approx(list(window.g2), abs=1e-13)


@given(st.integers(130, 3000), st.sampled_from([-1, 1]), st.integers(10, 99), st.integers(2, 9))
@settings(max_examples=examples(7, 20), deadline=None)
def test_an_obstacle_in_the_angle_is_seen(hundredths, sign, digits, power):
    """V = sign·(−√g1 + 5 e^(−u²)), u = (t − c)/w, t = |g3|/|g1|.

    D = sign·(g3/(2√g1) − 10 u e^(−u²) (1 + t²)/w), and on the curve g3² = g1 g1 is t^-2 and g3 is 1/t.
    """
    c, w = hundredths / 100, digits / 10**power
    at_equator = first(0.0) ** -0.5

    def values(u):
        return 0.5 - 10.0 * u * np.exp(-(u**2)) * (1.0 + (c + w * u) ** 2) / w

    u = np.linspace((at_equator - c) / w, 40.0, 400_001) if (c - at_equator) / w < 40.0 else STEEP
    zeros = []
    for k in np.flatnonzero(values(u[:-1]) * values(u[1:]) < 0.0):
        low, high = u[k], u[k + 1]
        for _ in range(80):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if values(middle) * values(u[k]) > 0.0 else (low, middle)
        t = c + w * low
        zeros.append(math.sqrt(1.0 - t**-4 - t**-2))
    text = f"{sign}*(-abs(g1)^(1/2) + 5*exp(-((abs(g3/g1)-{hundredths}/100)/({digits}/10^{power}))^2))"
    windows = find_windows(BODY, formula(text, BODY), MOTION)
    expected = sorted([*zeros, *(-g2 for g2 in zeros)])
    # Next to the equator dg2/dt is large: the square root of 1e-16.
    assert rests(windows) == pytest.approx(expected, abs=1e-8)


ROOTS = st.lists(st.integers(-95, 95), min_size=1, max_size=7, unique=True)


@given(ROOTS, st.sampled_from([(2, 1), (1, 3), (17, 10)]), st.sampled_from([0, 3, 6, 9]))
@settings(max_examples=examples(6, 40), deadline=None)
def test_windows_end_at_the_roots_of_a_polynomial(roots, moments, closeness):
    """V = Q G(g2) has p² > 0 where G < 0. Every root has a neighbour nearby."""
    rigid_body = body(Fraction(moments[0]), Fraction(moments[1]))
    exact = sorted(
        Fraction(root, 100) + Fraction(part, 300 * 10**closeness) for root in roots for part in (0, 1)
    )
    product = "*".join(f"(g2-({root}))" for root in exact)
    potential = formula(f"(A*g1^2+C*g3^2)*({product})", rigid_body)
    windows = find_windows(rigid_body, potential, MOTION)
    expected = [(float(low), float(high)) for low, high in zip(exact[::2], exact[1::2], strict=True)]
    found = sorted((height(a.loop, a.lower), height(a.loop, a.upper)) for w in windows for a in w.arcs)
    assert [tuple(sorted(ends)) for ends in found] == [pytest.approx(ends, abs=1e-15) for ends in expected]


# Its g2 is near the least of a small polynomial that has no root there.
@example(("peak", 1, Fraction(17307, 50000), Fraction(1, 100_000)))
@given(obstacles())
@settings(max_examples=examples(5, 15), deadline=None)
def test_the_mirror_image_has_the_mirror_windows(obstacle):
    name, sign, c, w = obstacle
    text = SHAPES[name][0]
    here, there = (
        find_windows(BODY, formula(f"{sign}*(-g1+2*{Q}*{text.format(y=y, w=f'({w})')})", BODY), MOTION)
        for y in (f"g2-({c})", f"-g2-({c})")
    )
    assert rests(here) == pytest.approx([-g2 for g2 in reversed(rests(there))], abs=1e-13)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("text", "code"),
    [
        # Infinitely many windows next to the pole.
        (f"{Q}*sin(1/(1-g2^2))", "essential_singularity"),
        # p² = 0 all over g2 < 99/100.
        (f"-{Q}*(abs(g2-99/100)+g2-99/100)^3", "signs_unsettled"),
        # p² → ∞ at g2 = 0 from both sides, like a square that no rule shows: exp(2) is exp(1)².
        (f"-g1-{Q}/(exp(g2+2)-(1+g2)*exp(1)^2)", "signs_unsettled"),
    ],
)
def test_what_is_not_settled_is_refused_by_name(text, code):
    with pytest.raises(SignsUnsettledError) as refused:
        find_windows(BODY, formula(text, BODY), MOTION)
    assert refused.value.code == code
    assert "between g2 = " in refused.value.message


def test_hundreds_of_windows_are_all_found():
    """sin(1000 g2) < 0 on 2000/(2π) stretches: those with an end at a pole are cut by it."""
    windows = find_windows(BODY, formula(f"{Q}*sin(1000*g2)", BODY), MOTION)
    falls = [k * math.pi / 1000 for k in range(-318, 319)]
    assert rests(windows) == pytest.approx([round(fall, 13) for fall in falls], abs=1e-12)
    assert sum(len(window.arcs) for window in windows) == 319


def test_a_repelling_singularity_is_no_window_and_no_refusal():
    potential = formula(f"-g1+{Q}/(g2-3/10)^2/100", BODY)
    above, below = find_windows(BODY, potential, MOTION)
    for end in (above.g2[0], below.g2[1]):
        # 1 = 2 g1 G, G = 1/(100 (g2 − 3/10)²).
        assert (end - 0.3) ** 2 == pytest.approx(first(end) / 50.0, rel=1e-13)
