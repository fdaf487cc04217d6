"""Splits a formula's text into tokens with their positions; ASCII only."""

import re
from typing import Literal, NamedTuple

from service.dynamics.formula.errors import FormulaError
from service.dynamics.formula.limits import MAX_CHARACTERS, MAX_NAME, MAX_TOKENS, require

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
