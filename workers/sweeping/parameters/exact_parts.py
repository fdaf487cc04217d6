"""Works out parts of a formula that are made of numbers alone, exactly and at many points.

The parts become one list of operations on ratios, with equal ones once: to walk trees takes longer than the
arithmetic at their nodes.
"""

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from flint import fmpq

from service.dynamics.formula.tree import Binary, Number, Symbol, Tree, fold_tree, post_order

_Operation = Callable[[fmpq, fmpq], fmpq]


def _power(base: fmpq, exponent: fmpq) -> fmpq:
    found: fmpq = base ** int(exponent.p)
    return found


def _negative(operand: fmpq, _: fmpq) -> fmpq:
    return -operand


_OPERATIONS: Mapping[str, _Operation] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "^": _power,
}


@dataclass(frozen=True, slots=True)
class ExactParts:
    """Some parts as operations on registers, of which the first are the inputs, then the constants."""

    constants: tuple[fmpq, ...]
    steps: tuple[tuple[_Operation, int, int], ...]
    results: tuple[int, ...]
    """The registers of the parts, in their order."""

    def values(self, numbers: Sequence[fmpq]) -> list[fmpq]:
        """Return the values of the parts at these inputs; raises ZeroDivisionError."""
        registers = [*numbers, *self.constants]
        for operation, left, right in self.steps:
            registers.append(operation(registers[left], registers[right]))
        return [registers[place] for place in self.results]


def parts_of(trees: Sequence[Tree], inputs: Sequence[str], fixed: Mapping[str, fmpq]) -> ExactParts:
    """Return the parts ``trees``, made of the symbols ``inputs``, of ``fixed`` numbers and of plain ones.

    Powers have whole exponents. Raises KeyError for another symbol.
    """
    places = {name: place for place, name in enumerate(inputs)}
    constants: dict[Fraction | str, int] = {}
    numbers: list[fmpq] = []
    for node in (node for tree in trees for node in post_order(tree)):
        known = _constant(node, places, fixed)
        if known is not None and known[0] not in constants:
            constants[known[0]] = len(places) + len(numbers)
            numbers.append(known[1])
    first, steps = len(places) + len(numbers), dict[tuple[_Operation, int, int], int]()

    def register(_: int, node: Tree, below: Sequence[int]) -> int:
        known = _constant(node, places, fixed)
        if known is not None:
            return constants[known[0]]
        if isinstance(node, Symbol):
            return places[node.name]
        if isinstance(node, Binary):
            step = _OPERATIONS[node.operator], below[0], below[1]
        else:
            step = _negative, below[0], below[0]
        return steps.setdefault(step, first + len(steps))

    results = tuple(fold_tree(tree, register) for tree in trees)
    return ExactParts(tuple(numbers), tuple(steps), results)


def _constant(
    node: Tree, places: Mapping[str, int], fixed: Mapping[str, fmpq]
) -> tuple[Fraction | str, fmpq] | None:
    """Return a constant with what it is known by; None for what is none."""
    if isinstance(node, Number):
        return node.value, fmpq(node.value.numerator, node.value.denominator)
    if isinstance(node, Symbol) and node.name not in places:
        return node.name, fixed[node.name]
    return None
