"""Random planar problems as documents: bodies, families, curves, ends, starts, gaps to separatrices.

Coefficients of the three terms come from the zeros that they give the radicand,
so that every type of ends is met, and zeros as near to each other, to the
equator and to the pole as wanted. In the other families a multiple of
Q = A g1² + C g3², which shifts p²/g3² by a constant, does the same.
"""

from dataclasses import dataclass
from fractions import Fraction
from math import isqrt
from typing import Any, Literal, get_args

import numpy as np
from flint import ctx
from numpy.typing import NDArray

from service.dynamics.errors import DynamicsError
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import Loop, make_loop
from service.dynamics.reduction.window import Window
from service.dynamics.reduction.windows import REDUCTION_BITS, find_windows
from service.schemas.problem.problem import read_problem
from service.schemas.reading.documents import InvalidProblemError

FloatArray = NDArray[np.float64]
Document = dict[str, Any]
Family = Literal["three-term", "rational", "homogeneous", "formula", "passage"]
EVERY: tuple[Family, ...] = get_args(Family)
FAMILIES = EVERY[:-1]
"""Families of the smooth problems of one run; those of motions through poles are run apart."""

RATIOS = ("3", "5/2", "7/3", "17/10", "4", "2", "3/5", "1/3", "1/2", "4/7")
"""A/C of the families that have any."""
SMALLEST_GAP = -9.0
"""Its logarithm."""
CURVES = ("", "*exp(s*g2)", "*(2+sin(3*g2))", "/(3+g2^2)", "*sqrt(2+s*g2)", "+ s*cos(4*g2)", "+ log(2+s*g2)")
PLACES = np.linspace(0.02, np.pi - 0.02, 601)
DIGITS = 10**40


@dataclass(frozen=True)
class Drawn:
    """A problem whose motion is periodic; its document has neither times nor an accuracy yet."""

    family: Family
    document: Document
    window: Window


def draw_problem(family: Family, draws: np.random.Generator) -> Drawn:
    """Return the first problem drawn that has a periodic motion."""
    while True:
        document = _MAKERS[family](draws)
        try:
            drawn = _with_start(family, document, draws)
        except (DynamicsError, InvalidProblemError):
            # No term of that index, or beyond the domain of the formula: not a problem to solve.
            continue
        if drawn is not None and (family != "passage" or drawn.window.ends[0] == "pole"):
            return drawn


def _with_start(family: Family, document: Document, draws: np.random.Generator) -> Drawn | None:
    problem = read_problem(with_times(document, ["0"], "standard"))
    assert isinstance(problem.motion, PlanarMotion)
    windows = find_windows(problem.body, problem.potential, problem.motion)
    periodic = [window for window in windows if window.kind == "periodic"]
    if not periodic:
        return None
    window = periodic[draws.integers(len(periodic))]
    motion = dict(document["motion"])
    if len(windows) > 1:
        motion["window"] = window.index
    start = _start(window, draws)
    if start is not None:
        motion["start"] = start
    return Drawn(family, {**document, "motion": motion}, window)


def with_times(document: Document, times: list[str], tier: str) -> Document:
    """Return the document that asks for these times of a tier."""
    return {**document, "time": {"times": times}, "accuracy": {"tier": tier}}


def _start(window: Window, draws: np.random.Generator) -> Document | None:
    """Return a start, None for that by itself; half of those at a point are next to an end."""
    low, high = sorted((abs(window.g1[0]), abs(window.g1[1])))
    kinds = ["default", "point"]
    kinds += ["equator"] if window.ends[1] == "equator" else []
    kinds += ["rest"] if "rest" in window.ends and len(window.arcs) > 1 else []
    kind = kinds[draws.integers(len(kinds))]
    if kind == "default" or (kind == "point" and not 1e-14 * high < high - low):
        return None
    if kind == "equator":
        return {"at": "equator", "s_sign": _sign(draws)}
    # The one arc of a hemisphere: what is asked of the other has its own window's arc.
    north = _sign(draws) if len(window.arcs) > 1 or window.ends[1] == "equator" else _side(window)
    if kind == "rest":
        return {"at": "rest", "g2_sign": north}
    share = draws.uniform(0.02, 0.98) if draws.random() < 0.5 else 10.0 ** draws.uniform(-9, -2)
    share = share if draws.random() < 0.5 else 1.0 - share
    exact = Fraction(low) + (Fraction(high) - Fraction(low)) * Fraction(float(share))
    exact *= 1 if sum(window.g1) > 0 else -1
    return {"g1": str(exact), "g2_sign": north, "s_sign": _sign(draws)}


