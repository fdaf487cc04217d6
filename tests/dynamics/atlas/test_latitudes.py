"""Zeros of p² that stay at one g2 for every λ: against windows that are found λ by λ."""

from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.atlas.atlas import make_atlas, with_formula
from service.dynamics.atlas.parts import LambdaRange
from service.dynamics.atlas.zeros import turns_by_latitude
from service.dynamics.errors import DynamicsError
from service.dynamics.potentials.families.written import general_potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.windows import find_windows
from service.dynamics.verdict.simple_form import simplified
from service.schemas.atlas.documents import read_atlas
from tests.support.effort import one_in
from tests.support.planar import body, formula, planar
from tests.support.solving import solve_planar

# F is constant: a simple, a double and a triple zero at the equator, zeros at the poles, double ones
# elsewhere, kinks, walls, flat zeros, edges of the formula; of all families that have such a potential.
STAYING = [
    (3, 2, "(3*g1^2+2*g3^2)*g2*(g2-2)"),
    (3, 2, "(3*g1^2+2*g3^2)*(g2^2-g2/2+1/20)"),
    (3, 2, "(3*g1^2+2*g3^2)*g2^2"),
    (2, 1, "(2*g1^2+g3^2)*g2^3*(g2-1/3)*(g2+2/3)"),
    (3, 2, "(3*g1^2+2*g3^2)*(g2-1/2)^2"),
    (3, 2, "-(3*g1^2+2*g3^2)*(g2-1/2)^2"),
    (3, 2, "(3*g1^2+2*g3^2)*(g2^2-1)"),
    (2, 3, "(2*g1^2+3*g3^2)*(g2-1)*(g2+1/2)"),
    (2, 3, "-(2*g1^2+3*g3^2)*g2^2*(g2^2-1/9)"),
    (3, 2, "(3*g1^2+2*g3^2)*abs(g2)"),
    (2, 1, "(2*g1^2+g3^2)*(abs(g2)-1/3)*g2"),
    (2, 1, "(2*g1^2+g3^2)*sin(3*g2)"),
    (2, 1, "(2*g1^2+g3^2)*(exp(-100*(g2-1/2)^2)-1/4)"),
    (2, 1, "(2*g1^2+g3^2)*exp(-1/g2^2)*g2"),
    (2, 1, "(2*g1^2+g3^2)*log(1+g2)"),
    (2, 1, "(2*g1^2+g3^2)*g2/(1-g2^2)"),
    (2, 1, "-(2*g1^2+g3^2)/(1-g2^2)^2"),
    (2, 1, {"type": "rational", "a": [], "b": [], "c": ["1/2", "-1/2"]}),
    # p² is infinite: at a pole of odd or even order, of functions, of a logarithm, at the equator.
    (2, 1, "-(2*g1^2+g3^2)/(1/2-g2)"),
    (2, 3, "-(2*g1^2+3*g3^2)*(g2+1/3)/(1/2-g2)^2"),
    (3, 2, "(3*g1^2+2*g3^2)*tan(2*g2)"),
    (2, 1, "(2*g1^2+g3^2)*log(abs(g2-1/2))"),
    (2, 1, "-(2*g1^2+g3^2)/g2^2"),
]


@pytest.mark.parametrize(("A", "C", "given"), one_in(6, STAYING), ids=str)
def test_a_zero_that_stays_is_followed(A, C, given):
    """One part over the whole range, whose windows at each λ are those that are found for it alone."""
    document = {"type": "expression", "expression": given} if isinstance(given, str) else given
    asked = read_atlas({"body": {"A": A, "C": C}, "potential": document, "lambda": ["1/50", 20]})
    atlas = make_atlas(asked.body, asked.potential, asked.range, 12)
    (part,) = atlas.parts
    assert (atlas.changes, atlas.undecided) == ((), ())
    assert (float(part.lower), float(part.upper)) == (0.02, 20.0)
    require_windows_of_single_motions(asked, part)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("A", "C", "given"),
    [
        (2, 1, "-g1-(2*g1^2+g3^2)/20/(1/2-g2)"),
        (2, 1, "-g1-(2*g1^2+g3^2)/20/(1/2-g2)^2"),
        (2, 1, "-g1-(2*g1^2+g3^2)*tan(2*g2)/10"),
        (1, 2, "-g3+(g1^2+2*g3^2)*log(abs(g2+1/3))/20"),
    ],
)
def test_a_place_where_p_squared_is_infinite_is_followed(A, C, given):
    """With an F that is not constant: the windows of the atlas end there as those of single motions do."""
    document = {"type": "expression", "expression": given}
    asked = read_atlas({"body": {"A": A, "C": C}, "potential": document, "lambda": ["1/2", 2]})
    atlas = make_atlas(asked.body, asked.potential, asked.range, 12, has_periods=False)
    assert atlas.proof == "proved"
    assert sum(float(upper - lower) for lower, upper in atlas.undecided) == 0.0
    kinds = [band.window.kind for part in atlas.parts for band in part.series.bands]
    assert "collision" in kinds
    assert "separatrix" not in kinds
    for part in atlas.parts:
        require_windows_of_single_motions(asked, part)


