"""Integrals and invariant relations: the theory sheet's are proved, each perturbed one is refuted."""

from fractions import Fraction

import pytest
import sympy as sp
from flint import arb, ctx

from service.dynamics.discovery.judgement import judge_integral, judge_relation
from service.dynamics.discovery.setting import (
    EmptyRelationsError,
    FunctionTooLargeError,
    UndefinedFunctionError,
    read_setting,
)
from service.dynamics.errors import FormulaError, ImpossibleInertiaError, UnknownNameError
from service.dynamics.formula.algebras.symbolic import SymbolicAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape

FREE = None
KOVALEVSKAYA = "(p^2 - q^2 - (a*g1 - b*g2)/C)^2 + (2*p*q - (a*g2 + b*g1)/C)^2"
GORIACHEV = (
    "(p^2 - q^2 - (a*g1 - b*g2)/C + c1*g3^2/C - b1*(g1^2 - g2^2)/(C*g3^2))^2"
    " + (2*p*q - (a*g2 + b*g1)/C + c2*g3^2/C - 2*b1*g1*g2/(C*g3^2))^2"
)
TWICE, FOUR_TIMES = {"A": "2*C", "B": "2*C"}, {"A": "4*C", "B": "4*C"}
FIELD = "a*g1 + b*g2 + c1*(g1^2 - g2^2) + 2*c2*g1*g2 + b1/g3^2"
ENERGY = "(A*p^2 + B*q^2 + C*r^2)/2"

INTEGRALS = [
    # moments, field, its free numbers, integral, its level, its name
    ({}, "a*g1*g2", "a", f"{ENERGY} + a*g1*g2", "always", "energy"),
    ({}, "a*g1*g2", "a", "A*p*g1 + B*q*g2 + C*r*g3", "always", "areas"),
    ({}, "0", "", "A^2*p^2 + B^2*q^2 + C^2*r^2", "always", "euler"),
    ({"B": "A"}, "exp(g3)", "", "r", "always", "lagrange"),
    ({"A": "C", "B": "C"}, "a*g1 + b*g2 + c*g3", "abc", "a*p + b*q + c*r", "always", "spherical"),
    (
        {},
        "m*(A*g1^2 + B*g2^2 + C*g3^2)/2",
        "m",
        "A^2*p^2 + B^2*q^2 + C^2*r^2 - m*(B*C*g1^2 + C*A*g2^2 + A*B*g3^2)",
        "always",
        "brun",
    ),
    (TWICE, "a*g1 + b*g2", "ab", KOVALEVSKAYA, "always", "kovalevskaya"),
    (
        TWICE,
        "c1*(g1^2 - g2^2) + 2*c2*g1*g2",
        ["c1", "c2"],
        "(p^2 - q^2 + c1*g3^2/C)^2 + (2*p*q + c2*g3^2/C)^2",
        "zero_areas",
        "chaplygin",
    ),
    (TWICE, FIELD, ["a", "b", "c1", "c2", "b1"], GORIACHEV, "zero_areas", "goriachev"),
    (
        FOUR_TIMES,
        "a*g1 + b*g2 + b1/g3^2",
        ["a", "b", "b1"],
        "r*(p^2 + q^2 + b1/(2*C*g3^2)) - g3*(a*p + b*q)/C",
        "zero_areas",
        "goriachev_chaplygin",
    ),
]


def judged(moments, field, free, function, **asked):
    return judge_integral(read_setting(moments, field, dict.fromkeys(free)), function, **asked)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(("moments", "field", "free", "integral", "level", "name"), INTEGRALS)
def test_integrals_of_the_literature_are_proved_and_named_and_perturbed_ones_refuted(
    moments, field, free, integral, level, name
):
    found = judged(moments, field, free, integral)
    assert (found.verdict, found.proof, found.holds, found.name) == ("integral", "symbolic", level, name)
    assert found.independent is (name not in ("energy", "areas"))
    assert (found.counterexample is None) is (level == "always")
    # A part in 10^30 more, by a function that is no integral anywhere.
    perturbed = judged(moments, field, free, f"{integral} + p*g1*g2/10^30", areas_zero=True)
    assert (perturbed.verdict, perturbed.proof) == ("not_integral", "counterexample")


