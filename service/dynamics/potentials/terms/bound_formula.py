"""A client's formula, its names checked, with numbers in place of its parameters and moments."""

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.errors import FormulaError
from service.dynamics.formula.parameters import PI, bind
from service.dynamics.formula.parser import is_name, parse_located
from service.dynamics.formula.tree import FUNCTIONS, VARIABLES, Symbol, Tree, post_order

PARAMETERS_POINTER = "/potential/parameters"
MOMENTS = ("A", "B", "C")

RESERVED_NAMES = frozenset((*VARIABLES, *MOMENTS, PI, *FUNCTIONS))
"""Names that mean something already and cannot be parameters."""


class ParameterNameError(DynamicsError):
    """A parameter whose name is taken, or is not a name of the grammar."""

    code = "parameter_name"


def require_parameter_names(parameters: Iterable[str]) -> None:
    """Raise ParameterNameError, pointing at the parameter, if a name cannot be used."""
    for name in parameters:
        if name in RESERVED_NAMES:
            reason = f"{name!r} cannot be a parameter: it has a meaning already"
        elif not is_name(name):
            reason = f"{name[:40]!r} is not a name: a letter or '_', then letters, digits and '_'"
        else:
            continue
        # A pointer spells "~" and "/" as "~0" and "~1" (RFC 6901).
        place = name.replace("~", "~0").replace("/", "~1")
        raise ParameterNameError(reason, pointer=f"{PARAMETERS_POINTER}/{place}")


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
