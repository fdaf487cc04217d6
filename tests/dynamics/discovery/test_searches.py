"""Searches of integrals and potentials: what is known comes out, nothing is missed, all of it is proved."""

from fractions import Fraction
from itertools import product

import pytest
from flint import Ordering, fmpz_mat, fmpz_mpoly_ctx
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.body import RigidBody
from service.dynamics.discovery.integral_search import NormalForms, search_integrals
from service.dynamics.discovery.judgement import judge_integral
from service.dynamics.discovery.potential_search import ratios_that_admit, search_potentials
from service.dynamics.discovery.setting import (
    FunctionTooLargeError,
    NotPolynomialError,
    SearchTooLargeError,
    UndefinedFunctionError,
    read_setting,
)
from service.dynamics.discovery.strata import Letters, kernel, special_strata
from service.dynamics.errors import EqualMomentsError
from service.dynamics.inverse.projection import admissible_space
from service.dynamics.potentials.families.written import expression_potential
from service.dynamics.verdict.verdict import decide
from tests.support.effort import examples


def body(A, B, C):
    return {"A": Fraction(A), "B": Fraction(B), "C": Fraction(C)}


def names(found):
    return [each.name for each in found]


def rises_to_one(told):
    """Whether what a search told of its progress rises, in more than a few steps, and ends at 1."""
    return len(told) > 10 and told == sorted(told) and told[0] > 0.0 and told[-1] == pytest.approx(1.0)


def cases(found):
    return {frozenset(each.conditions): names(each.integrals) for each in found.special}


# --- integrals ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("moments", "field", "degrees", "areas_zero", "name"),
    [
        (body(2, 2, 1), "-g1 + g2/3", (4, 2), False, "kovalevskaya"),
        (body(4, 4, 1), "-g1 + g2/3", (3, 1), True, "goriachev_chaplygin"),
        (body(2, 2, 1), "g1^2 - g2^2 + g1*g2", (4, 4), True, "chaplygin"),
        (body(3, 2, 1), "3*g1^2 + 2*g2^2 + g3^2", (2, 2), False, "brun"),
    ],
)
def test_integrals_of_the_literature_are_found_from_their_degree_alone(
    moments, field, degrees, areas_zero, name
):
    setting = read_setting(moments, field)
    found = search_integrals(setting, *degrees, areas_zero=areas_zero)
    assert names(found.integrals) == [name]
    assert not found.special
    judged = judge_integral(setting, found.integrals[0].expression, areas_zero=areas_zero)
    assert (judged.verdict, judged.holds) == ("integral", "zero_areas" if areas_zero else "always")
    # One degree less has nothing.
    assert not search_integrals(setting, degrees[0] - 1, degrees[1], areas_zero=areas_zero).integrals


def test_integrals_without_a_name_are_integrals():
    # Neumann's problem, A = B = C and V = v1 g1² + v2 g2² + v3 g3²: a quadratic integral.
    setting = read_setting(body(1, 1, 1), "g1^2 + 2*g2^2 + 4*g3^2")
    found = search_integrals(setting, 2, 2)
    assert len(found.integrals) == 1
    judged = judge_integral(setting, found.integrals[0].expression)
    assert (judged.verdict, judged.holds, judged.independent) == ("integral", "always", True)


def test_all_moments_at_which_a_heavy_body_has_a_cubic_integral_on_the_zero_level():
    # Letters A, B, C and a. By a theorem (Husson 1906 in general) there are no others than these.
    told: list[float] = []
    setting = read_setting({}, "a*g1", {"a": None})
    found = search_integrals(setting, 3, 1, areas_zero=True, tell=told.append)
    assert rises_to_one(told)
    assert found.is_complete
    assert not found.integrals
    assert cases(found) == {
        frozenset(["B - C"]): ["lagrange"],
        frozenset(["a"]): ["euler"],
        frozenset(["A - C", "A - 4*B"]): ["goriachev_chaplygin"],
        frozenset(["A - 4*C", "A - B"]): ["goriachev_chaplygin"],
        frozenset(["a", "A - C", "A - B"]): ["lagrange", "lagrange"],
    }


