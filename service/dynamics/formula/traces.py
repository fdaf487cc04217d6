"""Records the operations of a formula once, without unused ones, to replay them in any algebra.

A tape that is evaluated over jets decides anew for every number which derivatives are 0, and makes
an object for every step. A trace has decided that: it is what the jets do to their base algebra.
"""

from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple


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
