"""The setting of a question: moments and a potential with letters in them, and formulas in its variables."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from service.dynamics.errors import DynamicsError, FormulaError, ImpossibleInertiaError
from service.dynamics.formula.parameters import MOMENTS, bind, require_parameter_names
from service.dynamics.formula.parser import parse, parse_located
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.formula.tree import (
    VARIABLES,
    Binary,
    Symbol,
    Tree,
    exact_tree,
    fold_tree,
    post_order,
    with_operands,
)

VELOCITIES = ("p", "q", "r")
STATE = (*VELOCITIES, *VARIABLES)
"""p, q, r, g1, g2, g3."""
POTENTIAL_POINTER = "/potential/expression"


@dataclass(frozen=True, slots=True)
class LetteredSetting:
    """A body and a potential, in which ``letters`` stand for any numbers; moments are positive.

    ``moments`` are formulas in the letters, ``potential`` one in g1, g2, g3 and the letters.
    """

    letters: tuple[str, ...]
    moments: tuple[Tree, Tree, Tree]
    potential: Tree
    numbers: Mapping[str, Fraction]
    """The parameters that have numbers."""

    def read(self, text: str, pointer: str) -> Tree:
        """Return a formula in the state, the letters and the moments; raises FormulaError at ``pointer``."""
        return _read(text, (*STATE, *self.letters), self.numbers, self._given, pointer)

    def tape(self, tree: Tree) -> Tape:
        """Return a tape over p, q, r, g1, g2, g3 and the letters."""
        return compile_tape(tree, (*STATE, *self.letters))

    @property
    def energy(self) -> Tree:
        """The energy H."""
        kinetic = substituted(parse("(A*p^2 + B*q^2 + C*r^2)/2"), self._given)
        return Binary("+", kinetic, self.potential)

    @property
    def areas(self) -> Tree:
        """The areas integral I3."""
        return substituted(parse("A*p*g1 + B*q*g2 + C*r*g3"), self._given)

    @property
    def _given(self) -> dict[str, Tree]:
        return dict(zip(MOMENTS, self.moments, strict=True))


def read_setting(
    moments: Mapping[str, str | Fraction],
    potential: str,
    parameters: Mapping[str, Fraction | None] | None = None,
) -> LetteredSetting:
    """Return the setting of a document.

    Parameters
    ----------
    moments
        ``A``, ``B``, ``C``: numbers, or formulas in each other and in free parameters (``"2*C"``). Those
        left out are letters.
    potential
        A formula in g1, g2, g3, the parameters and the moments.
    parameters
        Their numbers; None leaves a parameter free, as a letter.

    Raises
    ------
    FormulaError
        At ``/potential/expression`` or ``/body/A``, ...
    ParameterNameError
        A parameter cannot have its name: p, q, r are names of the state.
    ImpossibleInertiaError
        A number that is not positive.
    """
    parameters = parameters or {}
    require_parameter_names(parameters)
    for name in VELOCITIES:
        if name in parameters:
            reason = f"{name!r} cannot be a parameter: it is a component of the angular velocity"
            raise DynamicsError(reason, pointer=f"/potential/parameters/{name}")
    numbers = {name: value for name, value in parameters.items() if value is not None}
    free = [name for name in MOMENTS if name not in moments]
    letters = (*free, *(name for name, value in parameters.items() if value is None))
    given: dict[str, Tree] = {name: Symbol(name) for name in free}
    waiting = [name for name in MOMENTS if name in moments]
    while waiting:
        # A moment may be a formula in others, in any order, but not in a circle.
        ready = [name for name in waiting if not _names(moments[name]) & (set(waiting) - {name})]
        if not ready or any(name in _names(moments[name]) for name in ready):
            raise FormulaError(
                "moments are formulas in each other in a circle", pointer=f"/body/{waiting[0]}"
            )
        for name in ready:
            value = moments[name]
            if isinstance(value, Fraction) and value <= 0:
                raise ImpossibleInertiaError(
                    f"{name} = {value} is not positive; a moment of inertia is > 0", pointer=f"/body/{name}"
                )
            pointer = f"/body/{name}"
            given[name] = (
                exact_tree(value)
                if isinstance(value, Fraction)
                else _moment(_read(value, letters, numbers, given, pointer), letters, pointer)
            )
        waiting = [name for name in waiting if name not in ready]
    field = _read(potential, (*VARIABLES, *letters), numbers, given, POTENTIAL_POINTER)
    return LetteredSetting(letters, (given["A"], given["B"], given["C"]), field, numbers)


def substituted(tree: Tree, images: Mapping[str, Tree]) -> Tree:
    """Return the tree with names replaced by their images."""

    def build(_: int, node: Tree, operands: Sequence[Tree]) -> Tree:
        return images.get(node.name, node) if isinstance(node, Symbol) else with_operands(node, operands)

    return fold_tree(tree, build)


def _names(value: str | Fraction) -> set[str]:
    if isinstance(value, Fraction):
        return set()
    return {node.name for node in post_order(parse(value)) if isinstance(node, Symbol)}


def _moment(tree: Tree, letters: Sequence[str], pointer: str) -> Tree:
    for each in compile_tape(tree, letters).instructions:
        is_root = each.operation == "power" and each.number is not None and each.number.denominator > 1
        if is_root or each.operation in ("call", "general_power"):
            reason = "a moment is a rational function of letters, without roots and functions"
            raise FormulaError(reason, pointer=pointer)
    return tree


def _read(
    text: str,
    variables: Sequence[str],
    numbers: Mapping[str, Fraction],
    given: Mapping[str, Tree],
    pointer: str,
) -> Tree:
    try:
        located = parse_located(text)
        names = tuple(dict.fromkeys((*variables, *given)))
        tree = substituted(bind(located.tree, numbers, variables=names, positions=located.positions), given)
        # A constant part without a value is found where the moments are numbers.
        compile_tape(tree, variables)
    except FormulaError as error:
        raise error.at(pointer=pointer) from error
    return tree
