"""Finds the numbers in which a potential is linear, where it is not linear in those that a sweep varies.

``a^3*g1 + b^2/g3^2`` is linear in a³ and b². Such a part of a formula, made of parameters and numbers alone,
is worked out exactly at every point and takes the place of a parameter: the compiler would have folded it
into the very same constant. All such parts become one list of operations on ratios, with equal ones once: to
walk trees takes longer than the arithmetic at their nodes.
"""

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from flint import fmpq

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError, FormulaError
from service.dynamics.exact import exact_number
from service.dynamics.formula.algebras.monomials import as_fmpq
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tree import (
    Binary,
    Call,
    Negation,
    Number,
    Symbol,
    Tree,
    fold_tree,
    format_tree,
    post_order,
)
from service.schemas.problem.trusted import potential_of
from service.schemas.reading.documents import with_values
from workers.sweeping.parameters.family import Path, degree_in

_Operation = Callable[[fmpq, fmpq], fmpq]


def _power(base: fmpq, exponent: fmpq) -> fmpq:
    power: fmpq = base ** int(exponent.p)
    return power


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
        return [registers[index] for index in self.results]


def parts_of(trees: Sequence[Tree], inputs: Sequence[str], fixed: Mapping[str, fmpq]) -> ExactParts:
    """Return the parts ``trees``, made of the symbols ``inputs``, of ``fixed`` numbers and of plain ones.

    Powers have whole exponents. Raises KeyError for another symbol.
    """
    indices = {name: index for index, name in enumerate(inputs)}
    constants: dict[Fraction | str, int] = {}
    numbers: list[fmpq] = []
    for node in (node for tree in trees for node in post_order(tree)):
        known = _constant(node, indices, fixed)
        if known is not None and known[0] not in constants:
            constants[known[0]] = len(indices) + len(numbers)
            numbers.append(known[1])
    first, steps = len(indices) + len(numbers), dict[tuple[_Operation, int, int], int]()

    def register(_: int, node: Tree, below: Sequence[int]) -> int:
        known = _constant(node, indices, fixed)
        if known is not None:
            return constants[known[0]]
        if isinstance(node, Symbol):
            return indices[node.name]
        if isinstance(node, Binary):
            step = _OPERATIONS[node.operator], below[0], below[1]
        else:
            step = _negative, below[0], below[0]
        return steps.setdefault(step, first + len(steps))

    results = tuple(fold_tree(tree, register) for tree in trees)
    return ExactParts(tuple(numbers), tuple(steps), results)


def _constant(
    node: Tree, indices: Mapping[str, int], fixed: Mapping[str, fmpq]
) -> tuple[Fraction | str, fmpq] | None:
    """Return a constant with what it is known by; None for what is none."""
    if isinstance(node, Number):
        return node.value, fmpq(node.value.numerator, node.value.denominator)
    if isinstance(node, Symbol) and node.name not in indices:
        return node.name, fixed[node.name]
    return None


LARGEST_EXPONENT = 64
"""Largest exponent of a coefficient; its exact digits grow with it."""


@dataclass(frozen=True, slots=True)
class Coefficients:
    """Numbers in which the potential is affine, as functions of those on the axes."""

    document: Mapping[str, object]
    """A potential in which they can be set."""
    paths: tuple[Path, ...]
    """Where, in the potential."""
    parts: ExactParts | None = None
    """Makes them of the numbers on the axes; None: the coefficients are these."""

    def at(self, row: Sequence[fmpq]) -> list[fmpq] | None:
        """Return the coefficients at a point with these numbers on the axes, None where one has no value."""
        if self.parts is None:
            return list(row)
        try:
            return self.parts.values(row)
        except ZeroDivisionError:
            return None


