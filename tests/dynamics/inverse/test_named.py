"""Formulas with the names of parameters are true for all their values."""

from fractions import Fraction

import pytest

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parameters import bind
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.inverse.decomposition import decompose
from service.dynamics.inverse.polynomials import as_polynomial
from service.dynamics.inverse.projection import nearest_admissible
from service.dynamics.potentials.potential import Potential
from service.dynamics.verdict.verdict import decide
from service.schemas.problem.problem import read_question

SENT = {"a": "-3/2", "b": "7/5"}
OTHERS = {"a": Fraction(4, 3), "b": Fraction(-2)}
ALPHA = {2: {"A": 2, "C": 1}, 3: {"A": 3, "C": 1}, 4: {"A": 4, "C": 1}}


def question(text, alpha, parameters=SENT):
    parameters = {name: str(value) for name, value in parameters.items()}
    potential = {"type": "expression", "expression": text, "parameters": parameters}
    return read_question({"body": ALPHA[alpha], "potential": potential})


def value(text, variable, at, names):
    tape = compile_tape(bind(parse(text), names, variables=(variable,)), (variable,))
    return tape.evaluate(BallAlgebra(), [BallAlgebra().constant(at)])


def agree(named, names, plain, variable, at):
    one, other = value(named, variable, at, names), value(plain, variable, at, {})
    return one.overlaps(other) and one.rad() < 1e-9


ADMISSIBLE = [
    ("a*g1 + b/g3^2", 2),
    ("a*(g1 + b/g3^2)", 2),
    ("a^2*(g1^2 - g2^2) - g1/b", 2),
    ("(a*g2^2 + b*exp(g2))*(3*g1^2 + g3^2)", 3),
    ("-a*g1*(4*g1^2 + 3*g3^2) + b", 4),
    ("a*sqrt(g1)*(4*g1^2 + g3^2)*0 + b*(4*g1^2 + g3^2)", 4),
]


@pytest.mark.parametrize(("text", "alpha"), ADMISSIBLE)
def test_named_formulas_are_those_of_any_other_values(text, alpha):
    asked, other = question(text, alpha), question(text, alpha, OTHERS)
    body, named = asked.body, asked.named()
    found, again = decompose(body, asked.potential), decompose(body, other.potential)
    formulas = named.formulas(body, found, asked.potential)
    verdict = decide(body, other.potential)
    variable = "nu" if alpha == 2 else "lambda"
    assert formulas.energy is not None or formulas.energies is not None
    for quadrant in again.F:
        at = Fraction(5, 7)
        curve = -at if variable == "nu" and quadrant[0] == "m" else at
        h = formulas.energy or formulas.energies[quadrant]
        plain = verdict.energy_formula or verdict.energy_formulas[quadrant]
        assert agree(h, OTHERS, plain, variable, curve)
        assert agree(formulas.F[quadrant], OTHERS, again.F[quadrant], "w", at)
        assert agree(formulas.G[quadrant], OTHERS, again.G[quadrant], "g2", at)


def test_names_keep_the_form_in_which_they_were_sent():
    asked = question("a*g1 + b/g3^2", 2)
    formulas = asked.named().formulas(asked.body, None, asked.potential)
    assert formulas.energy == "-1/2*a*nu - 2*b*nu^-2"


def test_what_holds_for_these_values_only_has_no_names():
    # Admissible since the g2-terms cancel with a = b.
    asked = question("a*(g1 + g2) - b*g2", 2, {"a": 1, "b": 1})
    assert decide(asked.body, asked.potential).verdict == "admissible"
    formulas = asked.named().formulas(asked.body, None, asked.potential)
    assert (formulas.energy, formulas.energies) == (None, None)


@pytest.mark.parametrize("name", ["nu", "lambda", "w"])
def test_a_parameter_named_as_the_curve_is_not_put_in(name):
    asked = question(f"{name}*g1", 2, {name: 1})
    assert asked.named() is None


@pytest.mark.parametrize(("text", "alpha"), [("g1 + a*g3^2 + b*g1*g2", 2), ("a*b*g1^2*g2 + b*g3^2 - g1", 3)])
def test_the_nearest_potential_is_that_of_any_other_values(text, alpha):
    asked, other = question(text, alpha), question(text, alpha, OTHERS)
    nearest = nearest_admissible(asked.body, asked.potential)
    named = asked.named().nearest(asked.body, nearest, asked.potential)
    expected = nearest_admissible(other.body, other.potential).expression
    ours, theirs = (
        as_polynomial(Potential.from_tree(tree, "expression"))
        for tree in (bind(parse(named), OTHERS), parse(expected))
    )
    assert ours == theirs


STATED = [
    ({"type": "gravity", "a": -1}, ALPHA[2], "-1/2*a*nu"),
    ({"type": "rational", "a": [1, 0, 2], "b": ["1/3"]}, ALPHA[2], "-1/2*a1*nu - 3/2*a3*nu^5 - 2*b1*nu^-2"),
    ({"type": "homogeneous", "A": [5], "B": [0, 1], "C": [3]}, {"A": "5/2", "C": 1}, None),
    ({"type": "general", "F": "exp(-k*w)", "parameters": {"k": 2}}, ALPHA[2], "-exp(-k*nu^2)"),
]


@pytest.mark.parametrize(("potential", "body", "h"), STATED)
def test_every_family_has_names(potential, body, h):
    asked = read_question({"body": body, "potential": potential})
    formulas = asked.named().formulas(asked.body, None, asked.potential)
    assert formulas.energy is not None
    assert h is None or formulas.energy == h
    if potential["type"] == "homogeneous":
        assert {"B1", "C0"} <= set(formulas.energy.replace("*", " ").split())
