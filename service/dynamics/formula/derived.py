"""Programs for V and its derivatives: what jets do to the tape of V, recorded once for all of its structure.

A structure is a tape without its numbers. The exact numbers of what is derived from it are integers, or
those of the tape plus an integer, as the exponent of a power's derivative is: one program does for all
potentials that differ in numbers alone.
"""

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import lru_cache
from itertools import combinations_with_replacement, count
from typing import NamedTuple, cast

from service.dynamics.formula.algebras.jets import FirstOrderJets, Jet, SecondOrderJets
from service.dynamics.formula.programs import Traced, Tracer
from service.dynamics.formula.tape import Instruction, Operation, Tape
from service.dynamics.formula.tree import VARIABLES

CACHED_STRUCTURES = 256
"""Number of structures of which derived programs are cached."""


class Exact(NamedTuple):
    """An exact number of a derived program: a number of the tape by its place among these, and ``more``."""

    place: int
    """-1: none."""
    more: int


class Derived(NamedTuple):
    """Instructions on registers, the first of which are g1, g2, g3; ``results`` are registers."""

    instructions: tuple[Instruction, ...]
    """Their numbers are in ``numbers``."""
    numbers: tuple[Exact | None, ...]
    """The constant or the exponent of each instruction."""
    results: tuple[int, ...]

    def tapes(self, numbers: Sequence[Fraction | None]) -> tuple[Tape, ...]:
        """Return a tape for each result, of a potential with these numbers, None for π."""
        written = []
        for instruction, exact in zip(self.instructions, self.numbers, strict=True):
            number = None if exact is None else _number(exact, numbers)
            is_pi = exact is not None and number is None
            written.append(
                instruction._replace(number=number, operation="pi" if is_pi else instruction.operation)
            )
        return tuple(Tape(VARIABLES, tuple(written), result) for result in self.results)


Derivation = Callable[[Tape, Tracer, Sequence[Traced]], Sequence[Traced]]
"""Returns the results of a tape at its variables, as values of the tracer."""


def value(tape: Tape, tracer: Tracer, g: Sequence[Traced]) -> Sequence[Traced]:
    """Return V."""
    return (tape.evaluate(tracer, g),)


def turn(tape: Tape, tracer: Tracer, g: Sequence[Traced]) -> Sequence[Traced]:
    """Return D = g1 V_3 − g3 V_1, the derivative along a turn about the second axis."""
    return value_and_turn(tape, tracer, g)[1:]


def value_and_turn(tape: Tape, tracer: Tracer, g: Sequence[Traced]) -> Sequence[Traced]:
    """Return V and D."""
    jets = FirstOrderJets(tracer, 1)
    seeds = (jets.seed(g[0], (tracer.negate(g[2]),)), jets.seed(g[1], (None,)), jets.seed(g[2], (g[0],)))
    jet = tape.evaluate(jets, seeds)
    return jet.value, *jets.gradient(jet)


def gradient(tape: Tape, tracer: Tracer, g: Sequence[Traced]) -> Sequence[Traced]:
    """Return V, V_1, V_2 and V_3."""
    jets = FirstOrderJets(tracer, 3)
    jet = tape.evaluate(jets, jets.variables(g))
    return jet.value, *jets.gradient(jet)


def slopes(tape: Tape, tracer: Tracer, g: Sequence[Traced]) -> Sequence[Traced]:
    """Return V_1, V_2 and V_3."""
    return gradient(tape, tracer, g)[1:]


def second_order(tape: Tape, tracer: Tracer, g: Sequence[Traced]) -> Sequence[Traced]:
    """Return V, its three first derivatives, and the second ones 11, 12, 13, 22, 23, 33."""
    jets = SecondOrderJets(tracer, 3)
    jet = tape.evaluate(jets, jets.variables(g))
    rows = jets.hessian(jet)
    return (
        jet.value,
        *jets.gradient(jet),
        *(rows[i][j] for i, j in combinations_with_replacement(range(3), 2)),
    )


