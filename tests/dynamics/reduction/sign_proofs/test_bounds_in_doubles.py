"""What is said of whole stretches of a loop holds at every place; next to the border nearly all is said."""

import math
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import make_loop, start_g3_sign
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import (
    QUARTER_TURN,
    Cells,
    Loops,
    equators,
    have_no_motion,
    radicand_signs,
    shape_of,
)
from service.dynamics.reduction.windows import find_windows
from tests.support.admissible import cases
from tests.support.effort import examples
from tests.support.planar import body, formula

DOUBLE = body(2, 1)


def loops_of(rigid_body, motions):
    shape = shape_of(rigid_body, motions[0])
    logarithms = np.array([0.5 * math.log(motion.lambda_squared) for motion in motions])
    logarithms = -logarithms / float(shape.alpha) if shape.is_mirrored else logarithms
    errors = 2.0**-50 * (1.0 + np.abs(logarithms))
    return Loops(shape, *equators(shape.alpha, logarithms - errors, logarithms + errors))


@given(cases(), cases(attracts=True), st.booleans(), st.integers(0, 2**32))
@settings(max_examples=examples(13, 40), deadline=None)
def test_the_sign_of_a_stretch_is_the_sign_at_every_place(case, other, attracts, seed):
    case = other if attracts else case
    rigid_body = body(case.A, case.C)
    potential = formula(case.text, rigid_body)
    random = np.random.default_rng(seed)
    low = np.where(random.random(24) < 0.2, 0.0, 10.0 ** random.uniform(-9.0, 0.1, 24))
    high = np.minimum(np.maximum(low, 1e-3) * (1.0 + 10.0 ** random.uniform(-6.0, 0.5, 24)), QUARTER_TURN)
    cells = Cells(np.zeros(24, dtype=np.int64), random.choice([-1.0, 1.0], 24), low, high)
    found = radicand_signs(potential.tape, loops_of(rigid_body, [case.motion]), cells)
    with ctx.workprec(400):
        loop = make_loop(rigid_body, potential, case.motion)
        half = start_g3_sign(loop, case.motion)
        for k in np.flatnonzero(found):
            v = low[k] + (high[k] - low[k]) * random.uniform(1e-9, 1.0)
            sine, cosine = arb(v).sin_cos()
            P = loop.point_from(half * sine, cosine * int(cells.hemisphere[k])).P
            assert P * int(found[k]) > 0, (case, low[k], high[k], v)


@given(cases(), cases(attracts=True), st.booleans())
@settings(max_examples=examples(17, 50), deadline=None)
def test_what_has_no_motion_has_no_window(case, other, attracts):
    case = other if attracts else case
    rigid_body = body(case.A, case.C)
    potential = formula(case.text, rigid_body)
    windows = find_windows(rigid_body, potential, case.motion)
    (is_empty,) = have_no_motion(potential.tape, loops_of(rigid_body, [case.motion]))
    assert not (is_empty and windows), case


@pytest.mark.one_in(3)
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("numbers", [("1", "1"), ("7/10", "3/2"), ("1/50", "20")])
def test_the_border_of_a_closed_form_is_found_to_nine_digits(numbers, sign):
    """V = −a g1 + b/g3²: p² > 0 at x = |g1| means a nu² x > 2b, which is easiest at the equator."""
    a, nu = (Fraction(number) for number in numbers)
    equator = 2.0 / (float(nu) + math.sqrt(float(nu) ** 2 + 4.0))
    border = Fraction(float(a) * float(nu) ** 2 * equator / 2.0)
    motion = PlanarMotion(None, nu=sign * nu)
    loops = loops_of(DOUBLE, [motion])
    for power in (1, 3, 6, 9, 12, 15, 18):
        for side in (1, -1):
            b = border * (1 + side * Fraction(10) ** -power)
            potential = formula("-a*g1 + b/g3^2", DOUBLE, {"a": a * sign, "b": b})
            (is_empty,) = have_no_motion(potential.tape, loops)
            assert not (is_empty and side < 0 and power < 15)
            assert is_empty or side < 0 or power > 9


@given(
    st.sampled_from([Fraction(2), Fraction(4), Fraction(17, 10), Fraction(100001, 100000), Fraction(10**6)]),
    st.floats(-40.0, 40.0),
)
@settings(max_examples=examples(33, 100), deadline=None)
def test_the_equator_is_within_its_bounds(alpha, logarithm):
    (Z, G) = equators(alpha, np.array([logarithm]), np.array([logarithm]))
    if np.isnan(Z[0][0]):
        # Nothing is claimed where the exponent is beyond the doubles.
        assert float(alpha) * (1.0 + abs(logarithm)) > 1e4
        return
    with ctx.workprec(400):
        a = arb(alpha.numerator) / alpha.denominator
        for z, sign in ((Z[0][0], -1), (Z[1][0], 1)):
            defect = arb(z) ** 2 + ((arb(z).log() - arb(logarithm)) * 2 * a).exp() - 1
            assert defect * sign >= 0 or z == 1.0
        for g, sign in ((G[0][0], 1), (G[1][0], -1)):
            if g > 0.0:
                # As Z falls, G grows: |g3| = λ |g1|^(1/α) of a |g1| below G is below Z.
                defect = arb(g) ** 2 + ((arb(g).log() / a + arb(logarithm)) * 2).exp() - 1
                assert -defect * sign >= 0 or g == 1.0
