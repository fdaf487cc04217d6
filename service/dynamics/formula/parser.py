"""Parses text to a tree: tokens (ASCII only) with their positions, precedence climbing, bounded depth.

Binding from loose to tight: ``+ -``, then ``* /``, then the sign, then ``^``
(also written ``**``), which groups to the right and whose exponent may carry a
sign: ``-x^2`` is ``-(x^2)``, ``x^-y^2`` is ``x^(-(y^2))``. The sign + makes no node.
"""

import re
import string
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

from service.dynamics.errors import FormulaError, FormulaLimitError, InvalidNumberError
from service.dynamics.exact import MAX_DIGITS, exact_number
from service.dynamics.exact import MAX_EXPONENT as MAX_DECIMAL_EXPONENT
from service.dynamics.formula.tree import (
    BINDING,
    FUNCTIONS,
    MAX_CHARACTERS,
    MAX_DEPTH,
    MAX_NAME,
    MAX_TOKENS,
    SIGN,
    Binary,
    BinaryOperator,
    Call,
    FunctionName,
    Negation,
    Number,
    Symbol,
    Tree,
    require,
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
            raise FormulaError(_foreign(text[position]), position=position)
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


_WRITTEN: dict[str, str] = {
    **dict.fromkeys("\u2212\u2010\u2011\u2012\u2013\u2014\ufe63\uff0d", "-"),
    **dict.fromkeys("\u00b7\u22c5\u00d7\u2217\u2219\u2022", "*"),
    **dict.fromkeys("\u00f7\u2215\u2044", "/"),
    **{character: f"^{digit}" for digit, character in enumerate("⁰¹²³⁴⁵⁶⁷⁸⁹")},
    **{character: f"{digit}" for digit, character in enumerate("₀₁₂₃₄₅₆₇₈₉")},
    "\u207b": "^-",
    "\u03c0": "pi",
    "\u03b3": "g",
    "\u03bb": "lambda",
    "\u03bd": "nu",
    "\u221a": "sqrt(...)",
    **dict.fromkeys("\u00a0\u2002\u2003\u2009\u200a\u202f\u205f\u3000", "a blank"),
    **dict.fromkeys("\u200b\u200c\u200d\u2060\ufeff\u00ad", "nothing: it cannot be seen"),
}
"""Characters that come with a formula pasted from a page, and what is written in their place."""


_ASCII_HINTS = {
    "\\": "formulas are plain text, not LaTeX",
    ",": "the decimal sign is a point",
    "{": "parentheses are round",
    "}": "parentheses are round",
    "[": "parentheses are round",
    "]": "parentheses are round",
    "=": "a formula is one side of an equation",
}


def _foreign(character: str) -> str:
    """Return the phrase about a character that no formula has."""
    if character.isascii():
        hint = _ASCII_HINTS.get(character)
        return f"{character!r} is not part of the grammar" + ("" if hint is None else f"; {hint}")
    name = unicodedata.name(character, "no name").lower()
    written = _WRITTEN.get(character)
    hint = "" if written is None else f"; write {written}"
    return f"{character!r} (U+{ord(character):04X}, {name}) is not part of the grammar{hint}"


def is_name(text: str) -> bool:
    """Tell whether ``text`` is one name of the grammar, short enough."""
    match = _TOKEN.fullmatch(text)
    return match is not None and match.lastgroup == "name" and len(text) <= MAX_NAME


_OPERATORS: dict[str, BinaryOperator] = {**{operator: operator for operator in BINDING}, "**": "^"}
_FUNCTIONS: dict[str, FunctionName] = {name: name for name in FUNCTIONS}


_PIECE = re.compile(
    r"(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?|[A-Za-z_][A-Za-z_0-9]*|\*\*|[^ \t\r\n]", re.ASCII
)
"""The tokens of a formula; any other character is a piece too, which no formula has."""
_LETTERS = frozenset(string.ascii_letters + "_")
_DIGITS = frozenset(string.digits + ".")
_OPERAND = _LETTERS | _DIGITS


@dataclass(frozen=True, slots=True)
class LocatedTree:
    """A tree, and what says from where in the text each of its nodes is."""

    tree: Tree
    text: str
    tokens: tuple[int, ...]
    """The number of the token of each node, in post-order."""

    @property
    def positions(self) -> tuple[int, ...]:
        """The offset of each node in the text, in post-order."""
        tokens = tokenize(self.text)
        return tuple(tokens[index].position for index in self.tokens)


def parse(text: str, symbol: Callable[[str], Tree] = Symbol) -> Tree:
    """Return the tree of ``text``, in which a name is what ``symbol`` makes of it.

    Raises
    ------
    FormulaError
        The text is not a formula; ``position`` is the offset of the fault.
    FormulaLimitError
        The text is larger than :mod:`service.dynamics.formula.tree` allows.
    """
    return _parsed(text, symbol).tree


def parse_located(text: str) -> LocatedTree:
    """Return the tree of ``text`` with the places of its nodes; raises as :func:`parse`."""
    return _parsed(text, Symbol)


def _parsed(text: str, symbol: Callable[[str], Tree]) -> LocatedTree:
    require(len(text), MAX_CHARACTERS, "characters", position=MAX_CHARACTERS)
    pieces = _PIECE.findall(text)
    if len(pieces) > MAX_TOKENS or len(max(pieces, key=len, default="")) > MAX_NAME:
        # It may be refused; a number may be as long as it likes.
        tokenize(text)
    parser = _Parser(pieces, symbol)
    try:
        tree = parser.formula()
    except FormulaError as error:
        raise _explained(text, error) from error
    return LocatedTree(tree, text, tuple(parser.tokens))


def _explained(text: str, error: FormulaError) -> FormulaError:
    """Return the error of a parser with its place in the text, and with what was probably meant."""
    try:
        # A character outside of the grammar comes first; places are counted only where there is a fault.
        tokens = tokenize(text)
    except FormulaError as first:
        found = first
    else:
        place = None if error.position is None else tokens[error.position].position
        found = type(error)(error.reason, position=place)
    meant = None if isinstance(found, FormulaLimitError) else _meant(text)
    if meant is None:
        return found
    return type(found)(f"{found.reason}; did you mean {meant!r}?", position=found.position)


_LATEX: tuple[tuple[str, str], ...] = (
    (r"\\(?:left|right|,|;|!|quad|displaystyle)(?![a-z])|\$", ""),
    (r"\\[dt]?frac\s*\{([^{}]*)\}\s*\{([^{}]*)\}", r"(\1)/(\2)"),
    (r"\\(?:cdot|times|ast)(?![a-z])", "*"),
    (r"\\sqrt\s*\{([^{}]*)\}", r"sqrt(\1)"),
    (r"(?:\\gamma|\u03b3|gamma)\s*_?(?:\{([123])\}|([123\u2081-\u2083]))", r"g\1\2"),
    (r"\bg_\{?([123])\}?", r"g\1"),
    (r"\\([a-z]+)", r"\1"),
    (r"[{\[]", "("),
    (r"[}\]]", ")"),
    (r"(?<=\d),(?=\d)", "."),
)
"""Spellings of other languages and what a formula has for them, one after the other; braces not nested."""
_REPLACED = str.maketrans(
    {character: "" if " " in text else text for character, text in _WRITTEN.items() if text != "sqrt(...)"}
    | {character: " " for character, text in _WRITTEN.items() if text == "a blank"}
)
_LONGEST_MEANT = 200


def _meant(text: str) -> str | None:
    """Return the formula that somebody probably meant, None where that is not to be guessed."""
    if len(text) > _LONGEST_MEANT:
        return None
    for pattern, replacement in _LATEX:
        text = re.sub(pattern, replacement, text)
    text = _with_products(text.translate(_REPLACED))
    pieces = _PIECE.findall(text)
    try:
        _Parser(pieces, Symbol).formula()
    except FormulaError:
        return None
    return text


def _with_products(text: str) -> str:
    """Return a text with the sign * where two operands stand side by side."""
    parts: list[str] = []
    before, end = "", 0
    for found in _PIECE.finditer(text):
        piece = found.group()
        ends = before == ")" or (before[:1] in _OPERAND and before not in _FUNCTIONS)
        begins = piece == "(" or piece[:1] in _OPERAND
        parts += ["*" if before and ends and begins else text[end : found.start()], piece]
        before, end = piece, found.end()
    return "".join(parts).strip()


class _Parser:
    """One pass over the pieces of a text. In its errors, positions are numbers of pieces.

    Nodes are made children first, so that ``tokens``, the number of the piece of each, is in post-order.
    """

    def __init__(self, pieces: list[str], symbol: Callable[[str], Tree]) -> None:
        self._pieces = [*pieces, ""]
        self._symbol = symbol
        self._next = 0
        self._depth = 0
        self._leaves: dict[str, Tree] = {}
        """Numbers and names by their text, equal ones once."""
        self.tokens: list[int] = []

    def formula(self) -> Tree:
        tree = self._expression(0)
        piece = self._pieces[self._next]
        if piece == ")":
            raise FormulaError("')' without a '('", position=self._next)
        if piece:
            raise FormulaError(f"an operator is missing before {_shown(piece)}", position=self._next)
        return tree

    def _expression(self, floor: int) -> Tree:
        """Read operands joined by operators that bind tighter than ``floor``."""
        left = self._operand()
        while True:
            place = self._next
            operator = _OPERATORS.get(self._pieces[place])
            if operator is None or BINDING[operator] <= floor:
                return left
            self._next += 1
            if operator == "^":
                self._enter(place)
                right = self._expression(SIGN)
                self._depth -= 1
            else:
                right = self._expression(BINDING[operator])
            left = Binary(operator, left, right)
            self.tokens.append(place)

    def _operand(self) -> Tree:
        place = self._next
        piece = self._pieces[place]
        self._next += 1
        first = piece[:1]
        tree: Tree | None
        if first in _LETTERS:
            function = _FUNCTIONS.get(piece)
            if function is not None:
                tree = Call(function, self._argument(place))
            elif self._pieces[self._next] == "(":
                raise FormulaError(
                    f"{piece!r} is not a function; known are {', '.join(FUNCTIONS)} (a product needs '*')",
                    position=place,
                )
            else:
                tree = self._leaves.get(piece)
                if tree is None:
                    tree = self._leaves[piece] = self._symbol(piece)
        elif first in _DIGITS:
            tree = self._leaves.get(piece)
            if tree is None:
                tree = self._leaves[piece] = _number(piece, place)
        elif piece == "(":
            return self._inside(place)
        elif piece in ("+", "-"):
            self._enter(place)
            tree = self._expression(SIGN)
            self._depth -= 1
            if piece == "+":
                return tree
            tree = Negation(tree)
        else:
            found = _shown(piece) if piece else "the end"
            raise FormulaError(f"a number, a name or '(' is expected, and {found} was found", position=place)
        self.tokens.append(place)
        return tree

    def _argument(self, place: int) -> Tree:
        if self._pieces[self._next] != "(":
            raise FormulaError(
                f"the function {self._pieces[place]!r} needs its argument in parentheses", position=place
            )
        self._next += 1
        return self._inside(self._next - 1)

    def _inside(self, opening: int) -> Tree:
        """Read up to the parenthesis that closes ``opening``, which is already taken."""
        self._enter(opening)
        tree = self._expression(0)
        self._depth -= 1
        piece = self._pieces[self._next]
        if not piece:
            raise FormulaError("'(' is never closed", position=opening)
        if piece != ")":
            raise FormulaError(f"an operator or ')' is missing before {_shown(piece)}", position=self._next)
        self._next += 1
        return tree

    def _enter(self, place: int) -> None:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise FormulaLimitError(
                f"more than {MAX_DEPTH} parentheses, signs and exponents inside each other", position=place
            )


def _shown(piece: str) -> str:
    return repr("^" if piece == "**" else piece)


def _number(piece: str, place: int) -> Number:
    try:
        return Number(exact_number(piece))
    except InvalidNumberError as error:
        # A token is a number by its form; only its size can be wrong.
        raise FormulaLimitError(
            f"{piece[:30]} has more than {MAX_DIGITS} digits or an exponent beyond ±{MAX_DECIMAL_EXPONENT}",
            position=place,
        ) from error
