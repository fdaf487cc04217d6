"""The shape of a formula, before any format: names, numbers, fractions, roots, scripts in rows.

One layout feeds every format: where parentheses, fraction bars and roots stand is decided once, in
:mod:`.layout`; the printers :mod:`.latex` and :mod:`.mathml` only write boxes down.
"""

from dataclasses import dataclass


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
