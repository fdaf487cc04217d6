"""A client's formula with numbers in place of its parameters and moments."""

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction

from service.dynamics.body import RigidBody
from service.dynamics.formula.binding import bind
from service.dynamics.formula.errors import FormulaError
from service.dynamics.formula.parser import parse_located
from service.dynamics.formula.traversal import post_order
from service.dynamics.formula.tree import Symbol, Tree


def bound_formula(
    text: str,
    variables: Sequence[str],
    parameters: Mapping[str, Fraction],
    body: RigidBody,
    pointer: str,
) -> Tree:
    """Return the tree of ``text`` in the ``variables``, pi and numbers.

    Raises
    ------
    FormulaError
        The text is not a formula, is too large, has an unknown name or a
        constant without a value; with ``pointer``.
    MissingMomentError
        The formula has B, and the body does not.
    """
    return _bound(text, variables, parameters, body, pointer)


def named_formula(text: str, variables: Sequence[str], names: Iterable[str], body: RigidBody) -> Tree:
    """Return the tree of ``text`` with the ``names`` of its parameters left in; raises as bound_formula."""
    return _bound(text, (*variables, *names), {}, body, "/potential")


def _bound(
    text: str,
    variables: Sequence[str],
    parameters: Mapping[str, Fraction],
    body: RigidBody,
    pointer: str,
) -> Tree:
    try:
        located = parse_located(text)
        constants = {**parameters, "A": body.A, "C": body.C}
        if body.B is not None:
            constants["B"] = body.B
        elif any(isinstance(node, Symbol) and node.name == "B" for node in post_order(located.tree)):
            body.require_B("the formula")
        return bind(located.tree, constants, variables=variables, positions=located.positions)
    except FormulaError as error:
        raise error.at(pointer=pointer) from error
