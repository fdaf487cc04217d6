"""Features that are hard to see: narrow, kinked, flat, or with a pole beside the sphere or on it.

Each is a function f of g2, or of ρ = g1² + g3² = 1 − g2², written as a formula and
evaluated here without any parser. A feature times A g1² + C g3² is an admissible
potential, whatever f is.
"""

from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, get_args

from flint import acb, arb

from tests.support import jets
from tests.support.jets import Jet, Value, absolute, exp, sin

Bounded = Literal["gaussian", "bump", "step", "packet", "spike", "kink", "root", "cap", "hole", "pole"]
Shape = Bounded | Literal["infinite"]
SHAPES: tuple[Bounded, ...] = get_args(Bounded)
KINKED: tuple[Shape, ...] = ("spike", "kink", "root", "cap")
Argument = Literal["g2", "rho"]
RHO = "(g1^2+g3^2)"
INSIDE = 2
"""The side of what is so near the place of a hole that the hole is 0 there, to 43 digits."""
WAVES = 8
"""Radians of the packet's wave in one width."""


def decimal(value: float, digits: int = 4) -> Fraction:
    """Return the value of a short decimal."""
    return Fraction(f"{value:.{digits}g}")


def exact(value: Fraction) -> arb:
    """Return the ball of an exact number at the current precision."""
    return arb(value.numerator) / value.denominator


@dataclass(frozen=True, slots=True)
class Feature:
    """f(x), x = g2 or ρ, with t = (x − place)/width."""

    shape: Shape
    argument: Argument
    height: Fraction
    place: Fraction
    width: Fraction
    power: int = 2

    def text(self, g2: str = "g2") -> str:
        x = g2 if self.argument == "g2" else RHO
        away, width, height = f"({x}-({self.place}))", self.width, f"({self.height})"
        t = f"({away}/({width}))"
        match self.shape:
            case "gaussian":
                return f"{height}*exp(-{t}^2)"
            case "bump":
                return f"{height}/(1+{t}^2)"
            case "step":
                return f"{height}/(1+exp(-{t}))"
            case "packet":
                return f"{height}*exp(-{t}^2)*sin({WAVES}*{t})"
            case "spike":
                return f"{height}*exp(-abs{t})"
            case "kink":
                return f"{height}*abs{t}"
            case "root":
                return f"{height}*sqrt({t}^2)"
            case "cap":
                return f"{height}*(abs{t}+{t})^{self.power}"
            case "hole":
                return f"{height}*exp(-1/{t}^2)"
            case "pole":
                # x < place: positive on the sphere.
                return f"{height}*({width})/(({self.place})-{x})"
            case "infinite":
                return f"{height}/{t}^{self.power}"

    def value(self, y: Value, side: int = 0) -> Value:
        """Return f where g2 = y; ``side`` is the sign of x − place, 0 if not known."""
        x = y if self.argument == "g2" else 1 - y * y
        t = (x - exact(self.place)) / exact(self.width)
        height = exact(self.height)
        match self.shape:
            case "gaussian":
                return height * exp(-t * t)
            case "bump":
                return height / (1 + t * t)
            case "step":
                return height * _step(t)
            case "packet":
                return height * exp(-t * t) * sin(WAVES * t)
            case "spike":
                return height * exp(-absolute(t, side))
            case "kink" | "root":
                return height * absolute(t, side)
            case "cap":
                return _cap(height, t, side, self.power)
            case "hole":
                return 0 * t if side == INSIDE else height * _hole(t)
            case "pole":
                return -height / t
            case "infinite":
                return height / jets.power(t, self.power)

    def distance(self, y: Value, side: int) -> Value:
        """Return |t| where g2 = y, on the given side of the place."""
        x = y if self.argument == "g2" else 1 - y * y
        return side * (x - exact(self.place)) / exact(self.width)

    def places(self) -> list[arb]:
        """Return the g2, in (−1, 1), about which f is not like elsewhere."""
        at = exact(self.place)
        if self.argument == "g2":
            return [at] if abs(self.place) < 1 else []
        if not 0 < self.place < 1:
            return []
        root = (1 - at).sqrt()
        return [root, -root]

    def widths(self) -> list[arb]:
        """Return the widths, in g2, about the places."""
        width = exact(self.width)
        if self.argument == "g2":
            return [width] * len(self.places())
        return [width / (2 * abs(place)) for place in self.places()]

    @property
    def is_kinked(self) -> bool:
        """f is not analytic at its places."""
        return self.shape in KINKED or self.shape == "hole"

    @property
    def is_even(self) -> bool:
        """f is the same for g2 and −g2."""
        return self.argument == "rho" or (
            self.place == 0
            and self.shape not in ("step", "packet", "cap", "pole")
            and (self.shape != "infinite" or self.power % 2 == 0)
        )

    def side(self, y: float) -> int:
        """Return the sign of x − place for a double y."""
        x = y if self.argument == "g2" else 1.0 - y * y
        return 1 if x > float(self.place) else -1


def _cap(height: arb, t: Value, side: int, power: int) -> Value:
    if side < 0:
        return 0 * t
    if side > 0:
        return height * jets.power(2 * t, power)
    return height * jets.power(absolute(t, 0) + t, power)


def _step(t: Value) -> Value:
    """Return 1/(1 + exp(−t)), without large exponentials."""
    if isinstance(t, Jet):
        value = _step(t.value)
        return Jet(value, value * _step(-t.value) * t.slope)
    if isinstance(t, arb) and not (t > 0 or t < 0 or t.is_exact()):
        low, high = (_step(arb(end)) for end in (t.lower(), t.upper()))
        return low.union(high)
    if (t.real if isinstance(t, acb) else t) < 0:
        y = t.exp()
        return y / (1 + y)
    return 1 / (1 + (-t).exp())


def _hole(t: Value) -> Value:
    """Return exp(−1/t²), 0 where t = 0."""
    if isinstance(t, acb):
        return (-1 / (t * t)).exp()
    if isinstance(t, Jet):
        value = _hole(t.value)
        if t.value.contains(0):
            # |2 exp(−1/t²)/t³| rises up to |t| = √(2/3), where it is 1.64; below 1/10 it is nothing.
            largest = arb(2).max(arb(0)) if not abs(t.value) < arb("0.1") else arb("1e-39")
            return Jet(value, arb(0, largest) * t.slope)
        return Jet(value, 2 * value / jets.power(t.value, 3) * t.slope)
    if t.contains(0):
        most = (-1 / arb(t.abs_upper()) ** 2).exp()
        return most.union(arb(0))
    return (-1 / (t * t)).exp()
