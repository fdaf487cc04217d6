"""Random hostile potentials, each with what is known of it by construction.

A smooth admissible potential, (A g1² + C g3²) times a polynomial in g2 and the two
homogeneous terms of lowest degree, plus something narrow, kinked or flat, which is
admissible or not.
"""

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Literal

import numpy as np

from tests.support.hostile_features import SHAPES, Argument, Feature, Shape, decimal
from tests.support.hostile_known import Document, Known, Level, document_of, level_at

RATIOS = ("2", "2", "2", "3", "4", "17/10", "5/2", "1/2", "3/5", "1/3")
"""A/C."""
ADMISSIBLE = "a function of g2 times A g1^2 + C g3^2"

Truth = Literal["admissible", "inadmissible", "undefined"]


@dataclass(frozen=True, slots=True)
class Hostile:
    """A problem and the truth about it."""

    kind: str
    """The class it is counted in."""
    known: Known | None
    """None where there is no family of motions, and so nothing to refer to."""
    document: Document
    truth: Truth
    reason: str


def draw(draws: np.random.Generator, only: str | None = None) -> Hostile:
    """Return a random hostile problem, of one of ONLY if that is asked."""
    return MAKERS[draws.integers(len(MAKERS))](draws) if only is None else ONLY[only](draws)


def _narrow(draws: np.random.Generator) -> Hostile:
    smooth = draw_smooth(draws)
    shape: Shape = SHAPES[draws.integers(len(SHAPES))]
    feature = draw_feature(smooth, shape, draws)
    known = _with_features(smooth, (feature,), draws)
    return Hostile(f"{shape} {_effect(known)}", known, known.document(), "admissible", ADMISSIBLE)


def _infinite(draws: np.random.Generator) -> Hostile:
    """A place on the sphere, or two, where p² is infinite: a power 1/t, 1/t² or 1/t³."""
    smooth = draw_smooth(draws)
    features = tuple(_pole_inside(smooth, draws) for _ in range(1 if draws.random() < 0.8 else 2))
    known = _with_features(smooth, features, draws)
    return Hostile("infinite inside", known, known.document(), "admissible", ADMISSIBLE)


def _pole_inside(smooth: Known, draws: np.random.Generator) -> Feature:
    feature = replace(draw_feature(smooth, "infinite", draws), power=int(draws.integers(1, 4)))
    return replace(feature, argument="g2", place=Fraction(0)) if draws.random() < 0.05 else feature


def _two(draws: np.random.Generator) -> Hostile:
    smooth = draw_smooth(draws)
    shapes = [SHAPES[draws.integers(len(SHAPES))] for _ in range(2)]
    features = tuple(draw_feature(smooth, shape, draws) for shape in shapes)
    known = _with_features(smooth, features, draws)
    return Hostile("two features", known, known.document(), "admissible", ADMISSIBLE)


def _dressed(draws: np.random.Generator) -> Hostile:
    """A kink across the curves that cancels, inside a feature."""
    smooth = draw_smooth(draws)
    feature = replace(draw_feature(smooth, "gaussian", draws), argument="g2")
    known = _with_features(smooth, (feature,), draws)
    known = replace(known, dressing=decimal(draws.uniform(-2, 2), 2))
    return Hostile("kink that cancels", known, known.document(), "admissible", ADMISSIBLE)


def _with_features(smooth: Known, features: tuple[Feature, ...], draws: np.random.Generator) -> Known:
    is_outside = all(level_at(smooth, feature_g2(feature)) > 0 for feature in features)
    is_even = all(feature.is_even for feature in features)
    if not any(smooth.powers[1::2]) and not is_even and is_outside:
        # Else two windows that differ by the feature's tail alone are mirror images to all digits.
        smooth = replace(smooth, powers=(smooth.powers[0], decimal(draws.uniform(0.05, 0.2), 3)))
    return replace(smooth, features=features)