def across(tape: Tape, tracer: Tracer, g: Sequence[Traced]) -> Sequence[Traced]:
    """Return D, ∂²V/∂φ², and the derivatives of V along g1 (−g2, g1, 0) and g3 (0, −g3, g2).

    φ turns g1 = √ρ cos φ and g3 = √ρ sin φ; the equation of what leaves the plane has these derivatives.
    """
    multiply, negate = tracer.multiply, tracer.negate
    g1, g2, g3 = g
    rates = (
        (negate(g3), negate(multiply(g1, g2)), None),
        (None, multiply(g1, g1), negate(multiply(g3, g3))),
        (g1, None, multiply(g2, g3)),
    )
    bends = ((negate(g1), *(None,) * 5), (None,) * 6, (negate(g3), *(None,) * 5))
    jets = SecondOrderJets(tracer, 3)
    jet = tape.evaluate(jets, tuple(map(Jet, g, rates, bends)))
    D, first, third = jets.gradient(jet)
    return D, jets.hessian(jet)[0][0], first, third


def derived(tape: Tape, derivation: Derivation) -> Derived:
    """Return the program of a tape over g1, g2, g3; further variables are numbers, the first ones."""
    structure = tuple((each.operation, each.left, each.right, each.name) for each in tape.instructions)
    return _of_structure(structure, len(tape.variables) - len(VARIABLES), tape.result, derivation)


_Structure = tuple[tuple[Operation, int, int, str], ...]
_SPACING, _PARTS = 2**20, 1_000_003
"""The stand-in for the k-th number of a tape is (k + 1) · _SPACING + 1/_PARTS; integers added leave k."""


class _Tracer(Tracer):
    """A tracer of formulas whose numbers are stood in for; it leaves out factors of 1 and double signs."""

    def __init__(self) -> None:
        super().__init__()
        self._one = self.constant(Fraction(1))
        self._opposite = dict[Traced, Traced]()

    def multiply(self, left: Traced, right: Traced) -> Traced:
        """Return left · right."""
        return left if right is self._one else right if left is self._one else super().multiply(left, right)

    def negate(self, operand: Traced) -> Traced:
        """Return -operand."""
        found = self._opposite.get(operand)
        if found is None:
            found = super().negate(operand)
            self._opposite[operand], self._opposite[found] = found, operand
        return found

    def constant(self, value: Fraction) -> Traced:
        """Return a number; the e (e − 1) of a second derivative by its factors."""
        if value.denominator != _PARTS**2:
            return super().constant(value)
        exponent = _stand_in(round(math.isqrt(value.numerator) / (_SPACING * _PARTS)) - 1)
        return self.multiply(self.constant(exponent), self.constant(exponent - 1))


@lru_cache(maxsize=CACHED_STRUCTURES)
def _of_structure(structure: _Structure, others: int, result: int, derivation: Derivation) -> Derived:
    places = count()
    instructions = [Instruction("constant", number=_stand_in(next(places))) for _ in range(others)]
    for operation, left, right, name in structure:
        number = _stand_in(next(places)) if operation in ("constant", "pi", "power") else None
        named: Operation = "constant" if operation == "pi" else operation
        instructions.append(Instruction(named, left, right, number, name))
    tracer = _Tracer()
    g = [tracer.variable(name) for name in VARIABLES]
    results = derivation(Tape(VARIABLES, tuple(instructions), result), tracer, g)
    steps = [each for each in tracer.steps(results) if each[1].operation != "variable"]
    registers = {each.number: register for register, each in enumerate(g)} | {-1: -1}
    registers |= {number: register for register, (number, _) in enumerate(steps, start=len(g))}
    written = []
    for _, step in steps:
        left, right = registers[step.left], registers[step.right]
        written.append(Instruction(cast("Operation", step.operation), left, right, name=step.name))
    numbers = [None if step.number is None else _exact(step.number) for _, step in steps]
    return Derived(tuple(written), tuple(numbers), tuple(registers[each.number] for each in results))


def _stand_in(place: int) -> Fraction:
    return Fraction((place + 1) * _SPACING * _PARTS + 1, _PARTS)


def _exact(number: Fraction) -> Exact:
    if number.denominator == 1:
        return Exact(-1, number.numerator)
    place = round(number / _SPACING) - 1
    return Exact(place, int(number - _stand_in(place)))


def _number(exact: Exact, numbers: Sequence[Fraction | None]) -> Fraction | None:
    known = Fraction(0) if exact.place < 0 else numbers[exact.place]
    return None if known is None else known + exact.more
