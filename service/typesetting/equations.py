"""Equations ready to be shown: what stands on the left of a formula, and all of it in a format."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Literal

from service.dynamics.formula.printer import format_tree
from service.dynamics.formula.tree import Tree
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
from service.typesetting.latex import latex
from service.typesetting.layout import lay_out, symbols_of
from service.typesetting.mathml import mathml
from service.typesetting.names import names_of, usual_name

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