def require_windows_of_single_motions(asked, part):
    series = part.series
    for k in range(0, len(series.lambda_), 2):
        motion = PlanarMotion(Fraction(float(series.lambda_[k])))
        windows = find_windows(asked.body, asked.potential, motion)
        assert [(w.kind, w.ends, len(w.arcs)) for w in windows] == [
            (band.window.kind, band.window.ends, len(band.window.arcs)) for band in series.bands
        ]
        for window, band in zip(windows, series.bands, strict=True):
            for told, ends in ((band.g1, window.g1), (band.g2, window.g2)):
                for measured, end in zip(told, ends, strict=True):
                    # A window tells its ends as the nearest doubles.
                    error = float(measured.error[k]) + 2.0**-52 * abs(end)
                    assert abs(float(measured.value[k]) - end) <= error < 1e-12


def test_energy_and_periods_over_a_staying_zero():
    """V = Q G has F = 0, hence h = 0 on every curve; periods are those of single motions."""
    rigid_body, text = body(3, 2), "(3*g1^2+2*g3^2)*(g2^2-g2/2)"
    potential = formula(text, rigid_body)
    asked = read_atlas(
        {
            "body": {"A": 3, "C": 2},
            "potential": {"type": "expression", "expression": text},
            "lambda": ["1/5", 5],
        }
    )
    (part,) = make_atlas(asked.body, asked.potential, asked.range, 9).parts
    series = part.series
    (band,) = series.bands
    # From the equator, where p² has a simple zero for every λ, to g2 = 1/2.
    assert band.window.kind == "periodic"
    assert (np.abs(series.energy.value) <= series.energy.error).all()
    for k in (0, 4, 8):
        motion = PlanarMotion(Fraction(float(series.lambda_[k])))
        period = solve_planar(planar(rigid_body, potential, motion)).dense.period.hi
        assert abs(float(band.period.value[k]) - period) <= float(band.period.error[k])