def _side(window: Window) -> int:
    return 1 if sum(window.g2) > 0 else -1


def _three_term(draws: np.random.Generator) -> Document:
    """V = a1 g1 + b1/g3² + c1 (g1² − g2²), A = 2C, or its mirror image.

    The radicand is −(2 b1 + nu² a1 x + 2 nu² c1 x²) (1 − nu x − x²) up to powers of x = |g1|.
    """
    mirrored, by_nu = draws.random() < 0.3, draws.random() < 0.5
    lambda_ = _decimal(10.0 ** draws.uniform(-1, 1))
    nu = 1 / lambda_ if mirrored else _decimal(10.0 ** draws.uniform(-2, 2)) if by_nu else lambda_**2
    equator = (_root(nu * nu + 4) - nu) / 2
    a, b, c = (
        _rounded(value) for value in _coefficients(nu, equator, draws, _decimal(10.0 ** draws.uniform(-2, 2)))
    )
    signs = {"g1_sign": _sign(draws), "g3_sign": _sign(draws)}
    a *= signs["g3_sign" if mirrored else "g1_sign"]
    C = _decimal(10.0 ** draws.uniform(-1, 1))
    motion: Document = {"type": "planar", "lambda": str(lambda_), **signs}
    if by_nu and not mirrored:
        motion = {"type": "planar", "nu": str(nu * signs["g1_sign"]), "g3_sign": signs["g3_sign"]}
    body = {"A": str(C), "C": str(2 * C)} if mirrored else {"A": str(2 * C), "C": str(C)}
    potential: Document = {"type": "rational", "a": [str(a)], "b": [str(b)], "c": [str(c)]}
    if mirrored or draws.random() < 0.7:
        text = "a1*g3 + b1/g1^2 + c1*(g3^2-g2^2)" if mirrored else "a1*g1 + b1/g3^2 + c1*(g1^2-g2^2)"
        parameters = {"a1": str(a), "b1": str(b), "c1": str(c)}
        potential = {"type": "expression", "expression": text, "parameters": parameters}
    return {"body": body, "potential": potential, "motion": motion}


def _coefficients(
    nu: Fraction, equator: Fraction, draws: np.random.Generator, size: Fraction
) -> tuple[Fraction, Fraction, Fraction]:
    """Return a1, b1, c1 from the zeros of the first factor."""
    shape = draws.choice(["between", "outside", "linear", "pole"])
    first = equator * _decimal(draws.uniform(0.01, 1.3))
    gap = Fraction(repr(float(f"{10.0 ** draws.uniform(SMALLEST_GAP, 0):.3e}"))) * _sign(draws)
    near = draws.choice(["", "equator", "other", "zero"])
    if near == "equator":
        first = equator * (1 + gap)
    second = equator * _decimal(draws.uniform(0.01, 1.3))
    if near == "other":
        second = first * (1 + gap)
    elif near == "zero":
        second = equator * gap
    if shape == "linear":
        return -size, nu * nu * size * first / 2, Fraction(0)
    if shape == "pole":
        # One zero is at x = 0: what is left repels from the pole or does not.
        sign = _sign(draws)
        return -2 * sign * size * first * _sign(draws), Fraction(0), sign * size
    c = size if shape == "between" else -size
    return -2 * c * (first + second), nu * nu * c * first * second, c


