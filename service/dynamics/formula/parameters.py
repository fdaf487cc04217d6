"""Parameters of a client's formula: names that are checked, exact numbers in their place, and their terms.

Terms are split off formulas that are polynomial in their parameters.
"""

import difflib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError, FormulaError, UnknownNameError
from service.dynamics.formula.parser import is_name, parse_located
from service.dynamics.formula.tree import (
    FUNCTIONS,
    VARIABLES,
    Binary,
    BinaryOperator,
    Call,
    Negation,
    Number,
    Symbol,
    Tree,
    exact_tree,
    fold_binary,
    fold_call,
    fold_tree,
    post_order,
)

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
            near = difflib.get_close_matches(node.name, [*variables, *replaced], n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"add {node.name} = … to the parameters"
            raise UnknownNameError(f"{node.name!r} is not known here; known are {known}; {hint}")
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
MAX_PARTS = 12
"""Products of parameters in one formula."""
_LARGEST_POWER = 8
_ONE, _ZERO = Number(Fraction(1)), Number(Fraction(0))
Product = tuple[int, ...]
"""Exponents of the parameters, in their order."""
_Sum = dict[Product, Tree]


@dataclass(frozen=True, slots=True)
class Part:
    """One term Π a^k · coefficient; ``factor`` is the product as text, empty for 1."""

    factor: str
    coefficient: Tree


class _InseparableError(Exception):
    """A parameter stands where the formula is no polynomial in it; ``names`` are those to blame."""

    def __init__(self, names: Collection[str]) -> None:
        super().__init__("no polynomial in the parameters")
        self.names = frozenset(names)


def split_by_parameters(tree: Tree, values: Mapping[str, Fraction]) -> tuple[Part, ...] | None:
    """Return the parts whose sum is ``tree``; None if they are more than MAX_PARTS, or have no parameters.

    A parameter inside a function or an exponent gets its number, as does one
    that divides by a sum. Products that are 0 with these numbers are left out.
    """
    free = [name for name in values if values[name]]
    while free:
        constants = {name: value for name, value in values.items() if name not in free}
        try:
            found = _expand(tree, free, constants)
        except _InseparableError as error:
            if not error.names:
                return None
            free = [name for name in free if name not in error.names]
            continue
        has_names = any(any(product) for product in found)
        if not has_names or len(found) > MAX_PARTS:
            return None
        return tuple(Part(_text(free, product), part) for product, part in found.items())
    return None


def coefficients_of(tree: Tree, names: Sequence[str]) -> dict[Product, Tree] | None:
    """Return the coefficient of every product of ``names``, whose values do not matter.

    None if the tree is no polynomial in them (negative powers are fine), or one of too many terms.
    """
    try:
        return _expand(tree, names, {})
    except _InseparableError:
        return None


def _expand(tree: Tree, free: Sequence[str], constants: Mapping[str, Fraction]) -> _Sum:
    one: Product = (0,) * len(free)
    units = {name: tuple(int(name == other) for other in free) for name in free}

    def names_in(*sums: _Sum) -> set[str]:
        return {
            name for terms in sums for product in terms for name, k in zip(free, product, strict=True) if k
        }

    def build(_: int, node: Tree, operands: Sequence[_Sum]) -> _Sum:
        match node:
            case Symbol(name) if name in units:
                return {units[name]: _ONE}
            case Symbol(name):
                # A term that is 0 is taken away whole, also where the rest of it has no value.
                return (
                    {}
                    if constants.get(name) == 0
                    else {one: bind(node, constants) if name in constants else node}
                )
            case Negation():
                return {product: Negation(part) for product, part in operands[0].items()}
            case Call(function):
                if names_in(operands[0]):
                    raise _InseparableError(names_in(operands[0]))
                return {one: Call(function, operands[0].get(one, _ZERO))}
            case Binary(operator):
                left, right = operands
                return combine(operator, left, right)
        return {one: node}

    def combine(operator: BinaryOperator, left: _Sum, right: _Sum) -> _Sum:
        if operator in "+-":
            total = dict(left)
            for product, part in right.items():
                if product in total:
                    total[product] = Binary(operator, total[product], part)
                else:
                    total[product] = part if operator == "+" else Negation(part)
            return _bounded(total, names_in(left, right))
        if operator == "*":
            return _multiply(left, right, names_in(left, right))
        if operator == "/":
            if len(right) != 1:
                raise _InseparableError(names_in(right))
            ((below, divisor),) = right.items()
            return {
                tuple(a - b for a, b in zip(product, below, strict=True)): _quotient(part, divisor)
                for product, part in left.items()
            }
        return power(left, right)

    def power(base: _Sum, exponent: _Sum) -> _Sum:
        if names_in(exponent):
            raise _InseparableError(names_in(exponent))
        if not names_in(base):
            return {one: Binary("^", base.get(one, _ZERO), exponent.get(one, _ZERO))}
        n = whole_number(exponent.get(one, _ZERO))
        if n is None or abs(n) > _LARGEST_POWER or (n < 0 and len(base) != 1):
            raise _InseparableError(names_in(base))
        if len(base) == 1:
            ((product, part),) = base.items()
            raised = part if part == _ONE else Binary("^", part, exponent[one])
            return {tuple(n * k for k in product): raised}
        result: _Sum = {one: _ONE}
        for _ in range(n):
            result = _multiply(result, base, names_in(base))
        return result

    return fold_tree(tree, build)


def _multiply(left: _Sum, right: _Sum, names: Collection[str]) -> _Sum:
    total: _Sum = {}
    for one, first in left.items():
        for other, second in right.items():
            product = tuple(a + b for a, b in zip(one, other, strict=True))
            part = second if first == _ONE else first if second == _ONE else Binary("*", first, second)
            total[product] = Binary("+", total[product], part) if product in total else part
    return _bounded(total, names)


def _bounded(terms: _Sum, names: Collection[str]) -> _Sum:
    if len(terms) > MAX_PARTS:
        raise _InseparableError(names)
    return terms


def _quotient(part: Tree, divisor: Tree) -> Tree:
    return part if divisor == _ONE else Binary("/", part, divisor)


def whole_number(exponent: Tree) -> int | None:
    """Return a whole number that is written as one, None for anything else."""
    match exponent:
        case Number(value) if value.denominator == 1:
            return value.numerator
        case Negation(Number(value)) if value.denominator == 1:
            return -value.numerator
    return None


def _text(names: Sequence[str], product: Product) -> str:
    return "*".join(
        name if k == 1 else f"{name}^{k}" if k > 0 else f"{name}^({k})"
        for name, k in zip(names, product, strict=True)
        if k
    )


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


def named_formula(text: str, variables: Sequence[str], names: Iterable[str], body: RigidBody) -> Tree:
    """Return the tree of ``text`` with the ``names`` of its parameters left in; raises as bound_formula."""
    return bound_formula(text, (*variables, *names), {}, body, "/potential")
