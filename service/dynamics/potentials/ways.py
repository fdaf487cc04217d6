"""The ways in which a potential's tape is asked in balls often enough for a program."""

from collections.abc import Sequence

from service.dynamics.formula.algebras.jets import FirstOrderJets, SecondOrderJets
from service.dynamics.formula.programs import OFTEN, Way
from service.dynamics.formula.tape import Tape
from service.dynamics.formula.traces import Traced, Tracer

Trace = tuple[Sequence[Traced], Sequence[Traced]]


def _value(tape: Tape, tracer: Tracer) -> Trace:
    inputs = _variables(tracer)
    return inputs, (tape.evaluate(tracer, inputs),)


def _value_and_turn(tape: Tape, tracer: Tracer) -> Trace:
    inputs = g1, g2, g3 = _variables(tracer)
    jets = FirstOrderJets(tracer, 1)
    # The turn about the second axis.
    seeds = (jets.seed(g1, (tracer.negate(g3),)), jets.seed(g2, (None,)), jets.seed(g3, (g1,)))
    jet = tape.evaluate(jets, seeds)
    return inputs, (jet.value, jets.gradient(jet)[0])


def _turn(tape: Tape, tracer: Tracer) -> Trace:
    inputs, (_, turn) = _value_and_turn(tape, tracer)
    return inputs, (turn,)


def _variables(tracer: Tracer) -> tuple[Traced, Traced, Traced]:
    return tracer.variable("g1"), tracer.variable("g2"), tracer.variable("g3")


def _second_order(tape: Tape, tracer: Tracer) -> Trace:
    inputs = _variables(tracer)
    jets = SecondOrderJets(tracer, 3)
    jet = tape.evaluate(jets, jets.variables(inputs))
    rows = jets.hessian(jet)
    return inputs, (jet.value, *jets.gradient(jet), *(rows[i][j] for i in range(3) for j in range(i, 3)))


VALUE = Way("real", _value, is_shared=True)
TURN = Way("real", _turn, is_shared=True)
VALUE_AND_TURN = Way("real", _value_and_turn, is_shared=True)
SECOND_ORDER = Way("real", _second_order, is_shared=True, often=3 * OFTEN)
"""The value, its three first derivatives, and the second ones 11, 12, 13, 22, 23, 33: a long program."""
