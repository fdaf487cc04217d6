"""Boxes as LaTeX, for mathematics mode; nothing beyond LaTeX itself and amsmath is needed."""

from service.typesetting.boxes import (
    Box,
    Fenced,
    Fraction,
    Integral,
    Name,
    Numeral,
    Power,
    RootBox,
    RowBox,
    Sign,
)

_SIGNS = {"−": "-", "±": r"\pm", "·": r"\cdot", "|": r"\mid", "": ""}
_FENCES = {"()": (r"\left(", r"\right)"), "||": (r"\left|", r"\right|")}


def latex(box: Box) -> str:
    """Return the LaTeX of a box."""
    match box:
        case Name(_, text, subscript, _):
            return f"{text}_{{{subscript}}}" if subscript else text
        case Numeral(digits):
            return digits
        case Sign(character):
            return _SIGNS.get(character, character)
        case RowBox(items):
            return _row(items)
        case Fraction(numerator, denominator):
            return rf"\frac{{{latex(numerator)}}}{{{latex(denominator)}}}"
        case RootBox(radicand, degree):
            return rf"\sqrt{'' if degree == 2 else f'[{degree}]'}{{{latex(radicand)}}}"
        case Power(base, exponent):
            return f"{_base(base)}^{{{latex(exponent)}}}"
        case Fenced(item, fences):
            left, right = _FENCES[fences]
            return f"{left}{latex(item)}{right}"
        case Integral(integrand):
            return rf"\int {latex(integrand)}"


def _row(items: tuple[Box, ...]) -> str:
    pieces: list[str] = []
    is_glued = True
    for item in items:
        text = latex(item)
        if text:
            # A sign in front belongs to what follows it; everything else is apart.
            pieces += [text] if is_glued else [" ", text]
            is_glued = isinstance(item, Sign) and item.is_prefix and item.character == "−"
    return "".join(pieces)


def _base(base: Box) -> str:
    text = latex(base)
    return text if isinstance(base, Name | Numeral | Fenced) else f"{{{text}}}"
