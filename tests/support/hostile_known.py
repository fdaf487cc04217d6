"""An admissible potential whose parts are known, its formula, and p² along a curve in doubles."""

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from tests.support.hostile_features import RHO, Feature

Document = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Level:
    """ε|U|, U = g1 − (2g1² + g3²)/√(ν² + 4ρ) for A = 2C: admissible on both sides of the curve g3² = νg1,
    where it is 0. On any other curve with g1 > 0 it is a multiple of g1 and one of A g1² + C g3².
    """

    height: Fraction
    nu: Fraction

    def text(self) -> str:
        return f"({self.height})*abs(g1 - (2*g1^2+g3^2)/sqrt(({self.nu})^2+4*{RHO}))"

    def signed(self, lambda_: Fraction) -> Fraction:
        """Return ε with the sign of U on the curve of λ."""
        return self.height if lambda_**2 < self.nu else -self.height


@dataclass(frozen=True, slots=True)
class Known:
    """An admissible potential and a curve.

    V = (A g1² + C g3²) (Σ a_k g2^k + Σ features) + b|g1|^(2(α−1)/α) + c|g3|^(−2(α−1)) + Σ levels,
    the factor (Σ a_k g2^k + Σ features) times a hole if there is a flat place.
    """

    A: Fraction
    C: Fraction
    lambda_: Fraction
    g1_sign: int
    g3_sign: int
    powers: tuple[Fraction, ...]
    features: tuple[Feature, ...]
    b: Fraction
    c: Fraction
    flat: Feature | None = None
    levels: tuple[Level, ...] = ()
    dressing: Fraction | None = None
    """Slope m: features are written as functions of g2 + |g1 − m g3|² − (g1 − m g3)², which is g2."""

    disguise: str | None = None
    """A formula that is equal on the sphere, and is written instead."""

    @property
    def is_even(self) -> bool:
        """V is the same for g2 and −g2."""
        return (
            not any(self.powers[1::2])
            and all(feature.is_even for feature in self.features)
            and (self.flat is None or self.flat.is_even)
        )

    def text(self) -> str:
        if self.disguise is not None:
            return self.disguise
        alpha = self.A / self.C
        g2 = "g2"
        if self.dressing is not None:
            line = f"(g1-({self.dressing})*g3)"
            g2 = f"(g2+abs{line}^2-{line}^2)"
        terms = [f"({a})*g2^{k}" for k, a in enumerate(self.powers) if a]
        terms += [feature.text(g2) for feature in self.features]
        inner = " + ".join(terms) or "0"
        if self.flat is not None:
            inner = f"({inner})*{self.flat.text()}"
        text = f"(A*g1^2+C*g3^2)*({inner})"
        if self.b:
            text += f" + ({self.b})*{_power('g1', self.g1_sign, 2 * (alpha - 1) / alpha)}"
        if self.c:
            text += f" + ({self.c})*{_power('g3', self.g3_sign, -2 * (alpha - 1))}"
        return " + ".join([text, *(level.text() for level in self.levels)])

    def motion(self) -> Document:
        return {
            "type": "planar",
            "lambda": str(self.lambda_),
            "g1_sign": self.g1_sign,
            "g3_sign": self.g3_sign,
        }

    def document(self) -> Document:
        """Return the document without times, tier, window and start."""
        return document_of(self, self.text())


def _power(name: str, sign: int, power: Fraction) -> str:
    if power == 1:
        return f"({sign}*{name})"
    return f"{name}^({power})" if power.denominator == 1 and power % 2 == 0 else f"abs({name})^({power})"


def document_of(known: Known, text: str) -> Document:
    """Return the document of another formula for the same body and curve."""
    # Any B that a body can have; it has no part in planar motions.
    body = {"A": str(known.A), "B": str(max(known.A, known.C)), "C": str(known.C)}
    return {
        "body": body,
        "potential": {"type": "expression", "expression": text},
        "motion": known.motion(),
    }


def level_at(known: Known, y: float) -> float:
    """Return −p²·A/(2C g3²), of the body with A > C, where g2 = y: negative where there is motion.

    Without features, flat places and levels, in doubles.
    """
    total = sum(float(a) * y**k for k, a in enumerate(known.powers))
    g1, g3 = _place_on_curve(known, y)
    A, C, size = float(known.A), float(known.C), float(known.lambda_)
    if known.b:
        total += float(known.b) * size**2 / (A * g3**2)
    if known.c:
        total += float(known.c) * size ** (-2 * A / C) / (C * g1**2)
    return total


def _place_on_curve(known: Known, y: float) -> tuple[float, float]:
    """Return |g1| and |g3| where g2 = y."""
    rho, power, size = 1.0 - y * y, float(known.C / known.A), float(known.lambda_)
    low, high = 0.0, rho**0.5
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (middle, high) if middle**2 + size**2 * middle ** (2 * power) < rho else (low, middle)
    return high, (rho - high * high) ** 0.5 if high * high < 0.5 * rho else size * high**power