@pytest.mark.long
def test_all_moments_at_which_a_heavy_body_has_a_quartic_integral():
    found = search_integrals(read_setting({}, "a*g1", {"a": None}), 4, 2)
    assert found.is_complete
    assert cases(found) == {
        frozenset(["B - C"]): ["lagrange"],
        frozenset(["a"]): ["euler"],
        frozenset(["A - C", "A - 2*B"]): ["kovalevskaya"],
        frozenset(["A - 2*C", "A - B"]): ["kovalevskaya"],
        frozenset(["a", "A - C", "A - B"]): ["lagrange", "lagrange"],
    }


def test_normal_forms_on_the_zero_level_are_those_of_a_groebner_basis():
    # All critical pairs of the three relations lead to the same form: each overlap is reduced either way.
    forms = NormalForms(has_zero_areas=True)
    overlaps = [(0, 0, 1, 0, 0, 2), (0, 0, 1, 2, 0, 1), (0, 0, 1, 2, 0, 2), (1, 1, 2, 3, 1, 3)]
    ring = fmpz_mpoly_ctx.get(["m1", "m2", "m3", "g1", "g2", "g3"], Ordering.lex)
    for monomial in overlaps:
        whole = ring.from_dict({monomial: 1}) - ring.from_dict(forms.of(monomial))
        # On the level m3 = -(m1 g1 + m2 g2)/g3, and then on the sphere, the difference is 0.
        m1, m2, _, g1, g2, g3 = ring.gens()
        top = int(whole.degrees()[2])
        total = ring.constant(0)
        for exponents, value in whole.terms():
            a, b, c, i, j, k = (int(each) for each in exponents)
            rest = ring.from_dict({(a, b, 0, i, j, k + top - c): int(value)})
            total += rest * (-(m1 * g1 + m2 * g2)) ** c
        assert not divmod(total, g1**2 + g2**2 + g3**2 - 1)[1]
        assert all(forms.is_normal(each) for each in forms.of(monomial))


@pytest.mark.parametrize(
    ("field", "degrees", "error", "pointer"),
    [
        ("1/g3^2", (2, 2), NotPolynomialError, "/potential/expression"),
        ("sqrt(g1)", (2, 2), NotPolynomialError, "/potential/expression"),
        ("g1", (12, 12), SearchTooLargeError, "/degree"),
        ("(g1 + g2 + g3 + 1)^200", (2, 2), FunctionTooLargeError, "/potential/expression"),
        ("1/(g1^2 + g2^2 + g3^2 - 1)", (2, 2), UndefinedFunctionError, "/potential/expression"),
    ],
)
def test_searches_that_cannot_be_made_are_refused(field, degrees, error, pointer):
    with pytest.raises(error) as refused:
        search_integrals(read_setting(body(2, 2, 1), field), *degrees)
    assert refused.value.pointer == pointer


# --- potentials -------------------------------------------------------------------------------


def test_polynomials_with_planar_motions_up_to_degree_8_are_those_of_the_theory_and_no_others():
    # Theory 5.2, found there by ranks for some ratios: here for all of them at once.
    told: list[float] = []
    found = search_potentials(None, 8, tell=told.append)
    assert rises_to_one(told)
    assert found.dimension == 8
    further = {Fraction(2 * n): 2 * n - 1 for n in (1, 2, 3, 4)}
    assert {each.ratio for each in found.ratios} == {*further, *(1 / each for each in further)}
    assert all((each.dimension, len(each.potentials)) == (9, 1) for each in found.ratios)
    for each in found.ratios:
        ratio = each.ratio
        assert admissible_space(ratio, 8).dimension == each.dimension
        made = expression_potential(each.potentials[0], {}, RigidBody(ratio, None, Fraction(1)))
        assert decide(RigidBody(ratio, None, Fraction(1)), made).verdict == "admissible"


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6])
def test_the_ratio_of_each_polynomial_of_the_paper_is_found(n):
    # B_m of section 4.3 with α = 2n and m = n - 1, by the recurrence of 2F1 in v = 1 + g3²/g1²:
    # Σ c_j g1^(2n-1-2j) (g1² + g3²)^j.
    m, alpha = n - 1, Fraction(2 * n)
    b, c = -(alpha - 1) * (m + 1) / alpha, 1 - m + (m + 1) / alpha
    coefficients, terms = Fraction(1), []
    for j in range(m + 1):
        terms.append(f"({coefficients})*g1^{2 * n - 1 - 2 * j}*(g1^2 + g3^2)^{j}")
        coefficients *= (j - m) * (b + j) / ((c + j) * (j + 1))
    text = " + ".join(terms)
    found = ratios_that_admit(text, {})
    assert (found.all, found.ratios) == (False, (alpha,))