def test_other_signs_are_other_quadrants():
    """|g1| - g1 is 0 where g1 > 0, and -2 g1 where g1 < 0: F is constant on one half only."""
    rigid_body = body(2, 1)
    tape = formula("abs(g1) - g1 + (2*g1^2+g3^2)*g2", rigid_body).tape
    assert turns_by_latitude(tape, 1, 1)
    assert not turns_by_latitude(tape, -1, 1)
    asked = {
        "body": {"A": 2, "C": 1},
        "potential": {"type": "expression", "expression": "abs(g1) - g1 + (2*g1^2+g3^2)*g2"},
        "lambda": [1, 2],
    }
    one, other = (read_atlas({**asked, "g1_sign": sign}) for sign in (1, -1))
    assert len(make_atlas(one.body, one.potential, one.range, 9).parts) == 1
    assert make_atlas(other.body, other.potential, other.range, 9).parts


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("(2*g1^2+g3^2)*tan(g2)", True),
        ("g1^2 + exp(g2^2)", True),
        ("(g1^4 - (1-g2^2-g3^2)^2)*g1 + pi*g2", True),
        ("g3^2/(1-g2)^2 + g2^(1/3)", True),
        ("(2*g1^2+g3^2)^2*g2", False),
        ("g1", False),
        ("g1*g3", False),
        ("1/g3^2 + (2*g1^2+g3^2)*g2", False),
        ("exp(g1^2+g3^2)*g1^2", True),
        ("exp(g1^2)*g2", False),
        ("sqrt(g1^2)*g2", False),
    ],
)
def test_what_is_recognised_is_no_more_than_what_turns_by_latitude(text, expected):
    """Where it is recognised, D/(g1 g3) is a function of g2, also by values."""
    rigid_body = body(2, 1)
    potential = formula(text, rigid_body)
    assert turns_by_latitude(potential.tape, 1, 1) is expected
    y = np.array([-0.6, 0.1, 0.7])[:, None]
    angles = np.linspace(0.1, 1.4, 7)
    root = np.sqrt(1 - y * y)
    g1, g3 = root * np.cos(angles), root * np.sin(angles)
    y = np.broadcast_to(y, g1.shape)
    found = potential.D_real(g1, y, g3) / (g1 * g3)
    if expected:
        known = ~np.isnan(found[:, 0])
        # D is the difference of terms of about its size: some roundings.
        np.testing.assert_allclose(found[known], found[known][:, :1] * np.ones(7), rtol=1e-12, atol=1e-13)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("A", "C", "F", "G"), [(3, 1, "0", "g2-1/5"), (3, 2, "-1/4", "g2^2-1/3"), (2, 3, "pi/8", "sin(g2)-1")]
)
def test_a_constant_F_has_an_atlas(A, C, F, G):
    """The formula has the values and the windows of the integral, which are found by another way."""
    rigid_body = body(A, C)
    potential = general_potential(rigid_body, F, G, {}, "pi/5")
    told = with_formula(potential)
    assert told.has_formula
    g2 = np.array([-0.7, 0.2, 0.5])
    gamma = np.stack([np.sqrt(1 - g2**2) * np.cos(0.7), g2, np.sqrt(1 - g2**2) * np.sin(0.7)], axis=-1)
    # The integral is a sum of some hundred terms of about its size.
    np.testing.assert_allclose(told.value(gamma), potential.value(gamma), rtol=1e-13, atol=1e-14)
    atlas = make_atlas(rigid_body, potential, LambdaRange(Fraction(1, 5), Fraction(5)), 9)
    (part,) = atlas.parts
    assert (atlas.changes, atlas.undecided) == ((), ())
    for k in (1, 7):
        windows = find_windows(rigid_body, potential, PlanarMotion(Fraction(float(part.series.lambda_[k]))))
        assert [(w.kind, w.ends) for w in windows] == [
            (band.window.kind, band.window.ends) for band in part.series.bands
        ]
        for window, band in zip(windows, part.series.bands, strict=True):
            for measured, end in zip(band.g1, window.g1, strict=True):
                assert abs(float(measured.value[k]) - end) <= float(measured.error[k]) + 2.0**-52
        # h = -F.
        expected = -float(Fraction(F)) if "pi" not in F else -np.pi / 8
        assert abs(part.series.energy.value[k] - expected) <= part.series.energy.error[k]


def test_an_F_that_is_not_one_constant_is_seen_as_an_integral():
    rigid_body = body(3, 1)
    texts = {"pp": "1", "mp": "2", "pm": "1", "mm": "1"}
    for F, G in (("w", "0"), (texts, "g2")):
        potential = general_potential(rigid_body, F, G, {})
        assert with_formula(simplified(potential)) is potential
    # Unless a formula is left in which no √(g1² + g3²) is.
    cancels = general_potential(body(2, 1), "-sqrt(w)/2", "-sqrt(2)/3/sqrt(1-g2^2)", {})
    assert with_formula(simplified(cancels)).has_formula


def test_a_motion_that_is_refused_is_a_part_with_a_reason():
    rigid_body, text = body(2, 1), "(2*g1^2+g3^2)*sin(1/g2)"
    potential = formula(text, rigid_body)
    with pytest.raises(DynamicsError) as refused:
        find_windows(rigid_body, potential, PlanarMotion(Fraction(1)))
    asked = read_atlas(
        {
            "body": {"A": 2, "C": 1},
            "potential": {"type": "expression", "expression": text},
            "lambda": ["1/2", 2],
        }
    )
    (part,) = make_atlas(rigid_body, potential, asked.range, 9).parts
    assert (part.series, part.reason.code) == (None, refused.value.code)