def coefficients_of(
    body: RigidBody, document: Mapping[str, object], paths: tuple[Path, ...], first: Sequence[Fraction]
) -> Coefficients | None:
    """Return the coefficients of a potential whose numbers at ``paths`` vary; None if they are not found.

    ``first`` are those numbers at one point, where the formula in the coefficients is compiled and held
    against the client's own.
    """
    plain = Coefficients(document, paths)
    if document.get("type") != "expression" or any(path[0] != "parameters" for path in paths):
        return plain
    names = tuple(path[-1] for path in paths)
    try:
        tree = parse(str(document.get("expression")))
        if degree_in(tree, set(names)) <= 1:
            return plain
        linear, made, parts, _ = split_formula(document, tree, names)
    except (FormulaError, ValueError):
        return None
    coefficients = Coefficients(linear, tuple(("parameters", name) for name in made), parts)
    values = coefficients.at([as_fmpq(number) for number in first])
    if values is None:
        return None
    shown = dict(zip(coefficients.paths, map(str, values), strict=True))
    own = dict(zip(paths, map(str, first), strict=True))
    try:
        compiled = potential_of(with_values(linear, dict(shown)), body).tape
        is_same = compiled == potential_of(with_values(document, dict(own)), body).tape
    except (DynamicsError, ValueError):
        return None
    return coefficients if is_same else None


def split_formula(
    document: Mapping[str, object],
    tree: Tree,
    names: Sequence[str],
    moving: Sequence[str] = (),
    moments: Sequence[str] = (),
) -> tuple[dict[str, object], tuple[str, ...], ExactParts, list[Tree]]:
    """Return a formula with a parameter for each of its largest parts of which one of ``names`` varies.

    So do the ``moving`` ones of the ``moments``. Return the names of these parameters, what makes them of
    ``names`` and ``moments``, and the parts too. Raises what reading numbers raises.
    """
    stated = document.get("parameters")
    kept = dict(stated) if isinstance(stated, dict) else {}
    split = SplitParameters((*names, *moving), {*kept, *names, *moments})
    holed = format_tree(fold_tree(tree, split.build)[0])
    kept = {name: value for name, value in kept.items() if name not in names}
    fixed = {name: as_fmpq(exact_number(value)) for name, value in kept.items()}
    made = tuple(split.names())
    parameters = {**kept, **dict.fromkeys(made, 1)}
    parts = parts_of(split.parts, (*names, *moments), fixed)
    return {**document, "expression": holed, "parameters": parameters}, made, parts, split.parts


class SplitParameters:
    """Replaces the largest parts that are made of parameters and numbers, of which one varies."""

    def __init__(self, varying: Sequence[str], known: set[str]) -> None:
        self.parts: list[Tree] = []
        self._varying, self._known = set(varying), known

    def names(self) -> list[str]:
        """Return the names of the parts, which are those of no parameter."""
        return [self._name(k) for k in range(len(self.parts))]

    def build(self, _: int, node: Tree, below: Sequence[tuple[Tree, bool, bool]]) -> tuple[Tree, bool, bool]:
        """Return the tree, whether it is exact, and whether it varies; see :func:`fold_tree`."""
        if isinstance(node, Number):
            return node, True, False
        if isinstance(node, Symbol):
            return node, node.name in self._known, node.name in self._varying
        is_exact = all(exact for _, exact, _ in below) and _is_exact(node)
        varies = any(varying for _, _, varying in below)
        trees = [tree if is_exact else self._part(tree, exact and varying) for tree, exact, varying in below]
        return _with_operands(node, trees), is_exact, varies

    def _part(self, tree: Tree, is_part: bool) -> Tree:
        if not is_part:
            return tree
        if tree not in self.parts:
            self.parts.append(tree)
        return Symbol(self._name(self.parts.index(tree)))

    def _name(self, index: int) -> str:
        name = f"coefficient{index}"
        while name in self._known:
            name += "_"
        return name


def _is_exact(node: Tree) -> bool:
    if isinstance(node, Call):
        return False
    if isinstance(node, Binary) and node.operator == "^":
        exponent = node.right.operand if isinstance(node.right, Negation) else node.right
        return (
            isinstance(exponent, Number)
            and exponent.value.denominator == 1
            and exponent.value <= LARGEST_EXPONENT
        )
    return True


def _with_operands(node: Tree, operands: Sequence[Tree]) -> Tree:
    if isinstance(node, Binary):
        return Binary(node.operator, operands[0], operands[1])
    if isinstance(node, Negation):
        return Negation(operands[0])
    if isinstance(node, Call):
        return Call(node.function, operands[0])
    return node