def test_ratios_of_a_formula_with_moments_in_it():
    assert ratios_that_admit("(A*g1^2 + C*g3^2)*g2^3 + 7", {}, C=Fraction(3, 2)).all
    assert ratios_that_admit("(3*g1^2 + C*g3^2)*g2", {}, C=Fraction(2)).ratios == (Fraction(3, 2),)
    assert ratios_that_admit("a*g1 + g2^2*g1", {"a": Fraction(1)}).ratios == ()
    # (A² - 2) V + admissible: only A = √2 C, which is no ratio of integers.
    irrational = ratios_that_admit("(A^2 - 2)*g1*g2", {})
    assert irrational.ratios == ()
    assert irrational.others == ("A^2 - 2",)


def test_potential_searches_that_cannot_be_made_are_refused():
    with pytest.raises(EqualMomentsError):
        search_potentials(Fraction(1), 3)
    with pytest.raises(SearchTooLargeError):
        search_potentials(None, 99)
    with pytest.raises(NotPolynomialError):
        ratios_that_admit("sqrt(g1)", {})
    with pytest.raises(FunctionTooLargeError):
        ratios_that_admit("(g1 + g2 + g3 + 1)^200", {})


# --- kernels with letters -----------------------------------------------------------------------


def test_no_value_at_which_the_rank_drops_is_missed():
    # A matrix whose minors are known: rank 2 but on x = 0, on y = 2, where z = x² (not linear: z is solved
    # for), and on x² + y² = 0, which has the one real zero (0, 0).
    ring = fmpz_mpoly_ctx.get(["x", "y", "z"], Ordering.lex)
    x, y, z = ring.gens()
    letters = Letters(ring, frozenset())
    rows = [{0: x * (y - 2)}, {1: (z - x**2) * (x**2 + y**2)}]
    found = {tuple(map(str, each.equations())) for each in special_strata(rows, letters)}
    assert {("x",), ("y - 2",), ("x^2 - z",)} <= found
    assert len(kernel(rows, 2, letters)) == 0
    assert len(kernel([{0: x, 1: y}], 2, letters)) == 1


COEFFICIENTS = st.integers(-2, 2)


@given(st.lists(st.lists(st.tuples(*[COEFFICIENTS] * 3), min_size=3, max_size=3), min_size=3, max_size=3))
@settings(max_examples=examples(10, 500), deadline=None)
def test_every_point_at_which_a_rank_drops_is_on_a_stratum(entries):
    # Linear forms x, y, 1 in 3 rows and columns; the rank by flint at all points of a grid.
    ring = fmpz_mpoly_ctx.get(["x", "y"], Ordering.lex)
    x, y = ring.gens()
    letters = Letters(ring, frozenset())
    matrix = [[a * x + b * y + c for a, b, c in row] for row in entries]
    rows = [{k: entry for k, entry in enumerate(row) if entry} for row in matrix]
    strata = [each.equations() for each in special_strata(rows, letters)]
    usual = 3 - len(kernel(rows, 3, letters))
    for place in product(range(-3, 4), repeat=2):
        rank = fmpz_mat([[entry(*place) for entry in row] for row in matrix]).rank()
        assert rank <= usual
        assert rank == usual or any(all(each(*place) == 0 for each in found) for found in strata)


def test_a_positive_letter_is_never_replaced_by_what_is_not():
    ring = fmpz_mpoly_ctx.get(["A", "C"], Ordering.lex)
    A, C = ring.gens()
    letters = Letters(ring, frozenset({0, 1}))
    rows = [{0: (A + C) * (A - 2 * C) * (A**2 + A * C)}]
    assert [list(map(str, each.equations())) for each in special_strata(rows, letters)] == [["A - 2*C"]]
