"""Equations as LaTeX or MathML: names of symbols, and what stands on the left of a formula."""

import re
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Literal
from xml.etree.ElementTree import Element, SubElement, tostring

from service.dynamics.formula.tree import Tree, format_tree
from service.typesetting.layout import (
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
    lay_out,
    symbols_of,
)

_GREEK: Mapping[str, str] = MappingProxyType(
    {
        **{"alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "eta": "η"},
        **{"theta": "θ", "iota": "ι", "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ"},
        **{"rho": "ρ", "sigma": "σ", "tau": "τ", "upsilon": "υ", "phi": "φ", "chi": "χ", "psi": "ψ"},
        **{"omega": "ω", "Gamma": "Γ", "Delta": "Δ", "Theta": "Θ", "Lambda": "Λ", "Xi": "Ξ", "Pi": "Π"},
        **{"Sigma": "Σ", "Upsilon": "Υ", "Phi": "Φ", "Psi": "Ψ", "Omega": "Ω"},
    }
)
_OWN: Mapping[str, Name] = MappingProxyType(
    {
        **{f"g{axis}": Name("γ", r"\gamma", str(axis)) for axis in (1, 2, 3)},
        "pi": Name("π", r"\pi"),
        "lambda": Name("λ", r"\lambda"),
        "nu": Name("ν", r"\nu"),
        "w": Name("w", "w"),
    }
)
"""Symbols of the formulas themselves: parameters give way to these."""
_PARTS = re.compile(r"([A-Za-z]+)_?([0-9]*)\Z", re.ASCII)


def names_of(symbols: Iterable[str], reserved: Iterable[str] = ()) -> dict[str, Name]:
    """Return the name of each of the ``symbols``, no two alike.

    ``reserved`` are letters that mean something else beside the formula: no parameter looks like them.
    """
    taken = {usual_name(letter) for letter in (*reserved, *_OWN)}
    found: dict[str, Name] = {}
    for symbol in sorted(symbols, key=lambda symbol: (len(symbol), symbol)):
        name = usual_name(symbol)
        if symbol not in _OWN and name in taken:
            name = _upright(symbol)
        taken.add(name)
        found[symbol] = name
    return found


def usual_name(symbol: str) -> Name:
    """Return a letter, Latin or Greek, with the digits at the end as its subscript; else an upright word."""
    if symbol in _OWN:
        return _OWN[symbol]
    parts = _PARTS.match(symbol)
    if parts is None:
        return _upright(symbol)
    word, digits = parts.groups()
    if len(word) == 1:
        return Name(word, word, digits)
    if word in _GREEK:
        return Name(_GREEK[word], rf"\{word}", digits)
    return Name(word, rf"\mathrm{{{word}}}", digits, is_upright=True)


def _upright(symbol: str) -> Name:
    escaped = symbol.replace("_", r"\_")
    return Name(symbol, rf"\mathrm{{{escaped}}}", is_upright=True)


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


NAMESPACE = "http://www.w3.org/1998/Math/MathML"
INVISIBLE_TIMES = "\u2062"


def mathml(box: Box) -> str:
    """Return a ``math`` element in its namespace, displayed as a block."""
    root = Element("math", {"xmlns": NAMESPACE, "display": "block"})
    _append(root, box)
    return tostring(root, encoding="unicode")


def _append(parent: Element, box: Box) -> None:
    """Add the elements of a box; those of a row stand beside each other."""
    match box:
        case Name(letters, _, subscript, is_upright):
            target = SubElement(parent, "msub") if subscript else parent
            is_marked = is_upright and len(letters) == 1
            SubElement(target, "mi", {"mathvariant": "normal"} if is_marked else {}).text = letters
            if subscript:
                SubElement(target, "mn").text = subscript
        case Numeral(digits):
            SubElement(parent, "mn").text = digits
        case Sign(character, is_prefix):
            sign = SubElement(parent, "mo", {"form": "prefix"} if is_prefix else {})
            sign.text = character or INVISIBLE_TIMES
        case RowBox(items):
            for item in items:
                _append(parent, item)
        case Fraction(numerator, denominator):
            _append_parts(SubElement(parent, "mfrac"), numerator, denominator)
        case RootBox(radicand, degree):
            if degree == 2:
                _append(SubElement(parent, "msqrt"), radicand)
            else:
                _append_parts(SubElement(parent, "mroot"), radicand, Numeral(str(degree)))
        case Power(Name(letters, name, subscript, is_upright), exponent) if subscript:
            # Both scripts at the same place, as γ₁² has them.
            both = SubElement(parent, "msubsup")
            _append(both, Name(letters, name, is_upright=is_upright))
            _append_parts(both, Numeral(subscript), exponent)
        case Power(base, exponent):
            _append_parts(SubElement(parent, "msup"), base, exponent)
        case Fenced(item, fences):
            row = SubElement(parent, "mrow")
            SubElement(row, "mo", {"form": "prefix"}).text = fences[0]
            _append(SubElement(row, "mrow"), item)
            SubElement(row, "mo", {"form": "postfix"}).text = fences[1]
        case Integral(integrand):
            SubElement(parent, "mo").text = "∫"
            _append(SubElement(parent, "mrow"), integrand)


def _append_parts(parent: Element, *parts: Box) -> None:
    """Add each part as exactly one element: the meaning of scripts and fractions depends on their number."""
    for part in parts:
        _append(SubElement(parent, "mrow"), part)


Format = Literal["text", "latex", "mathml"]
FORMATS: tuple[Format, ...] = ("text", "latex", "mathml")


def _of(name: str, argument: str) -> Box:
    """Return f(x)."""
    return RowBox((usual_name(name), Fenced(usual_name(argument))))


def _squared(box: Box) -> Box:
    return Power(box, Numeral("2"))


_G1, _T, _M = usual_name("g1"), usual_name("t"), usual_name("m")
_D = Name("d", r"\mathrm{d}", is_upright=True)
_CN = Name("cn", r"\operatorname{cn}", is_upright=True)
_SPEED = Fraction(RowBox((_D, Sign(""), _G1)), RowBox((_D, Sign(""), _T)))
_LEFT: Mapping[str, tuple[str, Box]] = MappingProxyType(
    {
        "V": ("V", usual_name("V")),
        "h(lambda)": ("h(lambda)", _of("h", "lambda")),
        "h(nu)": ("h(nu)", _of("h", "nu")),
        "F": ("F(w)", _of("F", "w")),
        "G": ("G(g2)", _of("G", "g2")),
        "nearest": ("P", usual_name("P")),
        "curve": ("g3^2", _squared(usual_name("g3"))),
        "p_squared": ("p^2", _squared(usual_name("p"))),
        "speed_squared": ("(dg1/dt)^2", _squared(Fenced(_SPEED))),
        "g1": ("g1(t)", RowBox((_G1, Fenced(_T)))),
        "cn": ("cn", _CN),
        "x1": ("x1", usual_name("x1")),
        "x2": ("x2", usual_name("x2")),
        "k": ("k(x)", _of("k", "x")),
        "Omega": ("Omega", usual_name("Omega")),
        "kappa": ("kappa", usual_name("kappa")),
        "m": ("m", _M),
        "period": ("T", usual_name("T")),
    }
)
"""Left sides of equations, as text and as a box. The time has an integral on its right side instead."""
TIME = "time"
NAMES = (*_LEFT, TIME)
_RESERVED = ("V", "h", "F", "G", "P", "p", "t", "d")
_SPECIAL: Mapping[str, Box] = MappingProxyType(
    {
        "cn": _CN,
        "K(m)": RowBox((usual_name("K"), Fenced(_M))),
        "k(x1)": _of("k", "x1"),
        "k(x2)": _of("k", "x2"),
        "cn(Omega*t | m)": RowBox(
            (_CN, Fenced(RowBox((usual_name("Omega"), Sign(""), _T, Sign("|"), _M)))),
        ),
    }
)
"""Symbols that only our own formulas have: values of functions that the grammar does not know."""


def typeset(name: str, right: Tree, formats: Iterable[Format]) -> dict[Format, str | None]:
    """Return an equation in the ``formats`` that are asked for, null in the others; the text is always there.

    The left side is that of ``name``, one of NAMES; for the time, the right side is under the integral.
    """
    asked = set(formats)
    boxes = _boxes(name, right)
    return {
        "text": _text(name, right),
        "latex": latex(boxes) if "latex" in asked else None,
        "mathml": mathml(boxes) if "mathml" in asked else None,
    }


def _text(name: str, right: Tree) -> str:
    text = format_tree(right)
    if name == TIME:
        return f"t = +-integral(1/sqrt({text}), g1)"
    return f"{_LEFT[name][0]} = {text}"


def _boxes(name: str, right: Tree) -> Box:
    symbols = symbols_of(right)
    names: dict[str, Box] = {**names_of(symbols - set(_SPECIAL), _RESERVED), **_SPECIAL}
    formula = lay_out(right, names)
    if name == TIME:
        differential = RowBox((_D, Sign(""), _G1))
        integral = Integral(Fraction(differential, RootBox(formula)))
        return RowBox((_T, Sign("="), Sign("±", is_prefix=True), integral))
    items = formula.items if isinstance(formula, RowBox) else (formula,)
    return RowBox((_LEFT[name][1], Sign("="), *items))
