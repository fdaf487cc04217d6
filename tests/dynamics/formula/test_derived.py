"""Derived programs are jets: the same derivatives, and none where jets have none."""

from fractions import Fraction

import pytest
from flint import arb, ctx

from service.dynamics.formula import derived
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.jets import SecondOrderJets
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape, with_inputs
from service.schemas.problem.problem import read_question
from tests.conformance.specimens import SPECIMENS
from tests.support.effort import one_in
from tests.support.formulas import POTENTIALS

BITS = 200
NARROWED = 2.0**-150
"""Balls of 200 bits lose few of them in some hundred operations on numbers of about the size 1."""
PLACES = {
    "a point": ("0.37", "-0.69", "0.61"),
    "another quadrant": ("-0.28", "0.53", "-0.79"),
    "the equator": ("0.6", "0.8", "0"),
    "a pole of g1": ("0", "-0.6", "0.8"),
    "across kinks": ("0 +/- 0.125", "0.5 +/- 0.25", "0 +/- 0.25"),
}
KINKS = [
    "abs(g1)*g2",
    "abs(g3)^3/g2",
    "g1^(4/3)",
    "g2^(-1/2)/abs(g3)",
    "sqrt(g3)",
    "log(abs(g1))",
    "(g1^2)^g2",
]


def tapes():
    for text in [*POTENTIALS, *KINKS, "g2^2", "0*g1", "2"]:
        yield pytest.param(compile_tape(parse(text)), id=text)
    for specimen in SPECIMENS:
        question = {name: specimen.document[name] for name in ("body", "potential")}
        potential = read_question(question).potential
        if potential.has_formula:
            yield pytest.param(potential.tape, id=specimen.name)


def numbers_of(tape):
    return [at.number for at in tape.instructions if at.operation == "pi" or at.number is not None]


def evaluated(tape, derivation, place):
    program = derived.derived(tape, derivation)
    return [each.evaluate(BallAlgebra(), place) for each in program.tapes(numbers_of(tape))]


@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES)
@pytest.mark.parametrize("tape", one_in(3, tapes()))
def test_derived_programs_equal_jets(tape, place):
    with ctx.workprec(BITS):
        point = g1, g2, g3 = [arb(each) for each in place]
        jets = SecondOrderJets(BallAlgebra(), 3)
        jet = tape.evaluate(jets, jets.variables(point))
        rows = jets.hessian(jet)
        V_1, V_2, V_3 = jets.gradient(jet)
        expected = [jet.value, V_1, V_2, V_3, *(rows[i][j] for i in range(3) for j in range(i, 3))]
        assert_alike(evaluated(tape, derived.second_order, point), expected)
        assert_alike(evaluated(tape, derived.gradient, point), expected[:4])
        assert_alike(evaluated(tape, derived.slopes, point), expected[1:4])
        assert_alike(evaluated(tape, derived.value, point), expected[:1])
        turn = evaluated(tape, derived.turn, point)
        assert_alike(evaluated(tape, derived.value_and_turn, point), [jet.value, *turn])
        across = evaluated(tape, derived.across, point)
        # By the chain rule from the second derivatives; no infinite part may be missing in both.
        bend = g3**2 * rows[0][0] - 2 * g1 * g3 * rows[0][2] + g1**2 * rows[2][2] - g1 * V_1 - g3 * V_3
        by_first, by_third = g1 * (g1 * V_2 - g2 * V_1), g3 * (g2 * V_3 - g3 * V_2)
        for one, other in zip(across, (turn[0], bend, by_first, by_third), strict=True):
            assert one.overlaps(other)
            assert one.is_finite() or not other.is_finite()
        # By another route: the parts of D may be infinite where D is not, and D has a bound where they have.
        D = g1 * V_3 - g3 * V_1
        assert turn[0].overlaps(D)
        assert turn[0].is_finite() or not D.is_finite()


def assert_alike(found, expected):
    for one, other in zip(found, expected, strict=True):
        assert one.is_finite() == other.is_finite()
        if other.is_finite():
            assert one.overlaps(other)
            # The operations are the same up to factors of 1.
            assert one.rad() <= other.rad() * 1.01 + NARROWED * (1 + abs(other))


@pytest.mark.parametrize("text", ["3*g1^5 - g3^(7/2)/7", "pi*g1 - 2^g2*g3^2"])
def test_one_program_does_for_all_numbers(text):
    """A tape that has its numbers as further variables has the derivatives of one with other numbers."""
    tape = compile_tape(parse(text))
    program = derived.derived(tape, derived.gradient)
    other = compile_tape(parse(text.replace("3*", "11*").replace("^5", "^2").replace("7", "5")))
    assert derived.derived(other, derived.gradient) is program
    constant = next(k for k, at in enumerate(tape.instructions) if at.operation in ("constant", "pi"))
    open_tape = with_inputs(tape, [constant])
    place = [arb("0.3"), arb("0.5"), arb("0.7")]
    numbers = numbers_of(tape)
    moved = [numbers[constant_place(tape, constant)], *numbers_of(open_tape)]
    with ctx.workprec(BITS):
        found = [
            each.evaluate(BallAlgebra(), place)
            for each in derived.derived(open_tape, derived.gradient).tapes(moved)
        ]
        assert_alike(found, evaluated(tape, derived.gradient, place))


def constant_place(tape, instruction):
    return sum(at.operation == "pi" or at.number is not None for at in tape.instructions[:instruction])


def test_the_number_of_a_second_derivative_is_that_of_its_exponent():
    with ctx.workprec(BITS):
        for exponent in (Fraction(2), Fraction(3), Fraction(-1), Fraction(17, 10)):
            tape = compile_tape(parse(f"g1^({exponent})"))
            *_, V_11, _, _, _, _, _ = evaluated(tape, derived.second_order, [arb(2), arb(1), arb(1)])
            number = arb(exponent.numerator) / exponent.denominator
            assert V_11.overlaps(number * (number - 1) * arb(2) ** (number - 2))
            assert V_11.rad() <= NARROWED