def _effect(known: Known) -> str:
    feature = known.features[0]
    base = level_at(known, feature_g2(feature))
    if feature.shape in ("kink", "root", "cap") or abs(feature.height) < abs(base):
        return "small"
    return "wall" if feature.height > 0 else "well"


def feature_g2(feature: Feature) -> float:
    """Return a g2 of the place, as a double inside the sphere."""
    x = float(feature.place)
    if feature.argument == "rho":
        return float(np.sqrt(max(0.0, 1.0 - x)))
    return float(np.clip(x, -0.999, 0.999))


def draw_feature(smooth: Known, shape: Shape, draws: np.random.Generator) -> Feature:
    """Return a feature that makes a wall, a well, or changes p² by a little where it is."""
    argument: Argument = "g2" if draws.random() < 0.75 else "rho"
    width = Fraction(f"{10.0 ** draws.uniform(-8, -1):.2e}")
    place = decimal(draws.uniform(-0.97, 0.97) if argument == "g2" else draws.uniform(0.05, 0.99))
    near = draws.random()
    if near < 0.1 and argument == "g2":
        # Next to the equator, or next to a pole.
        away = decimal(10.0 ** draws.uniform(-6, -1.5), 3)
        place = (away if near < 0.05 else 1 - away) * (1 if draws.random() < 0.5 else -1)
    if shape == "cap" and draws.random() < 0.5:
        argument, place = "g2", 1 - decimal(10.0 ** draws.uniform(-5, -1), 3)
    if shape == "pole":
        argument, place = "g2", 1 + width
    power = int(draws.integers(1, 5))
    feature = Feature(shape, argument, Fraction(1), place, width, power)
    base = level_at(smooth, feature_g2(feature))
    size = abs(base) * draws.uniform(1.2, 4.0) if np.isfinite(base) else 1.0
    kind = draws.integers(3)
    if kind == 2:
        height = size * 10.0 ** -float(draws.choice([1, 2, 4, 6])) * (1 if draws.random() < 0.5 else -1)
    else:
        height = size if (base < 0) == (kind == 0) else -size
    # Of kinked shapes the height is the slope: one that reaches the size over the sphere, or the cap.
    if shape in ("kink", "root"):
        height *= float(width)
    if shape == "cap":
        height *= float(width / (2 * max(Fraction(1, 10**6), 1 - place))) ** power
    return replace(feature, height=decimal(height, 3) or Fraction(1, 1000))


def draw_smooth(draws: np.random.Generator) -> Known:
    """Return a potential without features whose motions cover some part of the sphere."""
    places = np.linspace(-0.99, 0.99, 199)
    while True:
        ratio = Fraction(RATIOS[draws.integers(len(RATIOS))])
        C, lambda_ = decimal(draws.uniform(0.5, 2), 3), decimal(10.0 ** draws.uniform(-0.5, 0.5), 3)
        powers = [decimal(value, 3) for value in draws.normal(size=draws.integers(1, 5))]
        kind = draws.integers(4)
        # The first passes the pole, or is repelled from it; the other, which is steeper, repels.
        first = decimal(-abs(draws.normal()) if kind == 1 else abs(draws.normal() / 5), 3)
        first = first if kind else Fraction(0)
        other = decimal(abs(draws.normal() / 20), 3) if kind == 3 else Fraction(0)
        b, c = (first, other) if ratio > 1 else (other, first)
        signs = [1 if draws.random() < 0.5 else -1 for _ in range(2)]
        known = Known(ratio * C, C, lambda_, *signs, tuple(powers), (), b, c)
        # The constant that leaves a motion where p² is largest.
        heights = np.array([-level_at(known, y) for y in places])
        shift = float(np.quantile(heights, draws.uniform(0.3, 0.95)))
        if np.isfinite(heights).all() and heights.max() - shift > 0.02:
            return replace(known, powers=(powers[0] + decimal(shift, 4), *powers[1:]))


