"""Exact symmetries of the equations, as laws of the solver."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from service.dynamics.motion import Motion
from service.dynamics.problem import PlanarMotion, StartAtEquator, StartAtPoint, StartAtRest, TimeSpan
from service.dynamics.reduction.window import StartOutsideWindowError
from tests.support.admissible import Case, cases, with_periodic_window
from tests.support.effort import examples

pytestmark = pytest.mark.random_law

LAW = settings(
    max_examples=examples(3, 25),
    deadline=None,
    suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow],
)
SCALE = st.sampled_from([4, 9, Fraction(1, 16), 100])
"""Squares, so that times and velocities scale by exact numbers."""


def solvable(case: Case) -> Case:
    found = with_periodic_window(case)
    assume(found is not None)
    return found


def assert_same(one: np.ndarray, two: np.ndarray, *motions: Motion) -> None:
    """Two motions that are one agree within what both claim of themselves."""
    allowed = sum(motion.error for motion in motions)
    # Velocities may be large near a pole: the claims are absolute and cover it.
    assert np.abs(one - two).max() <= allowed


@given(case=cases(), k=SCALE)
@LAW
def test_a_stronger_potential_is_faster(case, k):
    """V → kV: t → t/√k, ω → √k ω, h → kh."""
    case = solvable(case)
    root = Fraction(k).limit_denominator() ** Fraction(1, 2)
    root = Fraction(float(root))
    slow = case.solve()
    fast = case.changed(text=f"({k})*({case.text})", stop=case.stop / root).solve()
    scaled = fast.samples / np.array([*[float(root)] * 3, 1.0, 1.0, 1.0])
    assert_same(slow.samples, scaled, slow, replace(fast, error=fast.error / min(1.0, float(root))))
    assert abs(fast.energy.value - float(k) * slow.energy.value) <= 1e-15 * abs(fast.energy.value) + 1e-30


@given(case=cases(), k=SCALE)
@LAW
def test_a_heavier_body_is_slower(case, k):
    """(A, C) → k (A, C) with the same V: t → √k t, ω → ω/√k, h → h."""
    case = solvable(case)
    root = Fraction(float(Fraction(k)) ** 0.5)
    # The formula's own A and C are frozen, or V would change with them.
    text = case.text.replace("A*", f"({case.A})*").replace("C*", f"({case.C})*")
    light = case.changed(text=text).solve()
    heavy = case.changed(text=text, A=case.A * k, C=case.C * k, stop=case.stop * root).solve()
    scaled = heavy.samples * np.array([*[float(root)] * 3, 1.0, 1.0, 1.0])
    assert_same(light.samples, scaled, light, replace(heavy, error=heavy.error * max(1.0, float(root))))
    assert abs(heavy.energy.value - light.energy.value) <= 1e-15 * abs(light.energy.value) + 1e-30


@given(case=cases(), shift=st.fractions(-100, 100, max_denominator=7))
@LAW
def test_a_constant_shifts_the_energy_only(case, shift):
    case = solvable(case)
    plain, shifted = case.solve(), case.changed(text=f"{case.text} + ({shift})").solve()
    assert_same(plain.samples, shifted.samples, plain, shifted)
    gap = Fraction(shifted.energy.value) - Fraction(plain.energy.value) - shift
    # Each energy is the double next to its enclosure.
    assert abs(gap) <= Fraction(2, 2**53) * (abs(shift) + abs(Fraction(plain.energy.value)) + 1)


@given(case=cases())
@LAW
def test_time_runs_backwards_as_well(case):
    """ω → −ω, t → −t: started with the other sign of s, the motion is its own past."""
    case = solvable(case)
    past = TimeSpan(-case.stop, Fraction(0), 41)
    ahead = case.solve()
    if ahead.window.ends[1] != "equator":
        back = case.solve(times=past)
    else:
        motion = replace(case.motion, start=StartAtEquator(-1))
        back = case.changed(motion=motion).solve(times=past)
    mirrored = back.samples[::-1] * np.array([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0])
    assert_same(ahead.samples, mirrored, ahead, back)


@given(case=cases())
@LAW
def test_the_mirror_exchanging_the_first_and_third_axis(case):
    """(A, C; g1, g3; p, r) → (C, A; g3, g1; −r, −p), V(g1, g2, g3) → V(g3, g2, g1), λ → λ^(−A/C)."""
    case = solvable(case)
    straight = case.solve()
    swapped = {"g1": "g3", "g3": "g1", "A": "C", "C": "A"}
    # abs is the only name that would be touched by accident, and its letters are small.
    pieces = [case.text[k : k + 2] for k in range(len(case.text))]
    text, skip = "", 0
    for pair in pieces:
        if skip:
            skip -= 1
        elif pair in swapped:
            text, skip = text + swapped[pair], 1
        else:
            text += swapped.get(pair[0], pair[0])
    motion = replace(
        case.motion,
        lambda_=Fraction(float(case.motion.lambda_) ** -float(case.A / case.C)),
        g1_sign=case.motion.g3_sign,
        g3_sign=case.motion.g1_sign,
    )
    turned = Case(case.C, case.A, text, motion, case.stop).solve()
    exchanged = turned.samples[:, [2, 1, 0, 5, 4, 3]] * np.array([-1.0, 1.0, -1.0, 1.0, 1.0, 1.0])
    # λ' is rounded to a double: over a few periods that moves the phase by some 1e-15 of its length.
    moved = 1e-12 * max(1.0, float(np.abs(straight.samples).max()))
    assert np.abs(straight.samples - exchanged).max() <= straight.error + turned.error + moved


@given(case=cases())
@LAW
def test_the_mirrors_of_the_signs(case):
    """g1 → −g1: (p, q, r) → (p, −q, −r). g3 → −g3: (p, q, r) → (−p, −q, r). These V are even in both."""
    case = solvable(case)
    plain = case.solve()
    flipped = {
        "g1": (-case.motion.g1_sign, case.motion.g3_sign),
        "g3": (case.motion.g1_sign, -case.motion.g3_sign),
    }
    for axis, (g1_sign, g3_sign) in flipped.items():
        motion = replace(case.motion, g1_sign=g1_sign, g3_sign=g3_sign)
        mirrored = case.changed(motion=motion).solve()
        signs = [1.0, 1.0, -1.0, -1.0, 1.0, 1.0] if axis == "g1" else [-1.0, 1.0, 1.0, 1.0, 1.0, -1.0]
        assert_same(plain.samples, mirrored.samples * np.array(signs), plain, mirrored)


@given(case=cases(), share=st.floats(0.05, 0.95))
@LAW
def test_a_start_inside_the_window_is_the_same_motion_later(case, share):
    case = solvable(case)
    whole = case.solve()
    low, high = whole.window.g1
    g1 = Fraction(low + share * (high - low))
    g2_sign = 1 if whole.window.ends[1] != "equator" or whole.samples[0, 4] >= 0 else -1
    assume(whole.window.ends[0] != "rest" or abs(float(g1)) > abs(low))
    motion = replace(case.motion, start=StartAtPoint(g1, g2_sign, 1))
    try:
        started = case.changed(motion=motion).solve()
    except StartOutsideWindowError:  # an uneven window may reach that g1 in one hemisphere only
        assume(False)
    assert abs(started.samples[0, 3] - float(g1)) <= started.error
    assert abs(started.energy.value - whole.energy.value) <= 1e-15 * abs(whole.energy.value) + 1e-30
    period, other = whole.dense.period, started.dense.period
    assert abs((period.hi - other.hi) + (period.lo - other.lo)) <= period.error + other.error


@given(case=cases())
@LAW
def test_the_relations_of_the_plane_hold_all_along(case):
    """g·g = 1, p : r = −C g3 : A g1, |g3| = λ |g1|^(C/A), energy: none of them is built into the samples."""
    case = solvable(case)
    motion = case.solve()
    p, q, r, g1, g2, g3 = motion.samples.T
    A, C = float(case.A), float(case.C)
    size = 1.0 + np.abs(motion.samples).max()
    assert np.all(q == 0.0)
    assert np.abs(g1**2 + g2**2 + g3**2 - 1.0).max() <= 6 * motion.error
    assert np.abs(A * p * g1 + C * r * g3).max() <= 4 * (A + C) * size * motion.error
    # At a pole the fractional power is steep; away from it the curve holds to the claim.
    away = np.minimum(np.abs(g1), np.abs(g3)) > 1e-3
    curve = float(case.motion.lambda_) * np.abs(g1) ** (C / A)
    assert np.abs(curve - np.abs(g3))[away].max(initial=0.0) <= 1e3 * motion.error


def test_rest_in_either_hemisphere():
    case = Case(Fraction(2), Fraction(1), "-g1 + 1.2*(g1^2-g2^2)", PlanarMotion(Fraction(1)))
    north, south = (
        case.changed(motion=replace(case.motion, start=StartAtRest(sign))).solve() for sign in (1, -1)
    )
    mirrored = south.samples * np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
    # V is even in g2: g2 → −g2 turns (p, q, r) into (−p, q, −r).
    assert_same(north.samples, mirrored, north, south)
