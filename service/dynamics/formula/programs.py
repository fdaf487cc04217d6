"""Formulas as traces, which any algebra replays, and in balls as lists of operations that are gone through.

A tape that is evaluated over jets decides anew for every number which derivatives are 0, and makes
an object for every step. A trace has decided that: it is what the jets do to their base algebra.

What a tape does in balls is traced, and the trace becomes a list of operations on
registers. Every operation is that of the algebra, in an order that gives the same balls to the last bit.
"""

import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, Generic, Literal, NamedTuple, TypeVar

from flint import ctx

from service.dynamics.formula.algebra import Algebra
from service.dynamics.formula.algebras.ball import BallAlgebra, ComplexBallAlgebra

if TYPE_CHECKING:
    from service.dynamics.formula.tape import Tape

T = TypeVar("T")


class Step(NamedTuple):
    """One operation of an algebra on earlier values; its own value has the number of its place."""

    operation: str
    """The name of the algebra's method."""
    left: int = -1
    right: int = -1
    number: Fraction | None = None
    """The value of a constant, or the exponent of a power."""
    name: str = ""
    """The function of a call."""


class Traced:
    """A value of the tracer, known by its number alone."""

    __slots__ = ("number",)

    def __init__(self, number: int) -> None:
        self.number = number


class Tracer:
    """An algebra whose values are the numbers of steps; equal steps are one, and one object."""

    def __init__(self) -> None:
        self._steps: list[Step] = []
        self._values: dict[Step, Traced] = {}

    def variable(self, name: str) -> Traced:
        """Return an input."""
        return self._append(Step("variable", name=name))

    def constant(self, value: Fraction) -> Traced:
        """Return an exact number."""
        return self._append(Step("constant", number=value))

    def pi(self) -> Traced:
        """Return π."""
        return self._append(Step("pi"))

    def add(self, left: Traced, right: Traced) -> Traced:
        """Return left + right."""
        return self._append(Step("add", left.number, right.number))

    def subtract(self, left: Traced, right: Traced) -> Traced:
        """Return left - right."""
        return self._append(Step("subtract", left.number, right.number))

    def multiply(self, left: Traced, right: Traced) -> Traced:
        """Return left · right."""
        return self._append(Step("multiply", left.number, right.number))

    def divide(self, left: Traced, right: Traced) -> Traced:
        """Return left / right."""
        return self._append(Step("divide", left.number, right.number))

    def negate(self, operand: Traced) -> Traced:
        """Return -operand."""
        return self._append(Step("negate", operand.number))

    def power(self, base: Traced, exponent: Fraction) -> Traced:
        """Return base^exponent."""
        return self._append(Step("power", base.number, number=exponent))

    def general_power(self, base: Traced, exponent: Traced) -> Traced:
        """Return exp(exponent · log(base))."""
        return self._append(Step("general_power", base.number, exponent.number))

    def call(self, name: str, argument: Traced) -> Traced:
        """Return the function of the argument."""
        return self._append(Step("call", argument.number, name=name))

    def steps(self, results: Sequence[Traced]) -> list[tuple[int, Step]]:
        """Return what the results need, in order, each step with its number."""
        needed = {result.number for result in results}
        kept = []
        for number in reversed(range(len(self._steps))):
            if number in needed:
                step = self._steps[number]
                needed |= {step.left, step.right}
                kept.append((number, step))
        return kept[::-1]

    def _append(self, step: Step) -> Traced:
        value = self._values.get(step)
        if value is None:
            value = self._values[step] = Traced(len(self._steps))
            self._steps.append(step)
        return value


MANY_EVALUATIONS = 12
"""Evaluations of one kind after which a program pays for its making."""
MAX_PROGRAM_OPERATIONS = 4000
"""Operations of a program: constants of longer ones take more room than is sure to be worth it."""
CACHED_FORMULAS = 64
"""Number of formulas whose programs are cached for the next problem."""
CACHED_PRECISIONS = 16
"""Number of precisions for which the constants of a program are cached."""
Kind = Literal["real", "complex", "analytic"]
Run = Callable[..., tuple[Any, ...]]
"""Returns the results, given the inputs: balls or complex ones."""
Operation = Callable[[Any, Any], Any]
"""An operation on two registers; one of a single operand does not look at the second."""
_CONSTANTS = "constant", "pi"
_OPERATORS: dict[str, Operation] = {
    "add": operator.add,
    "subtract": operator.sub,
    "multiply": operator.mul,
    "divide": operator.truediv,
    "negate": lambda x, _: -x,
}


