"""Motions through poles, with times by quadratures done by hand.

With z = g3 = Z sin v on |g1| = (z/λ)^α the motion has z'² = g2² p², p² = 2 C z² (h − V)/(A Q), so that a
time is an integral over v, by the double exponential rule: it asks for no smoothness at the ends.
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache

from flint import arb, ctx, fmpq

BITS = 400
"""Next to the equator numerator and denominator of the rate vanish: half of the digits are lost there."""
KNOWN = arb("1e-30")
"""A bound of the part of a time that the rule leaves out, in parts of the period: halving its step moves none
by as much."""


@dataclass(frozen=True)
class Passing:
    """A motion from pole to equator, λ = 1, C = 1, from the equator at g1, g3 > 0; V even in g3."""

    A: str
    potential: dict[str, object]
    V: Callable[[arb, arb, arb], arb]
    """Potential as a function of g1 > 0, g3 > 0 and 1 − g2."""
    h: arb
    nodes: int = 120
    """Nodes of the rule on each side: next to the equator there may be a layer as thin as 1/√(A/C)."""

    @property
    def alpha(self) -> arb:
        return number(self.A)

    @property
    def equator(self) -> arb:
        """Return Z, by Newton's method for z² + z^2α = 1, which is convex."""
        z = arb(1)
        for _ in range(30):
            power = z ** (2 * self.alpha)
            z = (z - (z * z + power - 1) / (2 * z + 2 * self.alpha * power / z)).mid()
        return z

    def rate(self, v: arb, hemisphere: int) -> arb:
        """Return |dt/dv|."""
        sine, cosine = v.sin_cos()
        z = self.equator * sine
        x = z**self.alpha
        g2 = (1 - z * z - x * x).sqrt()
        Q = self.alpha * x * x + z * z
        drop = (z * z + x * x) / (1 + g2) if hemisphere > 0 else 1 + g2
        p = (2 * z * z * (self.h - self.V(x, z, drop)) / (self.alpha * Q)).sqrt()
        return self.equator * cosine / (g2 * p)

    def time(self, v: arb, hemisphere: int = 1) -> arb:
        """Return the time from v ≤ π/2 in a hemisphere to the equator."""
        half, total = (arb.pi() / 2 - v) / 2, arb(0)
        step = arb(4) / self.nodes
        for k in range(-self.nodes, self.nodes + 1):
            t = k * step
            w = (arb.pi() * t.sinh() / 2).exp()
            # The place from the nearer end.
            at = v + 2 * half * w / (w + 1 / w) if k < 0 else arb.pi() / 2 - 2 * half / w / (w + 1 / w)
            total += self.rate(at, hemisphere) * 2 * arb.pi() * half * t.cosh() / (w + 1 / w) ** 2
        return (total * step).mid()

    def document(self, **wanted: object) -> dict[str, object]:
        motion = {"type": "planar", "lambda": 1}
        return {"body": {"A": self.A, "C": 1}, "potential": self.potential, "motion": motion, **wanted}


def number(text: str) -> arb:
    exact = Fraction(text)
    return arb(fmpq(exact.numerator, exact.denominator))


def power(A: str, nodes: int = 120) -> Passing:
    """Return V = −|g1|^(2(α−1)/α): p is constant and h = 1/α."""
    with ctx.workprec(BITS):
        exponent, h = 2 * (1 - 1 / number(A)), 1 / number(A)
        return Passing(A, {"type": "homogeneous", "B": [-1]}, lambda x, *_: -(x**exponent), h, nodes)


def motions() -> dict[str, Passing]:
    third, a2 = number("1/3"), [-1, "1/100"]

    def V_2(x: arb, z: arb, _: arb) -> arb:
        return -x + (8 * x * (x * x + z * z) + z**4 / x) / 100

    def V_c(x: arb, z: arb, u: arb) -> arb:
        return V_2(x, z, u) + (2 * x * x + z * z - 1) / 5 + (1 - x * x - z * z) * (2 * x * x + z * z) / 10

    def V_B(x: arb, z: arb, _: arb) -> arb:
        return -(x ** (2 * third)) + (3 * x ** (4 * third) + z * z / x ** (2 * third)) / 20

    def V_root(x: arb, z: arb, u: arb) -> arb:
        return -x + (2 * x * x + z * z) * u.sqrt() / 20

    def V_log(A: str) -> Callable[[arb, arb, arb], arb]:
        alpha = number(A)
        return lambda x, z, u: -(x ** (2 - 2 / alpha)) + (alpha * x * x + z * z) * u.log() / 20

    def V_steep(x: arb, z: arb, u: arb) -> arb:
        return -(x ** number("97/49")) + (98 * x * x + z * z) * (1 - u) * (1 + u) / 200

    def formula(text: str) -> dict[str, object]:
        return {"type": "expression", "expression": text}

    c = ["1/5", "1/10"]
    return {
        "a2": Passing("2", {"type": "rational", "a": a2}, V_2, number("101/200")),
        "c1 and c2": Passing("2", {"type": "rational", "a": a2, "c": c}, V_c, number("61/200")),
        "B_1": Passing("3/2", {"type": "homogeneous", "B": [-1, "1/10"]}, V_B, number("7/10")),
        "root": Passing("2", formula("-g1 + (2*g1^2 + g3^2)*sqrt(1 - g2)/20"), V_root, number("1/2")),
        "log": Passing("2", formula("-g1 + (2*g1^2 + g3^2)*log(1 - g2)/20"), V_log("2"), number("1/2")),
        "log, 3/2": Passing(
            "3/2", formula("-abs(g1)^(2/3) + (3/2*g1^2 + g3^2)*log(1 - g2)/20"), V_log("3/2"), number("2/3")
        ),
        "log, 7/5": Passing(
            "7/5", formula("-abs(g1)^(4/7) + (7/5*g1^2 + g3^2)*log(1 - g2)/20"), V_log("7/5"), number("5/7")
        ),
        "7/5": power("7/5"),
        "101/100": power("101/100"),
        "11/10": power("11/10"),
        "13/10": power("13/10"),
        "17/4": power("17/4"),
        "next to 1": power("1000000001/1000000000"),
        "101/2": power("101/2", 240),
        # V hardly varies along the curve, and much in g1 and in g2.
        "98": Passing(
            "98",
            formula("-abs(g1)^(97/49) + (98*g1^2 + g3^2)*(g2 - g2^2/2)/100"),
            V_steep,
            number("1/98"),
            240,
        ),
        "a million": power("1000000", 480),
    }


with ctx.workprec(BITS):
    MOTIONS = motions()


@cache
def period(name: str) -> arb:
    with ctx.workprec(BITS):
        return 2 * (MOTIONS[name].time(arb(0)) + MOTIONS[name].time(arb(0), -1))