def _rational(draws: np.random.Generator) -> Document:
    C = _decimal(10.0 ** draws.uniform(-0.5, 0.5))
    a, b, c = (_list(draws, 3) for _ in range(3))
    if draws.random() < 0.8:
        # The b_n repel from the pole; the higher, the steeper.
        b = [str(abs(Fraction(value)) / 10 ** (2 * n)) for n, value in enumerate(b, 1)]
    else:
        # Of a_2 there is no enclosure through a pole.
        a, b = a[:1], []
    potential = {"type": "rational", "a": a, "b": b, "c": ["0", *c]}
    return _shifted({"A": str(2 * C), "C": str(C)}, potential, ("c", 0), draws)


def _homogeneous(draws: np.random.Generator) -> Document:
    ratio, C = Fraction(RATIOS[draws.integers(len(RATIOS))]), _decimal(draws.uniform(0.5, 2))
    B, C_terms = (_list(draws, 2) if draws.random() < 0.6 else [] for _ in range(2))
    C_terms = [str(abs(Fraction(value)) / 20) for value in C_terms]
    potential = {"type": "homogeneous", "A": ["0", *_list(draws, 4)], "B": B, "C": C_terms}
    return _shifted({"A": str(ratio * C), "C": str(C)}, potential, ("A", 0), draws)


def _formula(draws: np.random.Generator) -> Document:
    ratio, C = Fraction(RATIOS[draws.integers(len(RATIOS))]), _decimal(draws.uniform(0.5, 2))
    curve = CURVES[draws.integers(len(CURVES))]
    text = f"(A*g1^2+C*g3^2)*(k + (u*g2+v*g2^2+w*g2^3){curve})"
    parameters = {"k": "0", **dict(zip("suvw", _list(draws, 4, exactly=True), strict=True))}
    if "s" not in curve.replace("sin", "").replace("cos", ""):
        del parameters["s"]
    if draws.random() < 0.4:
        # The homogeneous terms of lowest degree.
        text += f" + b*abs(g1)^({2 * (ratio - 1) / ratio}) + c*abs(g3)^({-2 * (ratio - 1)})"
        b, c = (Fraction(value) / 10 for value in _list(draws, 2, exactly=True))
        parameters |= {"b": str(b if ratio > 1 else abs(b)), "c": str(abs(c) if ratio > 1 else c)}
    potential = {"type": "expression", "expression": text, "parameters": parameters}
    return _shifted({"A": str(ratio * C), "C": str(C)}, potential, ("parameters", "k"), draws)


def _passage(draws: np.random.Generator) -> Document:
    """Terms of the paper that let a motion through the pole, A/C between 1.01 and 100 or its inverse."""
    denominator = (1, 2, 3, 5, 7, 10, 100)[draws.integers(7)]
    ratio = Fraction(max(1, round(10.0 ** draws.uniform(0.0044, 2) * denominator)), denominator)
    mirrored = draws.random() < 0.5
    kind = draws.choice(["power", "terms", "rational"], p=[0.4, 0.4, 0.2])
    ratio = Fraction(2) if kind == "rational" else ratio
    if ratio < Fraction(101, 100):
        ratio = Fraction(101, 100)
    C = _decimal(draws.uniform(0.5, 2))
    signs = {"g1_sign": _sign(draws), "g3_sign": _sign(draws)}
    motion = {"type": "planar", "lambda": str(_decimal(10.0 ** draws.uniform(-0.5, 0.5))), **signs}
    size, small = _decimal(draws.uniform(0.2, 3)), _decimal(draws.uniform(-0.2, 0.2))
    if kind == "rational":
        a = [str(-size * signs["g1_sign"]), str(small / 5 * signs["g1_sign"])]
        c = [str(_decimal(draws.uniform(-0.2, 0.2))) for _ in range(2)]
        return {
            "body": {"A": str(2 * C), "C": str(C)},
            "potential": {"type": "rational", "a": a, "c": c},
            "motion": motion,
        }
    first, third = ("g3", "g1") if mirrored else ("g1", "g3")
    body = {"A": str(C), "C": str(ratio * C)} if mirrored else {"A": str(ratio * C), "C": str(C)}
    text = f"-k*abs({first})^({2 * (ratio - 1) / ratio}) + u*({ratio}*{first}^2 + {third}^2)*(g2 - g2^2/2)"
    potential = {"type": "expression", "expression": text, "parameters": {"k": str(size), "u": str(small)}}
    if kind == "terms":
        terms = {"C" if mirrored else "B": [str(-size), str(small), str(small / 7)]}
        potential = {"type": "homogeneous", "A": ["0", str(small)], **terms}
    return {"body": body, "potential": potential, "motion": motion}


