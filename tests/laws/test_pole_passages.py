"""Motions through poles keep what their tier promises, for every A/C: against quadratures done by hand.

With z = g3 = Z sin v on |g1| = (z/λ)^α the motion has z'² = g2² p², p² = 2 C z² (h − V)/(A Q), so that a
time is an integral over v, by the double exponential rule: it asks for no smoothness at the ends.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from flint import arb, ctx, fmpq

from service.dynamics.motion import Motion
from service.schemas.problem.problem import read_problem
from tests.support.effort import one_in
from workers.computation.compute import solve, solve_document

BITS = 400
"""Next to the equator numerator and denominator of the rate vanish: half of the digits are lost there."""
TIERS = {"draft": 1e-6, "standard": 1e-10, "high": 1e-13}
KNOWN = arb("1e-30")
"""What the rule leaves out of a time is below this, in parts of the period: halving its step moves none by as
much."""


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
        "a million": power("1000000", 480),
    }


with ctx.workprec(BITS):
    MOTIONS = motions()


@cache
def period(name: str) -> arb:
    with ctx.workprec(BITS):
        return 2 * (MOTIONS[name].time(arb(0)) + MOTIONS[name].time(arb(0), -1))


@pytest.mark.parametrize(
    ("name", "digits"), [("a2", "6.474555420702909342109184"), ("7/5", "4.438340523080240605568")]
)
def test_known_periods(name, digits):
    # Of another program; the last digit is rounded.
    with ctx.workprec(BITS):
        assert abs(period(name) - arb(digits)) < arb(10) ** (2 - len(digits))


@pytest.mark.parametrize("name", one_in(5, (name for name in MOTIONS if not name.startswith("log"))))
def test_certified_periods_are_those_of_a_quadrature_by_hand(name):
    document = MOTIONS[name].document(time={"times": ["1/2"]}, accuracy={"tier": "certified", "bits": 64})
    told = solve_document(json.dumps(document)).summary["period"]
    with ctx.workprec(BITS):
        radius = arb(told["radius"])
        assert abs(arb(told["value"]) - period(name)) <= radius + KNOWN * period(name)
        assert radius < arb("1e-17") * period(name)


@pytest.mark.parametrize(
    ("name", "tier"),
    [
        *one_in(8, ((name, "standard") for name in MOTIONS)),
        ("a2", "draft"),
        ("a2", "high"),
        ("7/5", "high"),
        ("log, 7/5", "high"),
    ],
)
def test_every_tier_keeps_its_promise(name, tier):
    motion = MOTIONS[name]
    asked = motion.document(time={"times": ["0", "1/2", 100]}, accuracy={"tier": tier})
    found = solve(read_problem(asked))
    assert found.error <= TIERS[tier]
    with ctx.workprec(BITS):
        told = found.dense.period
        assert abs(arb(told.hi) + arb(told.lo) - period(name)) <= told.error + KNOWN * period(name)
        # From the equator g3 falls: the time back to it is that of the sample.
        g2, g3 = found.samples[1, 4:].tolist()
        back = motion.time((arb(g3) / motion.equator).asin(), 1 if g2 > 0 else -1)
        rate = abs(float(np.prod(found.samples[1, [0, 4]])))
        assert float(abs(back - arb(1) / 2)) * rate <= found.error


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("v", "most"), [("1e-4", 1e-10), ("1e-13", 1e-6)])
def test_times_next_to_a_pole_that_nothing_encloses_have_claims_of_their_own(v, most):
    """r is like |t|^(1/2) there: what doubles lose of t moves it by 1e-16 over √t, or by 1e-8 at the pole.

    The first claim is what standard promises, the other the 1e-8 with its factors.
    """
    motion = MOTIONS["log, 3/2"]
    with ctx.workprec(BITS):
        at = arb(v)
        # The pole g2 = -1 comes first, and is passed as it is reached.
        t = (2 * motion.time(arb(0), -1) + motion.time(at)).str(40, radius=False)
        z = motion.equator * at.sin()
        x, rate = z**motion.alpha, motion.rate(at, 1)
        # p g2 is the rate of g3 = Z sin v, and r/p is −A g1/(C g3).
        p = motion.equator * at.cos() / (rate * (1 - z * z - x * x).sqrt())
        known = [float(abs(each)) for each in (p, motion.alpha * x / z * p, x, z)]
    asked = motion.document(time={"times": [t]}, accuracy={"tolerance": 1e-2})
    found = solve(read_problem(asked))
    assert np.abs(np.abs(found.samples[0, [0, 2, 3, 5]]) - known).max() <= found.error < most


def solved(potential: dict[str, object], tier: str, A: str = "2", **wanted: object) -> dict[str, object]:
    motion = {"type": "planar", "lambda": 1, **wanted}
    document = {"body": {"A": A, "C": 1}, "potential": potential, "motion": motion}
    document |= {"time": {"times": ["1/2"]}, "accuracy": {"tier": tier}}
    summary: dict[str, object] = solve_document(json.dumps(document)).summary
    return summary


@pytest.mark.parametrize("A", ["40", "62"])
def test_several_terms_with_a_large_whole_ratio_of_moments(A):
    """Where |g3| is 1/2, |g1| = |g3|^A is below all roundings: no double tells V from its pole at g1 = 0."""
    potential = {"type": "homogeneous", "A": [0, "3/20"], "B": ["-21/8", "3/20", "1/50"]}
    motion = {"lambda": "17/6", "g1_sign": -1}
    found, proven = (solved(potential, tier, A, **motion) for tier in ("standard", "certified"))
    assert found["error"] <= TIERS["standard"]
    # The quadrature in v, and the way through the pole in balls.
    apart = abs(arb(found["period"]["value"]) - arb(proven["period"]["value"]))
    assert apart <= found["period"]["error"] + arb(proven["period"]["radius"])


def test_the_period_of_gravity_is_that_of_its_functions():
    # V1[−√w/2] = −g1 + (√2/3) Q/√(1 − g2²) for A = 2C, since it vanishes in the direction π/4.
    G = "-sqrt(2)/3/sqrt(1 - g2^2)"
    period = solved({"type": "general", "F": "-sqrt(w)/2", "G": G}, "standard")["period"]
    # 2.4 of the theory: the generalised motion of Bobylev and Steklov at α = 2, 34 digits.
    assert abs(arb(period["value"]) - arb("6.432310535121612579869958")) <= period["error"] + 1e-15
    assert period["error"] < 1e-12


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("F", "formula"),
    [
        ("-sqrt(w)/2", "-g1 + sqrt(2)/3*(2*g1^2 + g3^2)/sqrt(g1^2 + g3^2)"),
        ("-w^(3/2)/2", "8*g1*(g1^2 + g3^2) + g3^4/g1 - 17*sqrt(2)/6*(2*g1^2 + g3^2)*sqrt(g1^2 + g3^2)"),
    ],
)
def test_a_potential_by_its_functions_has_the_motions_of_its_formula(F, formula):
    general = solved({"type": "general", "F": F, "G": "0"}, "standard")["period"]
    proven = solved({"type": "expression", "expression": formula}, "certified")["period"]
    assert abs(arb(general["value"]) - arb(proven["value"])) <= general["error"] + 1e-15 * general["value"]


# V1[k w^m] = −|g1|^(4/7) + c Q ρ^(−5/7) for A/C = 7/5: F is −h = −5/7 on the curve λ = 1, w = (2/5)^(2/5)
# there, and V1 is 0 in the direction π/4, where Q = 6/5 ρ. With A/C = 5/7 it is the same with g3 for g1, and
# w = (5/2)^(2/7).
LEVEL, EVEN = "-5/7*(5/2)^(2/7)", "-2^(-2/7)*5/6*(1 - g2^2)^(-5/7)"
GENERAL = {
    "round": (("7/5", "1"), f"{LEVEL}*w^(5/7)", EVEN, "-abs(g1)^(4/7)"),
    "mirrored": (("1", "7/5"), f"{LEVEL}/w", EVEN, "-abs(g3)^(4/7)"),
    "to rest": (
        ("7/5", "1"),
        f"{LEVEL}*w^(5/7)",
        f"{EVEN} + 1 + g2/5",
        "-abs(g1)^(4/7) + (7/5*g1^2 + g3^2)*(1 + g2/5)",
    ),
}


@pytest.mark.parametrize("name", one_in(3, GENERAL))
def test_fractional_powers_of_w_have_the_motions_of_their_formula(name):
    (A, C), F, G, text = GENERAL[name]
    body, motion, times = {"A": A, "C": C}, {"type": "planar", "lambda": 1}, ["0", "1/2", "7", "-31"]

    def found(potential: dict[str, object], accuracy: dict[str, object]) -> Motion:
        document = {"body": body, "potential": potential, "motion": motion, "time": {"times": times}}
        return solve(read_problem({**document, "accuracy": accuracy}))

    # r is a power of time next to a pole, by the exponent 2/5: no double tells it there, but at these times.
    general = found({"type": "general", "F": F, "G": G}, {"tier": "standard"})
    # A phase in which the pole is smooth takes a few panels, not some hundred.
    assert general.evidence["panels"] < 60
    proven = found({"type": "expression", "expression": text}, {"tier": "high"})
    told, known = general.dense.period, proven.dense.period
    assert abs(told.hi - known.hi) <= told.error + known.error + 1e-15 * known.hi
    assert np.abs(general.samples - proven.samples).max() <= general.error + proven.error
