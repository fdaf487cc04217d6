"""One proof for all potentials of a sweep."""

import math
from fractions import Fraction

import numpy as np
import pytest
from flint import fmpq

from service.dynamics.body import RigidBody
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.problem import PlanarMotion
from service.dynamics.verdict.verdict import decide
from service.schemas.problem.trusted import potential_of
from service.schemas.reading.documents import with_values
from workers.solvers.compiled.evaluation.program import make_program
from workers.sweeping.parameters.family import (
    degree_in,
    energies_of,
    prove_family,
    smooth_poles,
)
from workers.sweeping.parameters.models import model_of
from workers.sweeping.parameters.templates import MomentsOfPoint, Templates

BODY = RigidBody(Fraction(2), Fraction(3, 2), Fraction(1))
OTHER = RigidBody(Fraction(17, 10), None, Fraction(1))
A, B = ("parameters", "a"), ("parameters", "b")


def expression(text, **parameters):
    return {"type": "expression", "expression": text, "parameters": parameters}


@pytest.mark.parametrize(
    ("text", "degree"),
    [
        ("g1 + 2", 0),
        ("a*g1", 1),
        ("-(a + b)*g1/3 + b", 1),
        ("(a/2)*(g1 - g2)", 1),
        ("a*b", 2),
        ("a^2", 2),
        ("g1^a", 2),
        ("1/a", 2),
        ("sqrt(a)*g1", 2),
        ("abs(a)", 2),
    ],
)
def test_the_degree_in_parameters_is_seen_in_the_formula(text, degree):
    assert degree_in(parse(text), {"a", "b"}) == degree


@pytest.mark.parametrize(
    ("body", "document", "paths"),
    [
        (BODY, expression("a*g1 + b/g3^2", a=1, b=1), (A, B)),
        (BODY, expression("-g1 + (a+b)*(g1^2-g2^2)", a=1, b=1), (A, B)),
        (BODY, {"type": "rational", "a": [1], "b": [1, 1]}, (("a", "0"), ("b", "1"))),
        (OTHER, {"type": "homogeneous", "A": [0, 1], "C": [1]}, (("A", "1"), ("C", "0"))),
    ],
)
def test_members_of_a_proved_family_are_admissible(body, document, paths):
    assert prove_family(body, document, paths) is not None
    for numbers in (("1/3", "-7/5"), ("0", "11/2"), ("-1", "1")):
        member = with_values(document, dict(zip(paths, numbers, strict=True)))
        assert decide(body, potential_of(member, body)).verdict == "admissible"


@pytest.mark.parametrize(
    ("document", "paths"),
    [
        (expression("a*g1 + b*g3", a=1, b=0), (A, B)),
        (expression("g3 + a*g1", a=1), (A,)),
        (expression("a^2*g1", a=1), (A,)),
        # Admissible for a = 0 and a = 1, where a vertex would be looked at.
        (expression("g1 + a*(a-1)*g3", a=1), (A,)),
        ({"type": "gravity", "a": 1, "c": 0}, (("c",),)),
        ({"type": "general", "F": "a*w", "G": "0", "parameters": {"a": 1}}, (A,)),
        (expression("a*log(-1-g1^2)", a=1), (A,)),
    ],
)
def test_what_is_not_admissible_for_all_numbers_is_not_proved(document, paths):
    assert prove_family(BODY, document, paths) is None


def test_constants_are_those_of_the_formula_compiled_alone():
    document = expression("a*g1/3 - 2*(b + 1/7)/(-g3^2)/20 + sqrt(2)*(a-b)*g1", a=1, b=1)
    numbers = (fmpq(1, 3), fmpq(2, 7)), (fmpq(-13, 10), fmpq(1, 100))
    for found, member in (constants_at(document, a, b) for a, b in numbers):
        alone, constants = make_program(member.tape)
        assert found.template.varying
        assert alone.key == found.template.program.key
        assert np.array_equal(found.row, constants)


@pytest.mark.parametrize(("a", "b"), [(0, 2), (1, 2), (-1, 2), (2, 2), (5, 2), (3, 2), (3, "5/2")])
def test_numbers_that_change_the_program_are_seen(a, b):
    document = expression("a*g1 + 2*b*g1*g2 + 5*g2", a=1, b=1)
    templates = Templates(model_of(document, (A, B), frozenset()))
    constants_at(document, fmpq(7), fmpq(9), templates)
    found, member = constants_at(document, number(a), number(b), templates)
    alone, constants = make_program(member.tape)
    assert alone.key == found.template.program.key
    assert np.array_equal(found.row, constants)


def number(text):
    exact = Fraction(text)
    return fmpq(exact.numerator, exact.denominator)


def constants_at(document, a, b, templates=None):
    """Return the constants of a point, and its potential by itself."""
    templates = templates or Templates(model_of(document, (A, B), frozenset()))
    moments, numbers = MomentsOfPoint.of(BODY), [a, b]
    values = templates.model.values(moments, numbers)
    member = with_values(document, {A: str(a), B: str(b)})
    return templates.at(moments, numbers, values), potential_of(member, BODY)


@pytest.mark.parametrize("sign", [1, -1])
def test_energies_are_those_of_the_formula_of_the_member(sign):
    document = expression("a*g1 + b/g3^2", a=1, b=1)
    family = prove_family(BODY, document, (A, B))
    motion = PlanarMotion(None, Fraction(sign))
    a, b, square = Fraction(-13, 10), Fraction(1, 30), Fraction(7, 5)
    row = [fmpq(number.numerator, number.denominator) for number in (a, b)]
    energies = energies_of(BODY, family, motion)
    ((value, error),) = energies.rounded([row], [fmpq(square.numerator, square.denominator)])
    verdict = decide(BODY, potential_of(with_values(document, {A: str(a), B: str(b)}), BODY))
    tape = compile_tape(parse(verdict.energy_formula), ("nu",))
    exact = tape.evaluate(Exact(), (sign * square,))
    assert value == float(exact)
    assert error == math.nextafter(float(abs(exact - Fraction(value))), math.inf)


class Exact:
    """Rational arithmetic, for a tape without functions."""

    def constant(self, value):
        return value

    def add(self, left, right):
        return left + right

    def subtract(self, left, right):
        return left - right

    def multiply(self, left, right):
        return left * right

    def divide(self, left, right):
        return left / right

    def negate(self, operand):
        return -operand

    def power(self, base, exponent):
        return base ** int(exponent)

    def call(self, name, argument):
        return {"abs": abs}[name](argument)


def test_poles_are_passed_in_blocks_only_where_nothing_is_agreed_on():
    motion = PlanarMotion(Fraction(1))
    pendulum = prove_family(BODY, expression("a*g1", a=1), (A,))
    poles = smooth_poles(BODY, pendulum, motion)
    assert poles.are_plain(np.array([[3.0], [-0.1]])).all()
    barrier = prove_family(BODY, expression("a*g1 + b/g3^2", a=1, b=1), (A, B))
    assert smooth_poles(BODY, barrier, motion) is None
    opposed = prove_family(BODY, expression("a*g1^2 - a*g2^2 + b*(g1^2-g2^2)", a=1, b=1), (A, B))
    plain = smooth_poles(BODY, opposed, motion).are_plain(np.array([[100.0, 50.0], [100.0, -99.9]]))
    assert plain.tolist() == [True, False]
