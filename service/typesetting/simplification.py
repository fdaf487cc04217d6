"""The shortest form of a formula that SymPy finds and our own exact ring proves.

SymPy gets numbers, symbols and operators, made from our own tree; it never sees a text. What it returns
becomes a tree of our grammar again, and is used only if it is proved to be the same function. So a mistake of
SymPy, or one of its rules that does not hold for real numbers, can do no harm.

SymPy takes a third of a second to import, and there are formulas with which it never ends. So only child
processes that can be killed import this module, and only when formulas are asked for.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction

import sympy

from service.dynamics.formula.algebras.symbolic import sympy_expression
from service.dynamics.formula.parameters import PI
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import (
    Binary,
    Call,
    FunctionName,
    Negation,
    Number,
    Symbol,
    Tree,
    fold_tree,
    post_order,
)
from service.dynamics.verdict.proofs.proof import is_same_function
from service.typesetting.layout import symbols_of

_FUNCTIONS: Mapping[type[sympy.Expr], FunctionName] = {
    sympy.exp: "exp",
    sympy.log: "log",
    sympy.sin: "sin",
    sympy.cos: "cos",
    sympy.tan: "tan",
    sympy.Abs: "abs",
}
_Form = Callable[[sympy.Expr], sympy.Expr]
_FORMS: tuple[_Form, ...] = (
    lambda expression: expression,
    sympy.factor_terms,
    sympy.factor,
    lambda expression: sympy.expand(sympy.factor(expression)),
)
_FURTHER_FORMS: tuple[_Form, ...] = (sympy.simplify,)
"""For formulas with functions in them: it knows their identities, and takes ten times as long."""
_STACKED = 3
"""Length that a fraction inside a fraction adds to a formula for a reader."""
_ONE = Number(Fraction(1))


class NotInGrammarError(Exception):
    """SymPy's form has what our formulas do not have: other functions, infinities, i."""


def simplified(tree: Tree, signs: Mapping[str, int]) -> Tree | None:
    """Return the shortest form that is proved to be the same function, perhaps ``tree`` itself.

    ``signs`` are those of the variables, as for :func:`is_same_function`; names without one are real
    parameters. None if SymPy finds no form that can be proved.
    """
    names = sorted(symbols_of(tree) - {PI})
    symbols = [_symbol(name, signs.get(name, 0)) for name in names]
    try:
        expression = sympy_expression(compile_tape(tree, tuple(names)), symbols)
    except Exception:  # beyond our limits, or whatever SymPy raises: there is nothing to be had from it
        return None
    has_functions = any(isinstance(node, Call) and node.function != "sqrt" for node in post_order(tree))
    forms = sorted(_forms(expression, (*_FORMS, *_FURTHER_FORMS) if has_functions else _FORMS), key=_length)
    shortest = _length(tree)
    for form in forms:
        if _length(form) <= shortest and is_same_function(tree, form, signs):
            return form
    return tree if forms else None


def _symbol(name: str, sign: int) -> sympy.Symbol:
    if sign:
        return sympy.Symbol(name, positive=True) if sign > 0 else sympy.Symbol(name, negative=True)
    return sympy.Symbol(name, real=True)


def _forms(expression: sympy.Expr, forms: Sequence[_Form]) -> Iterator[Tree]:
    for form in forms:
        try:
            yield _with_signs_inside(from_sympy(form(expression)))
        except Exception:  # whatever SymPy raises: this form is not to be had
            continue


def from_sympy(expression: sympy.Expr) -> Tree:
    """Return the tree of a SymPy expression, as a person would write it.

    Quotients have one fraction bar, and signs stand in front.

    Raises
    ------
    NotInGrammarError
        It has other functions, infinities or complex numbers.
    """
    if expression.is_Rational:
        return _ratio(Fraction(int(expression.p), int(expression.q)))
    if expression.is_Symbol:
        return Symbol(expression.name)
    if expression is sympy.pi:
        return Symbol(PI)
    if expression is sympy.E:
        return Call("exp", _ONE)
    if expression.is_Add:
        return _sum(expression)
    if expression.is_Mul or (expression.is_Pow and _is_below(expression)):
        return _quotient(expression)
    if expression.is_Pow:
        return _power(expression.base, expression.exp)
    function = _FUNCTIONS.get(expression.func)
    if function is None:
        raise NotInGrammarError(str(expression.func))
    return Call(function, from_sympy(expression.args[0]))


