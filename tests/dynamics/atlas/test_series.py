"""Windows followed over λ: against windows, energies and periods that are found λ by λ in another way."""

from fractions import Fraction

import numpy as np
import pytest
from flint import arb
from hypothesis import HealthCheck, given, settings

from service.dynamics.atlas.atlas import make_atlas
from service.dynamics.atlas.parts import LambdaRange
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.windows import find_windows
from tests.support.admissible import cases
from tests.support.effort import examples
from tests.support.planar import body, formula, planar
from tests.support.solving import solve_planar

DOUBLE, MIRRORED = body(2, 1), body(1, 2)


def drawn(rigid_body, text, lower, upper, samples=12, **signs):
    return make_atlas(
        rigid_body, formula(text, rigid_body), LambdaRange(Fraction(lower), Fraction(upper), **signs), samples
    )


def is_within(measured, k, expected):
    value, error = float(measured.value[k]), float(measured.error[k])
    return bool(np.isnan(value)) or abs(value - expected) <= error


def test_the_energy_of_a_linear_potential():
    """V = a g1, A = 2C: h = -a λ²/2 (theory 3: a1 -> -a1 ν/2)."""
    (part,) = drawn(DOUBLE, "-g1", "1/10", 10, 40).parts
    series = part.series
    expected = series.lambda_**2 / 2
    # λ is told as a double: h is off by as many of its roundings.
    assert (np.abs(series.energy.value - expected) <= series.energy.error + 4e-16 * expected).all()
    assert (series.energy.error < 1e-11 * (1 + expected)).all()


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("rigid_body", "text", "lower", "upper"),
    [
        (DOUBLE, "-g1", "1/2", 2),
        (DOUBLE, "-g1 + 1/(20*g3^2)", "3/5", 2),
        (DOUBLE, "-g1 + 1/(20*g3^2) + 3/2*(g1^2-g2^2)", "11/10", "8/5"),
        (MIRRORED, "-g3 + 1/(20*g1^2)", "3/10", 2),
        (body(3, 2), "(3*g1^2+2*g3^2)*g2^2 - 1", "1/2", 2),
        (DOUBLE, "-g1 + (2*g1^2+g3^2)*2*exp(-100*(g2-3/10)^2)", "1/2", "3/2"),
    ],
)
def test_ends_energies_and_periods_are_those_of_single_motions(rigid_body, text, lower, upper):
    potential = formula(text, rigid_body)
    for part in drawn(rigid_body, text, lower, upper).parts:
        series = part.series
        for k in range(1, len(series.lambda_), 4):
            lambda_ = Fraction(float(series.lambda_[k]))
            windows = find_windows(rigid_body, potential, PlanarMotion(lambda_))
            assert [w.kind for w in windows] == [band.window.kind for band in series.bands]
            for window, band in zip(windows, series.bands, strict=True):
                assert window.ends == band.window.ends
                for side in (0, 1):
                    assert is_within(band.g1[side], k, window.g1[side])
                    assert is_within(band.g2[side], k, window.g2[side])
                if window.kind == "periodic":
                    motion = PlanarMotion(lambda_, window=window.index)
                    solved = solve_planar(planar(rigid_body, potential, motion))
                    assert is_within(band.period, k, solved.dense.period.hi)
                    assert is_within(series.energy, k, solved.energy.value)


@pytest.mark.random_law
@given(cases())
@settings(max_examples=examples(4, 40), deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_windows_are_those_of_single_motions(case):
    """At the λ of a random admissible motion, and beside it, the atlas has its windows, or is undecided."""
    rigid_body, own = body(case.A, case.C), case.motion
    squared = own.lambda_squared
    centre = Fraction(float(squared) ** 0.5)
    potential = formula(case.text, rigid_body)
    over = LambdaRange(centre * Fraction(2, 3), centre * Fraction(3, 2), own.sign_of_g1, own.g3_sign)
    atlas = make_atlas(rigid_body, potential, over, 9)
    for lambda_ in (centre, centre * Fraction(7, 10), centre * Fraction(14, 10)):
        value = arb(lambda_.numerator) / lambda_.denominator
        part = next((each for each in atlas.parts if each.lower < value < each.upper), None)
        if part is None or part.series is None:
            continue
        motion = PlanarMotion(lambda_, g1_sign=own.sign_of_g1, g3_sign=own.g3_sign)
        windows = find_windows(rigid_body, potential, motion)
        assert sorted((w.kind, w.ends) for w in windows) == sorted(
            (band.window.kind, band.window.ends) for band in part.series.bands
        )