_MAKERS = {
    "passage": _passage,
    "three-term": _three_term,
    "rational": _rational,
    "homogeneous": _homogeneous,
    "formula": _formula,
}


def _shifted(
    body: Document, potential: Document, slot: tuple[str, int | str], draws: np.random.Generator
) -> Document:
    """Put the multiple of Q into ``slot`` that leaves a motion, half of the time next to a separatrix."""
    motion = {
        "type": "planar",
        "lambda": str(_decimal(10.0 ** draws.uniform(-0.7, 0.7))),
        "g1_sign": _sign(draws),
        "g3_sign": _sign(draws),
    }
    document = {"body": body, "potential": potential, "motion": motion}
    problem = read_problem(with_times(document, ["0"], "standard"))
    assert isinstance(problem.motion, PlanarMotion)
    with ctx.workprec(REDUCTION_BITS):
        loop = make_loop(problem.body, problem.potential, problem.motion)
        Z, ratio = float(loop.Z), float(loop.alpha)
    square = (Z * np.sin(PLACES)) ** 2
    heights = loop.radicand_real(np.sin(PLACES), np.cos(PLACES)) / square
    heights = heights[np.isfinite(heights)]
    if len(heights) < len(PLACES) // 2:
        return document
    inner = heights[1:-1]
    turns = inner[(inner - heights[:-2]) * (inner - heights[2:]) > 0]
    if len(turns) and draws.random() < 0.5:
        gap = 10.0 ** draws.uniform(SMALLEST_GAP, -1) * _sign(draws)
        level = _extremum(loop, Z, float(draws.choice(turns)), heights) + gap * float(np.median(abs(heights)))
    else:
        level = float(np.quantile(heights, draws.uniform(0.3, 0.95)))
    if not np.isfinite(level):
        # The extremum is beside a place where the formula has no value.
        return document
    name, key = slot
    part = potential[name]
    part[key] = repr(0.5 * ratio * level)
    return document


def _extremum(loop: Loop, Z: float, seen: float, heights: FloatArray) -> float:
    """Return the extremum about the place of ``seen``, found again on ever finer grids."""
    places = PLACES[len(PLACES) - len(heights) :] if len(heights) < len(PLACES) else PLACES
    k = int(np.argmin(np.abs(heights - seen)))
    is_top = heights[k] > heights[max(k - 1, 0)]
    middle, width = float(places[k]), float(PLACES[1] - PLACES[0])
    best = seen
    for _ in range(8):
        v = np.linspace(middle - width, middle + width, 41)
        values = loop.radicand_real(np.sin(v), np.cos(v)) / (Z * np.sin(v)) ** 2
        j = int(np.argmax(values) if is_top else np.argmin(values))
        middle, width, best = float(v[j]), 0.1 * width, float(values[j])
    return best


def _list(draws: np.random.Generator, longest: int, *, exactly: bool = False) -> list[str]:
    length = longest if exactly else draws.integers(1, longest + 1)
    return [f"{value:.3f}" for value in draws.normal(size=length)]


def _sign(draws: np.random.Generator) -> Literal[-1, 1]:
    return 1 if draws.random() < 0.5 else -1


def _decimal(value: float) -> Fraction:
    return Fraction(f"{value:.4g}")


def _root(value: Fraction) -> Fraction:
    return Fraction(isqrt(int(value * DIGITS**2)), DIGITS)


def _rounded(value: Fraction) -> Fraction:
    """Return 30 significant digits or more."""
    return Fraction(round(value * DIGITS), DIGITS)