def _ratio(value: Fraction) -> Tree:
    size: Tree = Number(Fraction(abs(value.numerator)))
    if value.denominator != 1:
        size = Binary("/", size, Number(Fraction(value.denominator)))
    return Negation(size) if value < 0 else size


def _sum(expression: sympy.Expr) -> Tree:
    # The first term without a sign in front, if there is one: b − a rather than −a + b.
    terms = [from_sympy(term) for term in expression.as_ordered_terms()]
    if isinstance(terms[0], Negation):
        first = next((term for term in terms if not isinstance(term, Negation)), None)
        if first is not None:
            terms.remove(first)
            terms.insert(0, first)
    total = terms[0]
    for term in terms[1:]:
        match term:
            case Negation(operand):
                total = Binary("-", total, operand)
            case _:
                total = Binary("+", total, term)
    return total


def _quotient(expression: sympy.Expr) -> Tree:
    number, rest = expression.as_coeff_Mul(rational=True)
    value = Fraction(int(number.p), int(number.q))
    above: list[Tree] = [] if abs(value.numerator) == 1 else [Number(Fraction(abs(value.numerator)))]
    below: list[Tree] = [] if value.denominator == 1 else [Number(Fraction(value.denominator))]
    for factor in rest.as_ordered_factors():
        if factor is sympy.S.One:
            continue
        if factor.is_Pow and _is_below(factor):
            below.append(_power(factor.base, -factor.exp))
        else:
            above.append(from_sympy(factor))
    quotient = _product(above) if not below else Binary("/", _product(above), _product(below))
    return Negation(quotient) if value < 0 else quotient


def _with_signs_inside(tree: Tree) -> Tree:
    """Return the tree with −(a b/c) written as -a*b/c, which needs no parentheses as a text."""

    def build(_: int, node: Tree, parts: Sequence[Tree]) -> Tree:
        match node:
            case Negation():
                return _negated(parts[0])
            case Call(function):
                return Call(function, parts[0])
            case Binary(operator):
                return Binary(operator, parts[0], parts[1])
        return node

    return fold_tree(tree, build)


def _negated(tree: Tree) -> Tree:
    match tree:
        case Binary("*" | "/" as operator, left, right):
            return Binary(operator, _negated(left), right)
    return Negation(tree)


def _is_below(power: sympy.Expr) -> bool:
    return bool(power.exp.is_Rational and power.exp < 0)


def _product(factors: list[Tree]) -> Tree:
    if not factors:
        return _ONE
    total = factors[0]
    for factor in factors[1:]:
        total = Binary("*", total, factor)
    return total


def _power(base: sympy.Expr, exponent: sympy.Expr) -> Tree:
    if exponent == 1:
        return from_sympy(base)
    if base is sympy.E:
        return Call("exp", from_sympy(exponent))
    if exponent == sympy.S.Half:
        return Call("sqrt", from_sympy(base))
    return Binary("^", from_sympy(base), from_sympy(exponent))


def _length(tree: Tree) -> int:
    """Return how much there is to read: nodes, the digits of numbers, and fractions in fractions."""

    def build(_: int, node: Tree, parts: Sequence[tuple[int, bool]]) -> tuple[int, bool]:
        length = 1 + sum(part for part, _ in parts)
        has_fraction = any(inside for _, inside in parts)
        match node:
            case Number(value):
                return len(str(value)), False
            case Binary("/"):
                return length + _STACKED * has_fraction, True
        return length, has_fraction

    return fold_tree(tree, build)[0]
