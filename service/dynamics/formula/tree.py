"""The tree of a formula: five kinds of immutable, comparable nodes.

A tree is walked without recursion, since a sum of 1000 terms is 1000 levels deep.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, TypeVar

from service.dynamics.formula.limits import MAX_NODES, require

BinaryOperator = Literal["+", "-", "*", "/", "^"]
FunctionName = Literal["sqrt", "exp", "log", "sin", "cos", "tan", "abs"]

FUNCTIONS: tuple[FunctionName, ...] = ("sqrt", "exp", "log", "sin", "cos", "tan", "abs")
VARIABLES: tuple[str, str, str] = ("g1", "g2", "g3")
"""The Poisson variables: the space-fixed unit vector seen from the body."""


@dataclass(frozen=True, slots=True)
class Number:
    """A non-negative decimal, exact. Ratios and signs are Binary and Negation."""

    value: Fraction

    def __post_init__(self) -> None:
        # While a tape is compiled, an int is a register: one that slips in would be taken for it.
        if not isinstance(self.value, Fraction):
            raise TypeError(f"a Number holds a Fraction, not {self.value!r}")


@dataclass(frozen=True, slots=True)
class Symbol:
    """A variable, a parameter, a moment of inertia or ``pi``."""

    name: str


@dataclass(frozen=True, slots=True)
class Negation:
    """Minus its operand."""

    operand: "Tree"


@dataclass(frozen=True, slots=True)
class Binary:
    """Two operands joined by one of ``+ - * / ^``."""

    operator: BinaryOperator
    left: "Tree"
    right: "Tree"


@dataclass(frozen=True, slots=True)
class Call:
    """A function of one argument."""

    function: FunctionName
    argument: "Tree"


Tree = Number | Symbol | Negation | Binary | Call
_OF_ONE = (Negation, Call)


R = TypeVar("R")


def children(node: Tree) -> tuple[Tree, ...]:
    """Return the operands of ``node`` from left to right."""
    if isinstance(node, Binary):
        return (node.left, node.right)
    if isinstance(node, Negation):
        return (node.operand,)
    if isinstance(node, Call):
        return (node.argument,)
    return ()


def with_operands(node: Tree, operands: Sequence[Tree]) -> Tree:
    """Return a node like ``node`` with other operands."""
    match node:
        case Binary(operator):
            return Binary(operator, operands[0], operands[1])
        case Negation():
            return Negation(operands[0])
        case Call(function):
            return Call(function, operands[0])
    return node


def post_order(tree: Tree) -> list[Tree]:
    """Return all nodes, operands before what they are operands of, left before right.

    Raises
    ------
    FormulaLimitError
        The tree has more than MAX_NODES nodes.
    """
    # Every formula passes through here more than once.
    stack, nodes = [tree], list[Tree]()
    while stack:
        node = stack.pop()
        nodes.append(node)
        if isinstance(node, Binary):
            stack += (node.left, node.right)
            if len(nodes) > MAX_NODES:
                require(len(nodes), MAX_NODES, "nodes in the tree")
        elif isinstance(node, Negation):
            stack.append(node.operand)
        elif isinstance(node, Call):
            stack.append(node.argument)
    require(len(nodes), MAX_NODES, "nodes in the tree")
    nodes.reverse()
    return nodes


def fold_tree(tree: Tree, build: Callable[[int, Tree, Sequence[R]], R]) -> R:
    """Return what ``build(index, node, results of its operands)`` gives for the root.

    ``index`` counts the nodes in post-order.
    """
    results: list[R] = []
    for index, node in enumerate(post_order(tree)):
        if isinstance(node, Binary):
            right = results.pop()
            results[-1] = build(index, node, (results[-1], right))
        elif isinstance(node, _OF_ONE):
            results[-1] = build(index, node, (results[-1],))
        else:
            results.append(build(index, node, ()))
    return results[0]
