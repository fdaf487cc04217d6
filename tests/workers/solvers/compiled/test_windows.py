"""Arcs, their windows, and where on them a motion starts."""

import math

import numpy as np
import pytest

from workers.solvers.compiled.records import ARC, LOOP, Start, new_records
from workers.solvers.compiled.windows.arcs import (
    AUTOMATIC,
    EQUATOR,
    POINT,
    REST,
    choose_start,
    half_angle,
    number_windows,
    set_orbit,
)


def arcs_of(*ends):
    arcs = new_records(ARC, len(ends))
    for k, (lo, hi) in enumerate(ends):
        arcs[k] = lo, hi, True, True, 1.0 if lo < math.pi / 2 < hi else max(math.sin(lo), math.sin(hi)), -1
    return arcs


NORTH_AND_SOUTH = ((0.3, 0.8), (math.pi - 0.8, math.pi - 0.3))
BESIDES = (1.2, math.pi - 1.2)


@pytest.mark.parametrize("y", [-3.0, -0.1, 0.0, 0.7, 5.0])
def test_the_place_on_the_half_has_this_sine_and_cosine(y):
    v = half_angle(y)
    # v is rounded, by up to 2.2e-16 near π.
    assert math.isclose(math.sin(v), 1.0 / math.cosh(y), rel_tol=0, abs_tol=5e-16)
    assert math.isclose(math.cos(v), -math.tanh(y), rel_tol=0, abs_tol=5e-16)


def test_mirror_images_are_one_window_and_windows_grow():
    arcs = arcs_of(BESIDES, *NORTH_AND_SOUTH)
    assert number_windows(arcs, 3) == 2
    assert arcs["window"].tolist() == [1, 0, 0]


def test_images_that_nearly_mirror_each_other_are_left_open():
    north, (lo, hi) = NORTH_AND_SOUTH
    assert number_windows(arcs_of(north, (lo + 1e-9, hi)), 2) == -1


@pytest.mark.parametrize("sign", [1, -1])
def test_a_start_at_the_equator_is_there(sign):
    arcs = arcs_of(BESIDES, *NORTH_AND_SOUTH)
    number_windows(arcs, 3)
    assert choose_start(arcs, 3, 1, Start(EQUATOR, float(sign), 1.0, 0.0)) == (0, math.pi / 2, sign)
    assert choose_start(arcs, 3, 0, Start(EQUATOR, float(sign), 1.0, 0.0))[0] == -1
    assert choose_start(arcs, 3, 1, Start(AUTOMATIC, 1.0, 1.0, 0.0)) == (0, math.pi / 2, 1)


@pytest.mark.parametrize(("g2_sign", "arc"), [(1.0, 1), (-1.0, 2)])
def test_a_start_at_rest_or_at_a_point_is_on_its_hemisphere(g2_sign, arc):
    arcs = arcs_of(BESIDES, *NORTH_AND_SOUTH)
    number_windows(arcs, 3)
    chosen, at, sense = choose_start(arcs, 3, 0, Start(REST, 1.0, g2_sign, 0.0))
    assert chosen == arc
    # The rest point nearer to the equator, from which |v| can only go back.
    assert math.isclose(abs(math.cos(at)), math.cos(0.8))
    assert sense == (-1 if g2_sign > 0.0 else 1)
    chosen, at, _ = choose_start(arcs, 3, 0, Start(POINT, 1.0, g2_sign, math.sin(0.5)))
    assert chosen == arc
    assert math.isclose(math.cos(at), g2_sign * math.cos(0.5))


@pytest.mark.parametrize("half", [1.0, -1.0])
def test_an_orbit_has_the_sines_of_its_ends_and_its_middle(half):
    loop = np.zeros(1, dtype=LOOP)[0]
    set_orbit(loop, half, 0.4, math.pi - 0.4)
    assert math.isclose(loop.half_width, math.pi / 2 - 0.4)
    assert (loop.s_middle, loop.c_middle) == (half, 0.0)
    ends = {math.atan2(loop.s_lower, loop.c_lower), math.atan2(loop.s_upper, loop.c_upper)}
    assert np.allclose(sorted(ends), sorted([half * 0.4, half * (math.pi - 0.4)]), rtol=0, atol=1e-15)