@dataclass(frozen=True, slots=True)
class Way:
    """A way to ask a tape: which inputs it has beside its variables, and what is wanted."""

    kind: Kind
    trace: "Callable[[Tape, Tracer], tuple[Sequence[Traced], Sequence[Traced]]]"
    """Returns the inputs and the results of a tape, as values of the tracer."""
    is_shared: bool = False
    """True if the trace depends on the tape alone: equal tapes of later problems have the same program."""
    often: int = MANY_EVALUATIONS


class Programs:
    """The programs of one tape, by the way it is asked; made when it has been asked often."""

    __slots__ = ("_asked", "_made", "_of_equal_tapes")

    def __init__(self) -> None:
        self._asked: dict[object, int] = {}
        self._made: dict[object, _Program[Any] | None] = {}
        self._of_equal_tapes: Programs | None = None

    def __reduce__(self) -> tuple[type["Programs"], tuple[()]]:
        """Leave the programs behind: they are made again where they are asked for."""
        return Programs, ()

    def find(self, tape: "Tape", name: object, way: Way) -> Run | None:
        """Return the program at the current precision; None while it is not worth its making.

        ``name`` is the way's, and tells it from other ways to ask this tape.
        """
        if way.is_shared:
            if self._of_equal_tapes is None:
                # Hashing a tape takes longer than using a program.
                self._of_equal_tapes = _of_equal_tapes(tape)
            return self._of_equal_tapes._own(tape, name, way)
        return self._own(tape, name, way)

    def _own(self, tape: "Tape", name: object, way: Way) -> Run | None:
        made = self._made.get(name)
        if made is not None:
            return made.at(ctx.prec)
        if name in self._made:
            return None
        asked = self._asked.get(name, 0) + 1
        self._asked[name] = asked
        if asked > way.often:
            program = traced_program(tape, way)
            self._made[name] = program if len(program.operations) <= MAX_PROGRAM_OPERATIONS else None
        return None


@lru_cache(maxsize=CACHED_FORMULAS)
def _of_equal_tapes(_: "Tape") -> Programs:
    return Programs()


@dataclass(slots=True)
class _Program(Generic[T]):
    constants: tuple[Callable[[], T], ...]
    """Their registers are the first ones; those of the inputs follow, and then one result after the other."""
    operations: tuple[tuple[Operation, int, int], ...]
    results: tuple[int, ...]
    runs: dict[int, Run] = field(default_factory=dict)

    def at(self, precision: int) -> Run:
        run = self.runs.get(precision)
        if run is None:
            if len(self.runs) >= CACHED_PRECISIONS:
                self.runs.clear()
            run = self.runs[precision] = self._bound([constant() for constant in self.constants])
        return run

    def _bound(self, constants: list[T]) -> Run:
        operations, results = self.operations, self.results

        def run(*inputs: T) -> tuple[T, ...]:
            registers = [*constants, *inputs]
            append = registers.append
            for operation, left, right in operations:
                append(operation(registers[left], registers[right]))
            return tuple([registers[result] for result in results])

        return run


def traced_program(tape: "Tape", way: Way) -> "_Program[Any]":
    """Return the program of one way to ask a tape."""
    is_real = way.kind == "real"
    algebra: Algebra[Any] = BallAlgebra() if is_real else ComplexBallAlgebra(analytic=way.kind == "analytic")
    tracer = Tracer()
    inputs, results = way.trace(tape, tracer)
    steps = tracer.steps(results)
    constants = {number: step for number, step in steps if step.operation in _CONSTANTS}
    operations = {number: step for number, step in steps if step.operation not in (*_CONSTANTS, "variable")}
    order = [*constants, *(each.number for each in inputs), *operations]
    registers = {number: register for register, number in enumerate(order)}
    written = []
    for step in operations.values():
        left = registers[step.left]
        if step.operation == "power" and step.number == 2 and is_real:
            written.append((operator.mul, left, left))
        else:
            written.append((_operation(step, algebra), left, registers.get(step.right, left)))
    return _Program(
        tuple(
            algebra.pi if step.number is None else partial(algebra.constant, step.number)
            for step in constants.values()
        ),
        tuple(written),
        tuple(registers[each.number] for each in results),
    )


def _operation(step: Step, algebra: Algebra[T]) -> Operation:
    simple = _OPERATORS.get(step.operation)
    if simple is not None:
        return simple
    if step.operation == "general_power":
        return algebra.general_power
    exponent, name = step.number, step.name
    if exponent is not None:
        return lambda x, _: algebra.power(x, exponent)
    return lambda x, _: algebra.call(name, x)
