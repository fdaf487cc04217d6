"""Walks a tree without recursion, since a sum of 1000 terms is 1000 levels deep."""

from collections.abc import Callable, Sequence
from typing import TypeVar

from service.dynamics.formula.limits import MAX_NODES, require
from service.dynamics.formula.tree import Binary, Call, Negation, Tree

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


def post_order(tree: Tree) -> list[Tree]:
    """Return all nodes, operands before what they are operands of, left before right.

    Raises
    ------
    FormulaLimitError
        The tree has more than MAX_NODES nodes.
    """
    stack, nodes = [tree], []
    while stack:
        node = stack.pop()
        nodes.append(node)
        require(len(nodes), MAX_NODES, "nodes in the tree")
        stack.extend(children(node))
    nodes.reverse()
    return nodes


def fold_tree(tree: Tree, build: Callable[[int, Tree, Sequence[R]], R]) -> R:
    """Return what ``build(index, node, results of its operands)`` gives for the root.

    ``index`` counts the nodes in post-order.
    """
    results: list[R] = []
    for index, node in enumerate(post_order(tree)):
        arity = len(children(node))
        first = len(results) - arity
        operands = results[first:]
        del results[first:]
        results.append(build(index, node, operands))
    return results[0]