def _flat_zero(draws: np.random.Generator) -> Hostile:
    """G = −(g2 − y₁) exp(−(w/(g2 − c))²): p² has a zero of infinite order at c."""
    smooth = draw_smooth(draws)
    first, width = decimal(draws.uniform(-0.9, 0.9), 3), Fraction(f"{10.0 ** draws.uniform(-3, 0):.1e}")
    flat = Feature("hole", "g2", Fraction(1), decimal(draws.uniform(-0.9, 0.9), 3), width)
    known = replace(smooth, powers=(first, Fraction(-1)), b=Fraction(0), c=Fraction(0), flat=flat)
    return Hostile("flat zero", known, known.document(), "admissible", ADMISSIBLE)


def _double(draws: np.random.Generator) -> Known:
    """Return a smooth potential of a body with A = 2C, without homogeneous terms."""
    smooth = draw_smooth(draws)
    return replace(smooth, A=2 * smooth.C, b=Fraction(0), c=Fraction(0))


def _across(draws: np.random.Generator) -> Hostile:
    """Add ε|U|, U admissible and 0 on the line g1 = slope·g3: H jumps where a curve crosses it."""
    smooth, slope = _double(draws), decimal(draws.uniform(0.3, 3), 2)
    # On the line g1² = ρ slope²/(1 + slope²) and 2g1² + g3² = ρ (2 slope² + 1)/(1 + slope²).
    one = 1 + slope**2
    factor = f"({slope * one / (2 * slope**2 + 1)})/sqrt({one})"
    height = Fraction(f"{10.0 ** -float(draws.integers(0, 7)):.0e}")
    text = f"{smooth.text()} + ({height})*abs(g1 - {factor}*(2*g1^2+g3^2)/sqrt(g1^2+g3^2))"
    reason = f"|U|, U = 0 on the line g1 = ({slope})*g3, where H jumps by {height} times 2 H[U]"
    return Hostile("kink across", None, document_of(smooth, text), "inadmissible", reason)


def _level(draws: np.random.Generator) -> Hostile:
    """Add ε|U|, U admissible and 0 on a curve: its kink is crossed by no curve."""
    smooth = replace(_double(draws), g1_sign=1)
    count = 1 if draws.random() < 0.5 else 3
    nu, height = decimal(draws.uniform(0.3, 3), 3), decimal(10.0 ** -draws.uniform(0, 6), 3)
    if count == 3:
        # A second difference: F is a hat on the w-axis as wide as it.
        width = decimal(10.0 ** draws.uniform(-8, -2), 2)
        shifted = zip((-1, 0, 1), (height, -2 * height, height), strict=True)
        levels = tuple(Level(h, nu + k * width) for k, h in shifted)
    else:
        levels = (Level(height, nu),)
    known = replace(smooth, levels=levels)
    reason = f"|U| with U = 0 on the curve g3^2 = ({nu})*g1"
    return Hostile("kink on a level of w", known, known.document(), "admissible", reason)


def _wrong_factor(draws: np.random.Generator) -> Hostile:
    """Times a factor that is not A g1² + C g3²: L(V) ≠ 0, if only where the feature is."""
    smooth = draw_smooth(draws)
    shape: Shape = ("gaussian", "bump", "step", "packet", "spike", "cap", "kink", "cap")[draws.integers(8)]
    feature = draw_feature(smooth, shape, draws)
    off = 1 + Fraction(f"{10.0 ** -float(draws.integers(0, 7)):.0e}")
    factor = f"(A*g1^2+({off})*C*g3^2)" if draws.random() < 0.7 else "(g1*g3)"
    term = f"{factor}*{feature.text()}"
    document = document_of(smooth, f"{smooth.text()} + {term}")
    return Hostile(f"wrong factor {shape}", None, document, "inadmissible", f"{term} is not admissible")


