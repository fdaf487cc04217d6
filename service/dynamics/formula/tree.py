"""The tree of a formula: five kinds of immutable, comparable nodes."""

from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

BinaryOperator = Literal["+", "-", "*", "/", "^"]
FunctionName = Literal["sqrt", "exp", "log", "sin", "cos", "tan", "abs"]

FUNCTIONS: tuple[FunctionName, ...] = ("sqrt", "exp", "log", "sin", "cos", "tan", "abs")
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
