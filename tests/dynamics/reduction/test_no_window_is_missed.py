"""Against a dense scan: every place with p² > 0 lies in a window, no place with p² < 0 does."""

from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.potentials.families.coefficients import rational_potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import make_loop
from service.dynamics.reduction.windows import find_windows
from tests.support.effort import examples
from tests.support.planar import body

pytestmark = pytest.mark.random_law

PROBLEMS = examples(50, 10_000)
BODY = body(2, 1)
# Distances to a pole: geometric where P may have power laws, equidistant elsewhere.
DISTANCES = np.concatenate([np.geomspace(1e-8, 1e-2, 200), np.linspace(1e-2, np.pi / 2, 800)[1:]])
PLACES = np.concatenate([DISTANCES, np.pi - DISTANCES[::-1]])
SINES = np.concatenate([np.sin(DISTANCES), np.sin(DISTANCES)[::-1]])
COSINES = np.concatenate([np.cos(DISTANCES), -np.cos(DISTANCES)[::-1]])
EDGE = 1e-9
"""Places this near to an end are left out: there doubles do not know the sign of P."""


def coefficients(generator: np.random.Generator, number: int) -> list[Fraction]:
    """Sizes over two decades, both signs, every second one absent."""
    drawn = [
        Fraction(int(generator.integers(-40, 41)), 10 ** int(generator.integers(0, 3))) for _ in range(number)
    ]
    return [value if generator.random() < 0.5 else Fraction(0) for value in drawn]


def test_windows_of_random_rational_potentials_agree_with_a_dense_scan():
    generator = np.random.default_rng(20)
    seen = {"none": 0, "one": 0, "several": 0}
    for _ in range(PROBLEMS):
        a, b, c = (coefficients(generator, number) for number in (3, 3, 2))
        potential = rational_potential(a, b, c)
        motion = PlanarMotion(
            Fraction(int(generator.integers(5, 30)), 10), g1_sign=1 if generator.random() < 0.5 else -1
        )
        windows = find_windows(BODY, potential, motion)
        P = make_loop(BODY, potential, motion).radicand_real(SINES, COSINES)
        inside = np.zeros(len(PLACES), dtype=bool)
        edge = np.zeros(len(PLACES), dtype=bool)
        for arc in (arc for window in windows for arc in window.arcs):
            lower, upper = float(arc.lower), float(arc.upper)
            # An arc through a pole is unrolled below 0 or beyond π.
            inside |= arc.is_whole_loop | ((lower < PLACES) & (upper > PLACES))
            edge |= (np.abs(PLACES - lower) < EDGE) | (np.abs(PLACES - upper) < EDGE)
        sure = ~edge & np.isfinite(P)
        where = f"a={a} b={b} c={c} {motion}"
        assert np.all(inside[sure & (P > 0.0)]), f"missed a window: {where}"
        assert not np.any(inside[sure & (P < 0.0)]), f"a window over forbidden places: {where}"
        seen["none" if not windows else "one" if len(windows) == 1 else "several"] += 1
    # The draw reaches every outcome often, or the test shows little.
    assert min(seen.values()) > PROBLEMS // 100, seen
