"""Turns the tree of a formula into boxes, which are the same for all formats.

Boxes say where bars, roots, scripts and parentheses stand.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction as Rational

from service.dynamics.formula.tree import (
    ATOM,
    BINDING,
    Binary,
    Call,
    Negation,
    Number,
    Symbol,
    Tree,
    fold_tree,
    format_tree,
    post_order,
)


@dataclass(frozen=True, slots=True)
class Name:
    """A variable, a parameter or the name of a function.

    ``letters`` is one Unicode letter, or a word; ``latex`` the same in LaTeX. Words are upright.
    """

    letters: str
    latex: str
    subscript: str = ""
    is_upright: bool = False
    """True for a single letter that is not in italics."""


@dataclass(frozen=True, slots=True)
class Numeral:
    """Digits, perhaps with a decimal point."""

    digits: str


@dataclass(frozen=True, slots=True)
class Sign:
    """An operator, by its character: ``+ − ± = / ·``, or empty for a product without a sign."""

    character: str
    is_prefix: bool = False


@dataclass(frozen=True, slots=True)
class RowBox:
    """Boxes side by side."""

    items: tuple["Box", ...]


@dataclass(frozen=True, slots=True)
class Fraction:
    """Numerator over denominator."""

    numerator: "Box"
    denominator: "Box"


@dataclass(frozen=True, slots=True)
class RootBox:
    """The root of a degree, 2 for the square root."""

    radicand: "Box"
    degree: int = 2


@dataclass(frozen=True, slots=True)
class Power:
    """A base with an exponent."""

    base: "Box"
    exponent: "Box"


@dataclass(frozen=True, slots=True)
class Fenced:
    """A box between parentheses ``()`` or bars ``||``."""

    item: "Box"
    fences: str = "()"


@dataclass(frozen=True, slots=True)
class Integral:
    """∫ over what follows, which ends with the differential of the variable."""

    integrand: "Box"


Box = Name | Numeral | Sign | RowBox | Fraction | RootBox | Power | Fenced | Integral


_FUNCTIONS = {
    "log": Name("ln", r"\ln"),
    "sin": Name("sin", r"\sin"),
    "cos": Name("cos", r"\cos"),
    "tan": Name("tan", r"\tan"),
}
_EULER = Name("e", r"\mathrm{e}", is_upright=True)
_LARGEST_DEGREE = 9
"""Roots of higher degrees are written as powers."""


@dataclass(frozen=True, slots=True)
class _Part:
    """A box, with what has to be known of it to put it into another one."""

    box: Box
    binding: int
    value: Rational | None = None
    """If it is a number as it stands."""
    begins_with_digit: bool = False
    negated: "_Part | None" = None
    """The part behind the minus sign, if it begins with one."""
    call: tuple[Name, Box] | None = None
    """The function and its argument, if it is a function by name: its powers are written sin² x."""


def lay_out(tree: Tree, names: Mapping[str, Box]) -> Box:
    """Return the boxes of a formula, whose symbols have ``names``."""
    return fold_tree(tree, lambda _, node, parts: _laid(node, parts, names)).box


def symbols_of(tree: Tree) -> set[str]:
    """Return the names in a formula."""
    return {node.name for node in post_order(tree) if isinstance(node, Symbol)}


def _laid(node: Tree, parts: Sequence[_Part], names: Mapping[str, Box]) -> _Part:
    match node:
        case Number(value):
            return _number(value)
        case Symbol(name):
            return _Part(names[name], ATOM)
        case Negation():
            return _negative(parts[0])
        case Call(function):
            return _call(function, parts[0])
        case Binary(operator):
            return _binary(operator, parts[0], parts[1])


def _number(value: Rational) -> _Part:
    text = format_tree(Number(value))
    mantissa, _, exponent = text.partition("e")
    if not exponent:
        return _Part(Numeral(text), ATOM, value, begins_with_digit=True)
    ten = Power(Numeral("10"), _signed(exponent))
    if mantissa == "1":
        return _Part(ten, BINDING["^"], value, begins_with_digit=True)
    return _Part(RowBox((Numeral(mantissa), Sign("·"), ten)), BINDING["*"], value, begins_with_digit=True)


def _signed(digits: str) -> Box:
    if digits.startswith("-"):
        return RowBox((Sign("−", is_prefix=True), Numeral(digits[1:])))
    return Numeral(digits)


def _call(function: str, argument: _Part) -> _Part:
    if function == "sqrt":
        return _Part(RootBox(argument.box), BINDING["*"])
    if function == "abs":
        return _Part(Fenced(argument.box, "||"), ATOM)
    if function == "exp":
        return _Part(Power(_EULER, argument.box), BINDING["^"])
    call = (_FUNCTIONS[function], Fenced(argument.box))
    return _Part(RowBox(call), BINDING["^"], call=call)


def _negative(part: _Part) -> _Part:
    value = None if part.value is None else -part.value
    box = RowBox((Sign("−", is_prefix=True), *_items(_bound(part, BINDING["*"]))))
    return _Part(box, BINDING["+"], value, negated=part)


def _binary(operator: str, left: _Part, right: _Part) -> _Part:
    match operator:
        case "+" | "-":
            return _sum(operator, left, right)
        case "*" | "/" if left.negated is not None:
            # Numbers and products carry their sign in front: −a/b, not (−a)/b.
            return _negative(_binary(operator, left.negated, right))
        case "*":
            return _product(left, right)
        case "/":
            quotient = left.value / right.value if left.value is not None and right.value else None
            return _Part(Fraction(left.box, right.box), BINDING["*"], quotient)
    return _power(left, right)


def _sum(operator: str, left: _Part, right: _Part) -> _Part:
    is_plus = operator == "+"
    if right.negated is not None:
        is_plus, right = not is_plus, right.negated
    second = right.box if is_plus and right.negated is None else _bound(right, BINDING["*"])
    items = (*_items(left.box), Sign("+" if is_plus else "−"), *_items(second))
    return _Part(RowBox(items), BINDING["+"], begins_with_digit=left.begins_with_digit)


def _product(left: _Part, right: _Part) -> _Part:
    first, second = _bound(left, BINDING["*"]), _bound(right, BINDING["*"])
    sign = Sign("·") if right.begins_with_digit and second is right.box else Sign("")
    items = (*_items(first), sign, *_items(second))
    return _Part(RowBox(items), BINDING["*"], begins_with_digit=left.begins_with_digit and first is left.box)


def _power(base: _Part, exponent: _Part) -> _Part:
    value = exponent.value
    if value is not None and value.numerator == 1 and 1 < value.denominator <= _LARGEST_DEGREE:
        return _Part(RootBox(base.box, value.denominator), BINDING["*"])
    script = exponent.box if value is None or value.denominator == 1 else _slashed(value)
    if base.call is not None and value is not None and value.denominator == 1 and value > 0:
        name, argument = base.call
        return _Part(RowBox((Power(name, script), argument)), BINDING["^"])
    digits = base.begins_with_digit and base.binding == ATOM
    return _Part(Power(_bound(base, ATOM), script), BINDING["^"], begins_with_digit=digits)


def _slashed(value: Rational) -> Box:
    """Return a ratio on one line, as exponents have it."""
    digits = (_signed(str(value.numerator)), Sign("/"), Numeral(str(value.denominator)))
    return RowBox((*_items(digits[0]), *digits[1:]))


def _bound(part: _Part, least: int) -> Box:
    """Return the box, in parentheses if it binds less than it has to."""
    return part.box if part.binding >= least else Fenced(part.box)


def _items(box: Box) -> tuple[Box, ...]:
    return box.items if isinstance(box, RowBox) else (box,)
