"""The tree of a formula: five kinds of nodes, limits of its size, exact constants inside it, and its text.

A tree is walked without recursion, since a sum of 1000 terms is 1000 levels deep.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import isqrt
from typing import Literal, TypeVar

from service.dynamics.errors import FormulaLimitError, UndefinedConstantError

R = TypeVar("R")

MAX_CHARACTERS = 4000
"""Length of the text."""
MAX_TOKENS = 2500
"""Numbers, names, operators and parentheses: room for a sum of 1000 terms."""
MAX_DEPTH = 60
"""Parentheses, calls, signs and exponents inside each other. Flat sums and products are free."""
MAX_NODES = 10_000
"""Nodes of any tree, also of one built by a family or grown by binding."""
MAX_NAME = 60
"""Characters of one name."""
MAX_EXPONENT = 1000
"""Absolute value of a constant exponent."""
MAX_BITS = 4096
"""Bits of the numerator or the denominator of a folded constant; literals have fewer
(:data:`service.dynamics.exact.MAX_DIGITS` and ``MAX_EXPONENT``)."""


def require(count: int, limit: int, what: str, *, position: int | None = None) -> None:
    """Raise FormulaLimitError if ``count`` exceeds ``limit``; ``what`` is a plural noun."""
    if count > limit:
        raise FormulaLimitError(f"{count} {what}; at most {limit} are accepted", position=position)


BinaryOperator = Literal["+", "-", "*", "/", "^"]
FunctionName = Literal["sqrt", "exp", "log", "sin", "cos", "tan", "abs"]
FUNCTIONS: tuple[FunctionName, ...] = ("sqrt", "exp", "log", "sin", "cos", "tan", "abs")
SUM, PRODUCT, SIGN, POWER, ATOM = 1, 2, 3, 4, 5
"""How tightly the node kinds bind."""
BINDING: dict[BinaryOperator, int] = {"+": SUM, "-": SUM, "*": PRODUCT, "/": PRODUCT, "^": POWER}
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


def fold_binary(
    operator: BinaryOperator, left: Fraction | None, right: Fraction | None, *, formally: bool = True
) -> Fraction | None:
    """Return the exact value of ``left operator right``, or None if it is not a rational constant.

    An operand that is not constant is None. The formal rules 0·x = 0, 0/x = 0,
    x^0 = 1 and 1^x = 1 are used: a parameter that is zero takes its term away,
    also where the rest of the term is infinite. Not so if ``formally`` is false.

    Raises
    ------
    UndefinedConstantError
        A division by zero.
    FormulaLimitError
        The value, or the exponent, is larger than the limits.
    """
    if operator == "^" and right is not None:
        require_exponent(right)
    if operator == "/" and right == 0:
        raise UndefinedConstantError("a division by zero")
    if left is None or right is None:
        return _fold_formally(operator, left, right) if formally else None
    if operator == "+":
        return _bounded(left + right)
    if operator == "-":
        return _bounded(left - right)
    if operator == "*":
        return _bounded(left * right)
    if operator == "/":
        return _bounded(left / right)
    return fold_power(left, right)


def _fold_formally(
    operator: BinaryOperator, left: Fraction | None, right: Fraction | None
) -> Fraction | None:
    is_zero = left is not None and not left
    if (operator == "*" and (is_zero or (right is not None and not right))) or (operator == "/" and is_zero):
        return Fraction(0)
    if operator == "^" and (left == 1 or right == 0):
        return Fraction(1)
    return None


def fold_power(base: Fraction, exponent: Fraction) -> Fraction | None:
    """Return ``base^exponent`` if it is rational and plainly so, else None; raises as fold_binary."""
    if base == 0 and exponent < 0:
        raise UndefinedConstantError("a division by zero: 0 to a negative power")
    if base < 0 and exponent.denominator != 1:
        raise UndefinedConstantError(f"the power {exponent} of the negative number {_short(base)}")
    if exponent.denominator == 2:
        root = _square_root(base)
        if root is None:
            return None
        base, exponent = root, exponent * 2
    if exponent.denominator != 1:
        return base if base in (0, 1) else None
    bits = max(base.numerator.bit_length(), base.denominator.bit_length())
    # |±1| has one bit and never grows, hence the subtraction.
    if (bits - 1) * abs(exponent.numerator) > MAX_BITS:
        raise FormulaLimitError(f"the power {_short(base)}^{exponent} has more than {MAX_BITS} bits")
    return _bounded(base**exponent.numerator)


def fold_call(function: FunctionName, argument: Fraction) -> Fraction | None:
    """Return the exact value of a function where it is rational and plainly so; raises as fold_binary."""
    if function == "abs":
        return abs(argument)
    if function == "sqrt":
        return fold_power(argument, Fraction(1, 2))
    if function == "log" and argument <= 0:
        raise UndefinedConstantError(f"the logarithm of {_short(argument)}")
    return None


def require_exponent(exponent: Fraction) -> None:
    """Raise FormulaLimitError if a constant exponent is too large."""
    if abs(exponent.numerator) > MAX_EXPONENT * exponent.denominator:
        raise FormulaLimitError(f"the exponent {_short(exponent)} is beyond ±{MAX_EXPONENT}")


def _square_root(value: Fraction) -> Fraction | None:
    root = Fraction(isqrt(value.numerator), isqrt(value.denominator))
    return root if root * root == value else None


def _bounded(value: Fraction) -> Fraction:
    if max(value.numerator.bit_length(), value.denominator.bit_length()) > MAX_BITS:
        raise FormulaLimitError(f"a constant of more than {MAX_BITS} bits")
    return value


def _short(value: Fraction) -> str:
    text = str(value)
    return text if len(text) <= 40 else f"{text[:40]}…"


_PLAIN_LENGTH = 20
"""Decimals up to this many characters are written out, longer ones with an exponent."""


def format_tree(tree: Tree) -> str:
    """Return a text with as few parentheses as possible; ``parse`` of it gives ``tree``.

    The text has spaces around sums if that keeps it within the limit of
    characters, and is otherwise as short as the tree allows: what prints a
    parsed formula is never longer than what was parsed.
    """
    text = _format(tree, compact=False)
    return text if len(text) <= MAX_CHARACTERS else _format(tree, compact=True)


def exact_tree(value: Fraction) -> Tree:
    """Return the tree of an exact number: a decimal, else a ratio of integers, with its sign."""
    if value.numerator < 0:
        return Negation(exact_tree(-value)) if _is_decimal(value) else _ratio(value)
    return Number(value) if _is_decimal(value) else _ratio(value)


def _ratio(value: Fraction) -> Tree:
    numerator: Tree = Number(Fraction(abs(value.numerator)))
    if value.numerator < 0:
        numerator = Negation(numerator)
    return Binary("/", numerator, Number(Fraction(value.denominator)))


def _format(tree: Tree, *, compact: bool) -> str:
    # An explicit stack: texts to be written, and trees with the binding they need.
    pieces: list[str] = []
    stack: list[str | tuple[Tree, int]] = [(tree, 0)]
    while stack:
        item = stack.pop()
        if isinstance(item, str):
            pieces.append(item)
            continue
        node, floor = item
        if isinstance(node, Number) and (node.value < 0 or not _is_decimal(node.value)):
            node = exact_tree(node.value)
        if _binding(node) < floor:
            stack += [")", (node, 0), "("]
        elif isinstance(node, Number):
            pieces.append(_decimal(node.value, compact=compact))
        elif isinstance(node, Negation):
            stack += [(node.operand, SIGN), "-"]
        elif isinstance(node, Call):
            stack += [")", (node.argument, 0), f"{node.function}("]
        elif isinstance(node, Binary):
            own = BINDING[node.operator]
            operator = f" {node.operator} " if node.operator in "+-" and not compact else node.operator
            if node.operator == "^":
                stack += [(node.right, SIGN), operator, (node.left, ATOM)]
            else:
                stack += [(node.right, own + 1), operator, (node.left, own)]
        else:
            pieces.append(node.name)
    return "".join(pieces)


def _binding(node: Tree) -> int:
    if isinstance(node, Binary):
        return BINDING[node.operator]
    return SIGN if isinstance(node, Negation) else ATOM


def _is_decimal(value: Fraction) -> bool:
    """Tell whether ``value`` is a decimal of acceptable length (integers always are)."""
    return value.denominator == 1 or _decimal_exponent(value.denominator) is not None


def _decimal_exponent(denominator: int) -> int | None:
    """Return the least e with ``denominator`` dividing 10^e, or None if there is none to speak of."""
    twos = (denominator & -denominator).bit_length() - 1
    rest, fives = denominator >> twos, 0
    while rest % 5 == 0:
        rest, fives = rest // 5, fives + 1
    return max(twos, fives) if rest == 1 else None


def _decimal(value: Fraction, *, compact: bool) -> str:
    digits_after = _decimal_exponent(value.denominator) or 0
    mantissa = str(value.numerator * (10**digits_after // value.denominator))
    stripped = mantissa.rstrip("0") or "0"
    exponent = len(mantissa) - len(stripped) - digits_after if stripped != "0" else 0
    scientific = f"{stripped}e{exponent}" if exponent else stripped
    if digits_after:
        whole, part = mantissa[:-digits_after], mantissa[-digits_after:].rjust(digits_after, "0")
        plain = f"{whole or ('' if compact else '0')}.{part}"
    else:
        plain = mantissa
    if compact:
        return min(plain, scientific, key=len)
    return plain if len(plain) <= _PLAIN_LENGTH else scientific
