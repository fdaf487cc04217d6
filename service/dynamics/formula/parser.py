"""Parses text to a tree: tokens (ASCII only) with their positions, precedence climbing, bounded depth.

Binding from loose to tight: ``+ -``, then ``* /``, then the sign, then ``^``
(also written ``**``), which groups to the right and whose exponent may carry a
sign: ``-x^2`` is ``-(x^2)``, ``x^-y^2`` is ``x^(-(y^2))``.
"""

import re
from dataclasses import dataclass
from typing import Literal, NamedTuple

from service.dynamics.errors import InvalidNumberError
from service.dynamics.exact import MAX_DIGITS, exact_number
from service.dynamics.exact import MAX_EXPONENT as MAX_DECIMAL_EXPONENT
from service.dynamics.formula.errors import FormulaError, FormulaLimitError
from service.dynamics.formula.limits import MAX_CHARACTERS, MAX_DEPTH, MAX_NAME, MAX_TOKENS, require
from service.dynamics.formula.tree import (
    FUNCTIONS,
    Binary,
    BinaryOperator,
    Call,
    FunctionName,
    Negation,
    Number,
    Symbol,
    Tree,
)

TokenKind = Literal["number", "name", "operator", "open", "close", "end"]


class Token(NamedTuple):
    """A piece of the text; ``**`` arrives as ``^``."""

    kind: TokenKind
    text: str
    position: int


_TOKEN = re.compile(
    r"""(?P<number>(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)
      | (?P<name>[A-Za-z_][A-Za-z_0-9]*)
      | (?P<operator>\*\*|[-+*/^])
      | (?P<open>\()
      | (?P<close>\))
      | (?P<space>[ \t\r\n]+)""",
    re.ASCII | re.VERBOSE,
)
_KINDS: dict[str, TokenKind] = {
    "number": "number",
    "name": "name",
    "operator": "operator",
    "open": "open",
    "close": "close",
}


def tokenize(text: str) -> list[Token]:
    """Return the tokens of ``text``, the last one of kind ``end``.

    Raises
    ------
    FormulaError
        A character outside the grammar.
    FormulaLimitError
        Too many characters or tokens, or too long a name.
    """
    require(len(text), MAX_CHARACTERS, "characters", position=MAX_CHARACTERS)
    tokens: list[Token] = []
    position = 0
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            raise FormulaError(f"{text[position]!r} is not part of the grammar", position=position)
        kind = _KINDS.get(match.lastgroup or "")
        if kind is not None:
            piece = match.group()
            if kind == "name":
                require(len(piece), MAX_NAME, "characters in one name", position=position)
            tokens.append(Token(kind, "^" if piece == "**" else piece, position))
            require(len(tokens), MAX_TOKENS, "numbers, names and operators", position=position)
        position = match.end()
    tokens.append(Token("end", "", len(text)))
    return tokens


def is_name(text: str) -> bool:
    """Tell whether ``text`` is one name of the grammar, short enough."""
    match = _TOKEN.fullmatch(text)
    return match is not None and match.lastgroup == "name" and len(text) <= MAX_NAME


SUM, PRODUCT, SIGN, POWER, ATOM = 1, 2, 3, 4, 5
"""How tightly the node kinds bind."""

BINDING: dict[BinaryOperator, int] = {"+": SUM, "-": SUM, "*": PRODUCT, "/": PRODUCT, "^": POWER}

_OPERATORS: dict[str, BinaryOperator] = {operator: operator for operator in BINDING}
_FUNCTIONS: dict[str, FunctionName] = {name: name for name in FUNCTIONS}


@dataclass(frozen=True, slots=True)
class LocatedTree:
    """A tree and the offset of each of its nodes in the text, in post-order."""

    tree: Tree
    positions: tuple[int, ...]