def test_a_counterexample_is_an_exact_state_of_the_level_and_its_rate_is_enclosed():
    found = judged(TWICE, FIELD, ["a", "b", "c1", "c2", "b1"], f"({GORIACHEV})^2*g1", areas_zero=True)
    state = found.counterexample
    assert state.radius is None
    p, q, r, g1, g2, g3 = (sp.Rational(each) for each in (*state.omega, *state.gamma))
    assert g1**2 + g2**2 + g3**2 == 1
    assert 2 * p * g1 + 2 * q * g2 + r * g3 == 0
    # The rate once more, by SymPy, exactly.
    names = sp.symbols("p q r g1 g2 g3 C a b c1 c2 b1")
    texts = [str(name) for name in names]
    function, potential = (
        compile_tape(parse(text), texts).evaluate(SymbolicAlgebra(), names)
        for text in (f"({GORIACHEV})^2*g1", FIELD)
    )
    C = names[6]
    V1, V2, V3 = (sp.diff(potential, name) for name in names[3:6])
    P, Q, R, G1, G2, G3 = names[:6]
    rates = (
        (C * Q * R + G2 * V3 - G3 * V2) / (2 * C),
        (-C * P * R + G3 * V1 - G1 * V3) / (2 * C),
        (G1 * V2 - G2 * V1) / C,
        R * G2 - Q * G3,
        P * G3 - R * G1,
        Q * G1 - P * G2,
    )
    letters = {name: sp.Rational(value) for name, value in state.letters.items()}
    values = dict(zip(names[:6], (p, q, r, g1, g2, g3), strict=True))
    rate = sum(sp.diff(function, name) * each for name, each in zip(names, rates, strict=False))
    exact = rate.subs({sp.Symbol(k): v for k, v in letters.items()} | values)
    assert exact.is_rational
    assert abs(Fraction(int(exact.p), int(exact.q)) - Fraction(state.rate.mid)) <= Fraction(state.rate.rad)


def test_functions_of_integrals_are_dependent_with_the_equation_between_them():
    found = judged({}, "a*g1", "a", f"(({ENERGY} + a*g1)^2 + A*p*g1 + B*q*g2 + C*r*g3)*3")
    assert (found.verdict, found.independent, found.dependence) == ("integral", False, "I - 3*H^2 - 3*I3")


def test_functions_that_are_no_rational_ones_are_judged_too():
    field = "abs(g1)^(3/2) + sin(g2)*tan(g3) + sqrt(2 + g1)"
    assert judged({}, field, "", f"exp({ENERGY} + {field})").holds == "always"
    assert judged({}, field, "", f"exp({ENERGY} + {field} + g1/10^9)").verdict == "not_integral"
    # cos 2x = cos² x - sin² x, which no relation that is used says: neither proved nor refuted.
    undecided = judged({}, "a*g1", "a", "cos(2*g1) - cos(g1)^2 + sin(g1)^2")
    assert (undecided.verdict, undecided.proof) == ("undecided", None)


def test_integrals_on_relations_are_those_of_the_motions_that_keep_them_for_ever():
    # Planar motions of bodies with A = 2C, whatever B (theory, section 6): K and the curve g3² = ν g1.
    asked = {"areas_zero": True, "relations": ["q"]}
    field, free = "a*g1 + c1*(g1^2 - g2^2) + b1/g3^2", ["a", "c1", "b1"]
    K = GORIACHEV.replace("b*g2", "0").replace("b*g1", "0").replace("c2", "0")
    for function in (K, "g3^2/g1"):
        found = judged({"A": "2*C"}, field, free, function, **asked)
        assert (found.verdict, found.holds) == ("integral", "relations")
        assert "g3" in found.except_where
    # p is constant in the case of Bobylev and Steklov (1.4), and with c1 it is not.
    assert judged({"A": "2*C"}, "a*g1", "a", "p", **asked).holds == "relations"
    assert judged({"A": "2*C"}, field, free, "p", **asked).verdict == "not_integral"


def test_relations_that_no_motion_keeps_are_refused():
    with pytest.raises(EmptyRelationsError) as refused:
        judged({"A": "3*C"}, "a*g1", "a", "p", relations=["g1 - 1/2", "g2", "p - 1"])
    assert refused.value.pointer == "/relations"


def test_the_relation_of_Hess_is_invariant_with_its_multiplier():
    # f = A a p + C c r with A a² (B - C) = C c² (A - B): f' = c (A - B)/(A a) q f. Here a = c = 1.
    moments = {"A": Fraction(3), "B": Fraction(2), "C": Fraction(3, 2)}
    hess = judge_relation(read_setting(moments, "g1 + g3"), "A*p + C*r")
    assert (hess.verdict, hess.holds, hess.multiplier) == ("invariant_relation", "always", "q/3")
    other = judge_relation(read_setting({**moments, "C": Fraction(1)}, "g1 + g3"), "A*p + C*r")
    assert (other.verdict, other.proof) == ("not_invariant", "counterexample")


def test_a_square_is_judged_by_its_root_however_long_that_is_written():
    # A = B = C without a field: all three are constant, and so is what is made of them.
    free = read_setting({"A": Fraction(1), "B": Fraction(1), "C": Fraction(1)}, "0")
    root = " + ".join(f"{n}*(p + {n}*q + r/{n} + 1)^{n}" for n in range(1, 9))
    (found, square) = (judge_relation(free, f"({root})^{power}") for power in (1, 2))
    assert (square.verdict, square.holds) == (found.verdict, found.holds) == ("invariant_relation", "always")
    assert square.multiplier == "0"


def test_the_planar_relation_needs_the_zero_level_and_more():
    setting = read_setting({"A": "2*C"}, "a*g1", {"a": FREE})
    assert judge_relation(setting, "q", areas_zero=True).verdict == "not_invariant"
    lagrange = read_setting({"B": "A"}, "a*g3", {"a": FREE})
    assert judge_relation(lagrange, "r").multiplier == "0"


