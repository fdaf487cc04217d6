"""Prints a tree as the shortest readable text that parses back to it."""

from fractions import Fraction

from service.dynamics.formula.limits import MAX_CHARACTERS
from service.dynamics.formula.parser import ATOM, BINDING, SIGN
from service.dynamics.formula.tree import Binary, Call, Negation, Number, Tree

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
