"""Programs give the very balls of the algebras: the same operations in the same order."""

import copy
from fractions import Fraction

import pytest
from flint import acb, arb, ctx
from hypothesis import given, settings

from service.dynamics.errors import FormulaError
from service.dynamics.formula.algebras.ball import BallAlgebra, ComplexBallAlgebra
from service.dynamics.formula.algebras.jets import FirstOrderJets, SecondOrderJets
from service.dynamics.formula.parameters import bind
from service.dynamics.formula.parser import parse
from service.dynamics.formula.programs import MANY_EVALUATIONS, Way, traced_program
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.formula.tree import Tree
from service.dynamics.potentials.potential import SECOND_ORDER, VALUE, FormulaPotential
from tests.support.effort import examples
from tests.support.formulas import POTENTIALS
from tests.support.trees import TREES

PLACE = ("0.37", "-0.69", "0.61")
CONSTANTS = {name: Fraction(3, 7) for name in ["A", "B", "C", "a", "e", "e1", "_x"]}


def derivative(tape, algebra, inputs):
    """V and its derivative along (−g3, 0, g1)."""
    g1, g2, g3 = inputs
    jets = FirstOrderJets(algebra, 1)
    seeds = (jets.seed(g1, (algebra.negate(g3),)), jets.seed(g2, (None,)), jets.seed(g3, (g1,)))
    jet = tape.evaluate(jets, seeds)
    return jet.value, jets.gradient(jet)[0]


def way(kind):
    def trace(tape, tracer):
        inputs = [tracer.variable(name) for name in ("g1", "g2", "g3")]
        return inputs, derivative(tape, tracer, inputs)

    return Way(kind, trace)


def program(tape: Tape, kind):
    asked = [tape.program(kind, way(kind)) for _ in range(MANY_EVALUATIONS + 2)]
    assert asked[:MANY_EVALUATIONS] == [None] * MANY_EVALUATIONS
    return asked[-1]


def exactly(value):
    """The middle and the radius of a ball, None if there is none."""
    if isinstance(value, acb):
        return exactly(value.real), exactly(value.imag)
    return (value.mid().man_exp(), value.rad().man_exp()) if value.is_finite() else None


def assert_same(tape: Tape) -> None:
    real = tuple(arb(text, 1e-9) for text in PLACE)
    wide = tuple(acb(value, arb(0, 1e-3)) for value in real)
    for precision in (64, 160):
        with ctx.workprec(precision):
            run = program(tape, "real") if precision == 64 else tape.program("real", way("real"))
            found, expected = run(*real), derivative(tape, BallAlgebra(), real)
            assert [exactly(value) for value in found] == [exactly(value) for value in expected]
            for kind in ("analytic", "complex"):
                run = program(tape, kind) if precision == 64 else tape.program(kind, way(kind))
                algebra = ComplexBallAlgebra(analytic=kind == "analytic")
                found, expected = run(*wide), derivative(tape, algebra, wide)
                assert [exactly(value) for value in found] == [exactly(value) for value in expected]


@pytest.mark.parametrize("text", POTENTIALS)
def test_programs_of_potentials(text: str) -> None:
    assert_same(compile_tape(parse(text)))


@pytest.mark.parametrize(
    "text",
    [
        "g1^2 + g2^(-2) + g3^3 + g1^(-5)",
        "sqrt(g1) + g3^(-1/2) + g1^(7/3) + g3^(-2/5)",
        "g1^g3 + pi*exp(sin(g1) + cos(g2)*tan(g3)) - log(g1)",
        "abs(g2)*g1 + abs(g1 - g3)^3",
        "-g2/(g1 + 1/3)",
        "g2^2",
    ],
)
def test_programs_of_every_operation(text: str) -> None:
    assert_same(compile_tape(parse(text)))


@settings(deadline=None, max_examples=examples(17, 50))
@given(TREES)
def test_programs_of_any_tree(tree: Tree) -> None:
    try:
        tape = compile_tape(bind(tree, CONSTANTS))
    except FormulaError:
        return
    assert_same(tape)


def test_what_is_not_wanted_is_not_computed() -> None:
    """The derivative of a factor that does not change needs neither its slope nor the value of V."""
    tape = compile_tape(parse("g1*exp(g2)"))

    def trace(tape, tracer):
        inputs = [tracer.variable(name) for name in ("g1", "g2", "g3")]
        return inputs, derivative(tape, tracer, inputs)[1:]

    program = traced_program(tape, Way("real", trace))
    # exp(g2), −g3, and their product.
    assert len(program.operations) == 3


def test_a_tape_is_carried_without_its_programs() -> None:
    tape = compile_tape(parse("g1 + g2*g3"))
    assert program(tape, "real") is not None
    carried = copy.deepcopy(tape)
    assert carried == tape
    assert carried.program("real", way("real")) is None


@pytest.mark.parametrize("text", [*POTENTIALS, "abs(g1 - g3)^3 + g1^g3", "g2^2", "1/3"])
def test_second_derivatives_of_potentials_are_those_of_the_jets(text):
    """A potential gives the same balls before its program is made and after."""
    potential = FormulaPotential.from_tree(bind(parse(text), CONSTANTS), "expression")
    place = tuple(arb(text, 1e-9) for text in PLACE)
    jets = SecondOrderJets(BallAlgebra(), 3)
    for precision in (64, 160):
        with ctx.workprec(precision):
            jet = potential.tape.evaluate(jets, jets.variables(place))
            expected = [jet.value, *jets.gradient(jet), *(x for row in jets.hessian(jet) for x in row)]
            for _ in range(SECOND_ORDER.often + 2):
                value, gradient, hessian = potential.jet_ball(*place)
                found = [value, *gradient, *(entry for row in hessian for entry in row)]
                assert [exactly(ball) for ball in found] == [exactly(ball) for ball in expected]
    assert potential.tape.program("V, gradient, hessian", SECOND_ORDER) is not None


def test_an_equal_tape_of_another_problem_has_the_programs_too():
    text = "g1*g2*17/19 + g3"
    first, second = (compile_tape(parse(text)) for _ in range(2))
    assert first is not second
    assert [first.program("V", VALUE) for _ in range(MANY_EVALUATIONS + 1)] == [None] * (MANY_EVALUATIONS + 1)
    assert second.program("V", VALUE) is not None
    assert compile_tape(parse("g1*g2*17/19 - g3")).program("V", VALUE) is None