@pytest.mark.parametrize(
    ("moments", "field", "function", "error", "pointer"),
    [
        ({"A": Fraction(-1)}, "g1", "p", ImpossibleInertiaError, "/body/A"),
        ({"A": "B", "B": "A"}, "g1", "p", FormulaError, "/body/A"),
        ({"A": "2*D"}, "g1", "p", UnknownNameError, "/body/A"),
        ({}, "p*g1", "p", UnknownNameError, "/potential/expression"),
        ({}, "g1", "p + s", UnknownNameError, "/function"),
        ({}, "g1", "1/(g1^2 + g2^2 + g3^2 - 1)", UndefinedFunctionError, "/function"),
        ({}, "g1", "sqrt(g1 - 2)*p", UndefinedFunctionError, "/function"),
    ],
)
def test_what_cannot_be_asked_is_refused_where_it_stands(moments, field, function, error, pointer):
    with pytest.raises(error) as refused:
        judge_integral(read_setting(moments, field), function)
    assert refused.value.pointer == pointer


@pytest.mark.parametrize(
    ("moments", "power"), [({"A": Fraction(2), "B": Fraction(3, 2), "C": Fraction(1)}, 20), ({}, 12)]
)
def test_the_dependence_of_a_high_power_of_the_energy_is_found_among_hundreds_of_products(moments, power):
    found = judged(moments, "-g1", "", f"({ENERGY} - g1)^{power}")
    assert (found.verdict, found.independent) == ("integral", False)
    assert found.dependence in (f"I - H^{power}", f"-I + H^{power}")


LARGE = "(p + q + r + g1 + g2 + g3 + 1)"


@pytest.mark.parametrize(
    ("moments", "field", "function", "relations"),
    [
        ({}, "-g1", f"({ENERGY} - g1)^200", []),
        ({}, "-g1", "p", [f"{LARGE}^4", f"{LARGE}^3 - p*q*r"]),
        ({}, "(g1 + g2 + g3 + 1)^30", "p", ["q"]),
    ],
)
def test_what_is_too_large_for_a_proof_is_undecided(moments, field, function, relations):
    found = judged(moments, field, "", function, relations=relations)
    assert (found.verdict, found.proof, found.independent) == ("undecided", None, None)


@pytest.mark.parametrize(
    ("moments", "field", "function", "relations", "error", "pointer"),
    [
        ({}, "g1", "p", ["q", f"{LARGE}^40"], FunctionTooLargeError, "/relations/1"),
        ({}, "g1", "p", ["1/(g1^2 + g2^2 + g3^2 - 1)"], UndefinedFunctionError, "/relations/0"),
        ({}, "1/(g1^2 + g2^2 + g3^2 - 1)", "p", [], UndefinedFunctionError, "/potential/expression"),
        ({"A": "B/(C - C)"}, "g1", "p", [], UndefinedFunctionError, "/body/A"),
        ({"A": "exp(B)"}, "g1", "p", [], FormulaError, "/body/A"),
        ({"A": "-B - C^2"}, "g1", "p", [], ImpossibleInertiaError, "/body/A"),
    ],
)
def test_a_fault_of_a_part_is_told_at_that_part(moments, field, function, relations, error, pointer):
    with pytest.raises(error) as refused:
        judge_integral(read_setting(moments, field), function, relations=relations)
    assert refused.value.pointer == pointer


def test_a_relation_that_is_too_large_or_empty_is_refused_as_the_function_that_it_is():
    for function, error in ((f"{LARGE}^40", FunctionTooLargeError), ("1", EmptyRelationsError)):
        with pytest.raises(error) as refused:
            judge_relation(read_setting({}, "g1"), function)
        assert refused.value.pointer == "/function"


def test_a_power_of_a_relation_is_the_relation_with_as_many_times_its_multiplier():
    # (f²)' = 2 f f' = 2 μ f². The derivative of p² is 0 where p is, though motions do not keep p = 0.
    setting = read_setting({"A": Fraction(3), "B": Fraction(2), "C": Fraction(3, 2)}, "g1 + g3")
    assert judge_relation(setting, "(A*p + C*r)^2").multiplier == "2*q/3"
    assert judge_relation(setting, "p^2").verdict == "not_invariant"
    assert judge_relation(setting, "(p + q)^9").verdict == "not_invariant"


def test_pi_in_a_moment_or_a_relation_is_the_number():
    free = read_setting({"A": Fraction(2), "B": Fraction(2), "C": Fraction(1)}, "0")
    on_relation = judge_integral(free, "g2", relations=["r - pi"]).counterexample
    other = read_setting({"A": "pi*C", "B": Fraction(2), "C": Fraction(1)}, "g1")
    on_level = judge_integral(other, "p", areas_zero=True).counterexample
    with ctx.workprec(128):
        assert (arb(on_relation.omega[2], on_relation.radius) - arb.pi()).contains(0)
        p, q, r, g1, g2, g3 = (arb(x, on_level.radius) for x in (*on_level.omega, *on_level.gamma))
        areas = arb.pi() * p * g1 + 2 * q * g2 + r * g3
        assert areas.contains(0)
        # Enclosures at 128 bits, printed with 25 digits.
        assert areas.rad() < 1e-20