def parse(text: str) -> Tree:
    """Return the tree of ``text``.

    Raises
    ------
    FormulaError
        The text is not a formula; ``position`` is the offset of the fault.
    FormulaLimitError
        The text is larger than :mod:`service.dynamics.formula.limits` allows.
    """
    return parse_located(text).tree


def parse_located(text: str) -> LocatedTree:
    """Return the tree of ``text`` with the places of its nodes; raises as :func:`parse`."""
    return _Parser(tokenize(text)).formula()


class _Parser:
    """One pass over the tokens. Nodes are made children first, so ``positions`` is in post-order."""

    def __init__(self, tokens: list[Token]) -> None:
        self._tokens = tokens
        self._next = 0
        self._depth = 0
        self._positions: list[int] = []

    def formula(self) -> LocatedTree:
        tree = self._expression(0)
        token = self._tokens[self._next]
        if token.kind == "close":
            raise FormulaError("')' without a '('", position=token.position)
        if token.kind != "end":
            raise FormulaError(f"an operator is missing before {token.text!r}", position=token.position)
        return LocatedTree(tree, tuple(self._positions))

    def _expression(self, floor: int) -> Tree:
        """Read operands joined by operators that bind tighter than ``floor``."""
        left = self._operand()
        while True:
            token = self._tokens[self._next]
            operator = _OPERATORS.get(token.text) if token.kind == "operator" else None
            if operator is None or BINDING[operator] <= floor:
                return left
            self._next += 1
            if operator == "^":
                self._enter(token)
                right = self._expression(SIGN)
                self._depth -= 1
            else:
                right = self._expression(BINDING[operator])
            left = Binary(operator, left, right)
            self._positions.append(token.position)

    def _operand(self) -> Tree:
        token = self._tokens[self._next]
        self._next += 1
        tree: Tree
        if token.kind == "number":
            tree = _number(token)
        elif token.kind == "name":
            function = _FUNCTIONS.get(token.text)
            opened = self._tokens[self._next].kind == "open"
            if function is not None:
                tree = Call(function, self._argument(token))
            elif opened:
                raise FormulaError(
                    f"{token.text!r} is not a function; known are {', '.join(FUNCTIONS)}"
                    f" (a product needs '*')",
                    position=token.position,
                )
            else:
                tree = Symbol(token.text)
        elif token.kind == "open":
            return self._inside(token)
        elif token.text == "-":
            self._enter(token)
            tree = Negation(self._expression(SIGN))
            self._depth -= 1
        else:
            found = repr(token.text) if token.text else "the end"
            raise FormulaError(
                f"a number, a name or '(' is expected, and {found} was found", position=token.position
            )
        self._positions.append(token.position)
        return tree

    def _argument(self, function: Token) -> Tree:
        token = self._tokens[self._next]
        if token.kind != "open":
            raise FormulaError(
                f"the function {function.text!r} needs its argument in parentheses",
                position=function.position,
            )
        self._next += 1
        return self._inside(token)

    def _inside(self, opening: Token) -> Tree:
        """Read up to the parenthesis that closes ``opening``, which is already taken."""
        self._enter(opening)
        tree = self._expression(0)
        self._depth -= 1
        token = self._tokens[self._next]
        if token.kind != "close":
            if token.kind == "end":
                raise FormulaError("'(' is never closed", position=opening.position)
            raise FormulaError(
                f"an operator or ')' is missing before {token.text!r}", position=token.position
            )
        self._next += 1
        return tree

    def _enter(self, token: Token) -> None:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise FormulaLimitError(
                f"more than {MAX_DEPTH} parentheses, signs and exponents inside each other",
                position=token.position,
            )


def _number(token: Token) -> Number:
    try:
        return Number(exact_number(token.text))
    except InvalidNumberError as error:
        # A token is a number by its form; only its size can be wrong.
        raise FormulaLimitError(
            f"{token.text[:30]} has more than {MAX_DIGITS} digits"
            f" or an exponent beyond ±{MAX_DECIMAL_EXPONENT}",
            position=token.position,
        ) from error
