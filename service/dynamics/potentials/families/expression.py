"""A potential given by a client's formula."""

from collections.abc import Mapping
from fractions import Fraction
from functools import lru_cache

from service.dynamics.body import RigidBody
from service.dynamics.formula.errors import FormulaError
from service.dynamics.formula.parameters import bind
from service.dynamics.formula.parser import LocatedTree, parse, parse_located
from service.dynamics.formula.printer import exact_tree
from service.dynamics.formula.tree import Symbol, Tree, post_order
from service.dynamics.potentials.potential import FormulaPotential, Potential
from service.dynamics.potentials.terms.bound_formula import require_parameter_names

FAMILY = "expression"
EXPRESSION_POINTER = "/potential/expression"
FORMULAS_CACHED = 64
"""Formulas that are remembered with their parameters and moments: lists and sweeps ask for the same ones."""


def expression_potential(text: str, parameters: Mapping[str, Fraction], body: RigidBody) -> Potential:
    """Return the potential of a formula in g1, g2, g3, the parameters and the moments A, B, C.

    Raises
    ------
    FormulaError
        The text is not a formula, is too large, has an unknown name or a
        constant without a value; the pointer is EXPRESSION_POINTER.
    ParameterNameError
        A parameter cannot have its name.
    MissingMomentError
        The formula has B, and the body does not.
    """
    require_parameter_names(parameters)
    try:
        return _made(text, tuple(parameters.items()), body).alone()
    except FormulaError as error:
        raise error.at(pointer=EXPRESSION_POINTER) from error


@lru_cache(maxsize=FORMULAS_CACHED)
def _made(text: str, parameters: tuple[tuple[str, Fraction], ...], body: RigidBody) -> FormulaPotential:
    numbers = {"A": body.A, "B": body.B, "C": body.C, **dict(parameters)}

    def symbol(name: str) -> Tree:
        number = numbers.get(name)
        return Symbol(name) if number is None else exact_tree(number)

    try:
        return Potential.from_tree(parse(text, symbol), FAMILY)
    except FormulaError:
        # Where it is at fault is not known of a formula whose names are numbers already.
        located = parse_located(text)
        constants = dict(parameters) | _moments(located, body)
        bind(located.tree, constants, positions=located.positions)
        raise


def _moments(located: LocatedTree, body: RigidBody) -> dict[str, Fraction]:
    """Return the moments that are known, insisting on B where the formula has it."""
    moments = {"A": body.A, "C": body.C}
    if any(isinstance(node, Symbol) and node.name == "B" for node in post_order(located.tree)):
        moments["B"] = body.require_B("the formula")
    elif body.B is not None:
        moments["B"] = body.B
    return moments
