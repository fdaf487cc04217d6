"""Motions through poles keep what their tier promises, for every A/C: against quadratures done by hand."""

import json

import numpy as np
import pytest
from flint import arb, ctx

from service.dynamics.motion import Motion
from service.schemas.problem.problem import read_problem
from tests.support.effort import one_in, seldom
from tests.support.pole_passages import BITS, KNOWN, MOTIONS, period
from workers.computation.compute import solve, solve_document

TIERS = {"draft": 1e-6, "standard": 1e-10, "high": 1e-13}


@pytest.mark.parametrize(
    ("name", "digits"), [("a2", "6.474555420702909342109184"), ("7/5", "4.438340523080240605568")]
)
def test_known_periods(name, digits):
    # Of another program; the last digit is rounded.
    with ctx.workprec(BITS):
        assert abs(period(name) - arb(digits)) < arb(10) ** (2 - len(digits))


@pytest.mark.parametrize("name", one_in(10, (name for name in MOTIONS if not name.startswith("log"))))
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
        *seldom(("7/5", "high"), ("log, 7/5", "high")),
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


@pytest.mark.parametrize("A", ["40", *seldom("62")])
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
