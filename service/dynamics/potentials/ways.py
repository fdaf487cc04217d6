"""The ways in which a potential's tape is asked in balls often enough for a program."""

from collections.abc import Sequence

from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.programs import Way
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


VALUE = Way("real", _value)
TURN = Way("real", _turn)
VALUE_AND_TURN = Way("real", _value_and_turn)
