"""Evaluates a potential on the loop in any algebra: balls at one point, or a trace for a program."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any  # A question is answered in every algebra: its values have no one type.

from service.dynamics.formula.algebra import Algebra
from service.dynamics.formula.algebras.jets import FirstOrderJets, Jet, SecondOrderJets
from service.dynamics.formula.tape import Tape

Values = Sequence[Any]


@dataclass(frozen=True, slots=True)
class PlaneQuestion:
    """A question that needs so many inputs beside g1, g2, g3."""

    name: str
    beside: int
    answer: Callable[[Tape, Algebra[Any], Values, Values], tuple[Any, ...]]
    """Returns the answers, given the tape, the algebra, (g1, g2, g3) and the inputs beside."""
    is_squared: bool = False
    """The one input beside is g2²."""


def _value(tape: Tape, algebra: Algebra[Any], gamma: Values, beside: Values) -> tuple[Any, ...]:
    return (tape.evaluate(algebra, gamma),)


def _slope(tape: Tape, algebra: Algebra[Any], gamma: Values, beside: Values) -> tuple[Any, ...]:
    jets = FirstOrderJets(algebra, 1)
    seeds = [jets.seed(value, (rate,)) for value, rate in zip(gamma, beside, strict=True)]
    jet = tape.evaluate(jets, seeds)
    return jet.value, jets.gradient(jet)[0]


def _bend(tape: Tape, algebra: Algebra[Any], gamma: Values, beside: Values) -> tuple[Any, ...]:
    jets = SecondOrderJets(algebra, 1)
    seeds = [
        Jet(value, (rate,), (bend,))
        for value, rate, bend in zip(gamma, beside[::2], beside[1::2], strict=True)
    ]
    jet = tape.evaluate(jets, seeds)
    return jet.value, jets.gradient(jet)[0], jets.hessian(jet)[0][0]


VALUE = PlaneQuestion("value", 0, _value)
"""V."""
SLOPE = PlaneQuestion("slope", 3, _slope)
"""V and its derivative, from those of g1, g2 and g3."""
BEND = PlaneQuestion("bend", 6, _bend)
"""V and two derivatives, from the first and the second of g1, of g2 and of g3."""
