"""The λ for which there are motions: against closed forms, and against windows found λ by λ."""

from fractions import Fraction

import pytest
from flint import arb, ctx
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from service.dynamics.potentials.families.coefficients import rational_potential
from service.dynamics.potentials.families.written import general_potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.existence import find_existence
from service.dynamics.reduction.windows import find_windows
from service.dynamics.solution.dense_output import as_decimals
from tests.support.admissible import cases
from tests.support.effort import examples
from tests.support.planar import body, formula

DOUBLE, MIRRORED = body(2, 1), body(1, 2)
ANY = PlanarMotion(Fraction(1))


def searched(rigid_body, potential, motion):
    if isinstance(potential, str):
        potential = formula(potential, rigid_body)
    return find_existence(rigid_body, potential, motion)


def is_end(ball, expected):
    return ball is not None and ball.overlaps(expected) and ball.rad() < abs(ball.mid()) * 1e-3


@pytest.mark.parametrize(
    ("rigid_body", "text", "has_motions"),
    [
        (DOUBLE, "-g1", True),
        (DOUBLE, "g1", False),
        (MIRRORED, "-g3", True),
        (MIRRORED, "g3", False),
        (body(3, 1), "(3*g1^2 + g3^2)*(g2^2 - 1/2)", True),
        (body(3, 1), "(3*g1^2 + g3^2)*(g2^2 + 1/50)", False),
        (body(3, 5), "-(3*g1^2 + 5*g3^2)*(1 + g2/2)", True),
    ],
)
def test_motions_for_every_lambda_or_for_none(rigid_body, text, has_motions):
    found = searched(rigid_body, text, ANY)
    assert [(each.lower, each.upper) for each in found.motions] == ([(None, None)] if has_motions else [])
    assert found.undecided == ()


def three_terms_border(b):
    """nu with nu² x = 2b at the equator, x = 2/(nu + √(nu² + 4)): then nu³ = 4b² /(1 − 2b/nu)·… by Newton."""
    with ctx.workprec(128):
        nu = arb(1)
        for _ in range(60):
            x = 2 / (nu + (nu * nu + 4).sqrt())
            slope = 2 * nu * x - nu * nu * x / (nu * nu + 4).sqrt()
            nu = (nu - (nu * nu * x - 2 * b) / slope).mid()
        return arb(nu, 1e-20)


def test_the_border_of_a_repelling_term_is_at_the_equator():
    """V = −g1 + b/g3² (A = 2C) has motions where nu² x > 2b at the equator."""
    nu = three_terms_border(arb(1) / 20)
    found = searched(DOUBLE, "-g1 + 1/(20*g3^2)", ANY)
    (motions,) = found.motions
    assert (found.name, found.undecided, motions.upper) == ("lambda", (), None)
    assert is_end(motions.lower, nu.sqrt())


def test_the_border_in_a_negative_nu():
    found = searched(DOUBLE, "g1 + 1/(20*g3^2)", PlanarMotion(None, nu=Fraction(-1)))
    (motions,) = found.motions
    assert (found.name, found.undecided, motions.lower) == ("nu", (), None)
    assert is_end(motions.upper, -three_terms_border(arb(1) / 20))


def test_the_border_of_a_mirrored_body():
    """Exchanged axes turn λ into λ^(−C/A): what was above the border is below it."""
    found = searched(MIRRORED, "-g3 + 1/(20*g1^2)", ANY)
    (motions,) = found.motions
    assert (found.undecided, motions.lower) == ((), None)
    # λ' = λ^(−A/C) with A/C = 1/2, and λ'² = nu.
    assert is_end(motions.upper, 1 / three_terms_border(arb(1) / 20))


def test_the_border_where_two_zeros_meet_inside():
    """V = −g1 + b/g3² + c (g1² − g2²): the parabola nu² (x − 2c x²) − 2b touches 0 for nu² = 16 b c."""
    found = searched(DOUBLE, "-g1 + 1/(20*g3^2) + 6/5*(g1^2 - g2^2)", ANY)
    (motions,) = found.motions
    assert (found.undecided, motions.upper) == ((), None)
    assert is_end(motions.lower, (arb(96) / 100).sqrt().sqrt())


def test_motions_between_two_borders():
    potential = rational_potential([Fraction(-1), Fraction(-1, 20)], [Fraction(1, 20)], [])
    (motions,) = searched(DOUBLE, potential, ANY).motions
    with ctx.workprec(64):
        ends = [Fraction(as_decimals(ball)[0]) for ball in (motions.lower, motions.upper)]
    assert ends[0] < 1 < ends[1]
    for end, outwards in ((ends[0], -1), (ends[1], 1)):
        for side in (1, -1):
            lambda_ = end * (1 + side * outwards * Fraction(1, 1000))
            assert bool(find_windows(DOUBLE, potential, PlanarMotion(lambda_))) == (side < 0)


def expiring(looks):
    """A clock that says after so many looks that it is late."""
    left = iter(range(looks))
    return lambda: next(left, None) is None


def is_inside(stretch, value):
    after = stretch.lower is None or stretch.lower < value
    before = stretch.upper is None or value < stretch.upper
    return after and before


def may_be_inside(stretch, value):
    after = stretch.lower is None or not stretch.lower > value
    before = stretch.upper is None or not value > stretch.upper
    return after and before


@given(cases(), cases(attracts=True), st.booleans(), st.data())
@settings(max_examples=examples(2, 6), deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_every_lambda_has_windows_or_none_as_was_said(case, other, attracts, data):
    case = other if attracts else case
    rigid_body = body(case.A, case.C)
    potential = formula(case.text, rigid_body)
    found = find_existence(rigid_body, potential, case.motion, expiring(150))
    around = st.integers(-60, 60).map(lambda n: Fraction(10**6, 772_681) ** n)
    ends = [ball for each in found.motions for ball in (each.lower, each.upper) if ball is not None]
    near = [Fraction(as_decimals(ball)[0]) * (1 + Fraction(n, 500)) for ball in ends[:2] for n in (1, -1)]
    for lambda_ in [*near, *(data.draw(around) for _ in range(3))]:
        value = arb(lambda_.numerator) / lambda_.denominator
        if any(may_be_inside(each, value) for each in found.undecided):
            continue
        motion = PlanarMotion(lambda_, g1_sign=case.motion.g1_sign, g3_sign=case.motion.g3_sign)
        windows = find_windows(rigid_body, potential, motion)
        if any(is_inside(each, value) for each in found.motions):
            assert windows, (case, lambda_)
        elif not any(may_be_inside(each, value) for each in found.motions):
            assert not windows, (case, lambda_)


def test_a_search_without_time_claims_nothing():
    found = find_existence(DOUBLE, formula("-g1 + 1/(20*g3^2)", DOUBLE), ANY, lambda: True)
    known = found.motions + found.undecided
    assert found.undecided
    assert any(may_be_inside(each, arb("0.586965")) for each in known)


def test_where_nothing_is_seen_nothing_is_claimed():
    """A constant potential has p² = 0 everywhere, which no bound tells from a little more."""
    found = searched(DOUBLE, "7", ANY)
    assert found.motions == ()
    assert [(each.lower, each.upper) for each in found.undecided] == [(None, None)]


def test_a_potential_without_a_formula_is_not_searched():
    potential = general_potential(body(3, 1), "w^2", "0", {})
    assert find_existence(body(3, 1), potential, ANY) is None
