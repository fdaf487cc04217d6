"""Replaces the names of parameters and moments in a formula by exact numbers."""

from collections.abc import Mapping, Sequence
from fractions import Fraction

from service.dynamics.formula.errors import FormulaError, UnknownNameError
from service.dynamics.formula.folding import fold_binary, fold_call
from service.dynamics.formula.printer import exact_tree
from service.dynamics.formula.traversal import fold_tree
from service.dynamics.formula.tree import VARIABLES, Binary, Call, Negation, Number, Symbol, Tree

PI = "pi"
"""The one name that always means something and is not an exact number."""

MAX_LISTED = 40
"""Names listed in a message."""


def bind(
    tree: Tree,
    constants: Mapping[str, Fraction],
    *,
    variables: Sequence[str] = VARIABLES,
    positions: Sequence[int] | None = None,
) -> Tree:
    """Return ``tree`` with every name of ``constants`` replaced by its number.

    Only ``variables`` and ``pi`` remain as symbols. All parts without variables
    are computed once, so that a constant without a value is refused here,
    where the place in the text is known.

    Parameters
    ----------
    positions
        Offset of each node in the text, in post-order
        (:class:`~service.dynamics.formula.parser.LocatedTree`).

    Raises
    ------
    UnknownNameError
        A name that is not known; the message lists those that are.
    UndefinedConstantError
        A constant part has no value (1/0, log(-1)).
    FormulaLimitError
        A constant part, or a constant exponent, is beyond the limits.
    """
    replaced = {name: exact_tree(value) for name, value in constants.items()}

    def build(index: int, node: Tree, operands: Sequence[_Bound]) -> _Bound:
        try:
            return _bound(node, operands)
        except FormulaError as error:
            raise error.at(position=None if positions is None else positions[index]) from None

    def _bound(node: Tree, operands: Sequence[_Bound]) -> _Bound:
        if isinstance(node, Number):
            return node, node.value
        if isinstance(node, Symbol):
            if node.name in replaced:
                return replaced[node.name], constants[node.name]
            if node.name in variables or node.name == PI:
                return node, None
            known = ", ".join([*variables, PI, *sorted(replaced)][:MAX_LISTED])
            raise UnknownNameError(f"{node.name!r} is not known here; known are {known}")
        trees = [operand[0] for operand in operands]
        values = [operand[1] for operand in operands]
        if isinstance(node, Negation):
            return Negation(trees[0]), None if values[0] is None else -values[0]
        if isinstance(node, Call):
            value = None if values[0] is None else fold_call(node.function, values[0])
            return Call(node.function, trees[0]), value
        return Binary(node.operator, trees[0], trees[1]), fold_binary(node.operator, values[0], values[1])

    return fold_tree(tree, build)[0]


_Bound = tuple[Tree, Fraction | None]
"""A bound subtree and its exact value, if it is a rational constant."""