def _angle(draws: np.random.Generator) -> Hostile:
    """A feature across a line g1 = slope·g3 + c that all curves, or some, cross: L(V) ≠ 0 about it."""
    smooth = draw_smooth(draws)
    shape: Shape = ("gaussian", "bump", "step", "packet", "spike", "cap", "kink")[draws.integers(7)]
    feature = replace(draw_feature(smooth, shape, draws), argument="g2")
    place = decimal(draws.uniform(-0.6, 0.6), 3) if shape != "cap" else decimal(draws.uniform(0.5, 0.99), 4)
    slope = decimal(draws.uniform(-1, 1), 2)
    # |g1 − slope g3| reaches √(1 + slope²) > 1 > place on the sphere.
    term = f"(A*g1^2+C*g3^2)*{replace(feature, place=place).text(f'(g1-({slope})*g3)')}"
    document = document_of(smooth, f"{smooth.text()} + {term}")
    return Hostile(f"in the angle {shape}", None, document, "inadmissible", f"{term} is not admissible")


def _without_value(draws: np.random.Generator) -> Hostile:
    """Add a term that has no value anywhere, if times 0."""
    smooth = draw_smooth(draws)
    term = ("0*sqrt(-1-g1^2)", "0*log(-1-g3^2)", "0/(g1-g1)", "(-2-g2)^(1/2)-(-2-g2)^(1/2)")
    text = f"{smooth.text()} + {term[draws.integers(len(term))]}"
    return Hostile("no value", None, document_of(smooth, text), "undefined", text)


def written_with_cancellation(draws: np.random.Generator) -> Hostile:
    """A smooth potential, or one with a kink, in a formula of which most cancels on the sphere."""
    known = draw_smooth(draws)
    if draws.random() < 0.3:
        feature = replace(draw_feature(known, "kink", draws), argument="g2")
        known = replace(known, features=(replace(feature, width=Fraction(1), power=1),))
    text, plain = known.text(), known.text()
    for kind in draws.choice(9, size=draws.integers(1, 4), replace=False):
        size = Fraction(f"{10.0 ** draws.uniform(0, 9):.1e}")
        factor = ("1", "g1", "g3", "g1*g3", "exp(g2)", "abs(g2)")[draws.integers(6)]
        u = ("g1", "g2", "g3", "g1*g3", "(g1+2*g3)")[draws.integers(5)]
        place = decimal(draws.uniform(-0.9, 0.9), 2)
        text = (
            f"{text} + {size}*{factor}*(g1^2+g2^2+g3^2-1)",
            f"{text} + {size}*(sin({u})^2+cos({u})^2)*{factor} - {size}*{factor}",
            f"({text})*sqrt(1-g2^2)/sqrt(g1^2+g3^2)",
            f"{text} + sqrt(1-g1^2-g3^2)*{factor} - abs(g2)*{factor}",
            f"({text})*(1+{size}*g3^2) - {size}*g3^2*({plain})",
            f"{text} + {size}*{factor}*((g1+g2)^2-(1-g3^2)-2*g1*g2)",
            f"{text} + (A*g1^2+C*g3^2)*(sqrt(g2^2-2*({place})*g2+({place**2}))-abs(g2-({place})))",
            f"({text})*(g1^2+g2^2+g3^2)^{draws.integers(2, 12)}",
            f"{text} + {size}*(log(exp({u}))-{u}) + exp(log(2+g1))-2-g1",
        )[kind]
    known = replace(known, disguise=text)
    return Hostile("written with cancellation", known, known.document(), "admissible", ADMISSIBLE)


MAKERS = (_narrow,) * 12 + (
    _two,
    written_with_cancellation,
    _dressed,
    _flat_zero,
    _across,
    _level,
    _wrong_factor,
    _angle,
    _without_value,
)
"""The makers of problems, one of which is drawn."""
ONLY = {"infinite": _infinite, "cancellation": written_with_cancellation}
"""Classes of problems that are asked alone."""
