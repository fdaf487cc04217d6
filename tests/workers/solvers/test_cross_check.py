"""The cross-check believes the witness as far as the witness believes itself."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.body import RigidBody
from service.dynamics.potentials.families.coefficients import gravity_potential
from service.dynamics.problem import PlanarMotion
from tests.support.effort import each_once
from tests.support.heyoka_integrator import HEYOKA
from tests.support.planar import formula, planar
from tests.support.solving import solve_planar
from workers.cli.documents import describe
from workers.computation.compute import solve_document
from workers.solvers.cross_check import compare

ZERO, ONE = Fraction(0), Fraction(1)
HEAVY = gravity_potential(-ONE, ZERO, ZERO)


def body(B: str) -> RigidBody:
    return RigidBody(Fraction(2), Fraction(B), ONE, allow_unphysical=True)


def quadrature(rigid_body, potential, nu, times):
    return solve_planar(planar(rigid_body, potential, PlanarMotion(None, nu=Fraction(nu)), times))


@each_once(
    text=["-g1", "-g1 + 1/(20*g3^2)", "-g1 + 1/(50*g3^2) + 6/5*(g1^2 - g2^2)"],
    integrator=["taylor", HEYOKA, "dop853"],
)
def test_right_quadrature_is_confirmed_over_all_its_times(text, integrator):
    rigid_body = body("3/2")
    potential = formula(text, rigid_body)
    motion = quadrature(rigid_body, potential, 1, (-3, 0, 1, 10, 20))
    check = compare(motion, rigid_body, potential, 1e-10, integrator=integrator)
    assert check.agrees
    assert check.horizon == 20.0
    # Local errors of 1e-14 (DOP853) over some five periods, times their linear growth.
    assert check.disagreement <= 1e-10
    assert integrator in check.method


def test_wrong_quadrature_is_refuted():
    """A field 1e-7 stronger than the one solved: no claim explains the difference."""
    rigid_body = body("3/2")
    motion = quadrature(rigid_body, HEAVY, 1, (0, 10))
    stronger = gravity_potential(Fraction(-10_000_001, 10_000_000), ZERO, ZERO)
    check = compare(motion, rigid_body, stronger, 1e-10)
    assert not check.agrees
    assert check.disagreement > 1e-8


def test_horizon_shrinks_to_what_an_instability_leaves():
    """Bobylev-Steklov with nu = 2, B = 4: rounding grows by 19.64 in each full period.

    From 1e-16 to 1e-9 there are 5.4 periods, whatever the integrator; the
    witness leaves the plane, the quadrature does not.
    """
    rigid_body = body("4")
    motion = quadrature(rigid_body, HEAVY, 2, tuple(range(0, 101, 5)))
    period = motion.dense.period.hi
    check = compare(motion, rigid_body, HEAVY, 1e-10)
    assert check.agrees
    # A factor 100 in the seed of the growth is 1.5 periods; the claim begins with four standard deviations of
    # what some dozen steps lose across the plane, each a few roundings: 500 times 1e-16 are 2.1 periods.
    assert 3.0 * period <= check.horizon <= 7.0 * period
    assert check.disagreement <= 1e-8
    stable = compare(quadrature(body("3/2"), HEAVY, 2, tuple(range(0, 101, 5))), body("3/2"), HEAVY, 1e-10)
    assert stable.agrees
    assert stable.horizon == 100.0


def test_horizon_ends_where_the_steps_do():
    """A million of periods is not integrated: what was compared is told."""
    rigid_body = body("3/2")
    motion = quadrature(rigid_body, HEAVY, 1, (0, 6_000_000))
    check = compare(motion, rigid_body, HEAVY, 1e-9, integrator="dop853")
    assert check.agrees
    assert 10.0 < check.horizon < 1000.0


def test_nothing_is_compared_beyond_the_limit():
    rigid_body = body("3/2")
    motion = quadrature(rigid_body, HEAVY, 1, (-10, 0, 10))
    check = compare(motion, rigid_body, HEAVY, 1e-10, limit=1.25)
    assert check.agrees
    assert check.horizon == 1.25


def test_comparison_at_the_start_alone_confirms_nothing():
    rigid_body = body("3/2")
    motion = quadrature(rigid_body, HEAVY, 1, (0, 10))
    nothing = compare(motion, rigid_body, HEAVY, 1e-10, limit=0.0)
    assert not nothing.agrees
    assert nothing.why_none is not None
    assert "convention" in nothing.why_none
    at_zero = replace(motion, times=np.zeros(1), samples=motion.samples[:1])
    start = compare(at_zero, rigid_body, HEAVY, 1e-10)
    assert (start.agrees, start.why_none) == (True, None)


def test_a_witness_that_cannot_follow_is_no_disagreement():
    """A field of 1e-150: the motion takes 1e75, and no step of an integrator sees it move."""
    document = {
        "body": {"A": 2, "B": "3/2", "C": 1},
        "potential": {"type": "expression", "expression": "-g1*1e-150"},
        "motion": {"type": "planar", "lambda": 1},
        "time": {"periods": 1, "samples": 6},
        "method": "both",
    }
    summary = solve_document(json.dumps(document)).summary
    assert summary is not None
    check = summary["cross_check"]
    assert set(check) == {"method", "disagreement", "horizon", "agrees"}
    assert (check["horizon"], check["agrees"]) == (0.0, False)
    (warning,) = summary["warnings"]
    assert (warning["code"], warning["pointer"]) == ("no_cross_check", "/method")
    said = describe(summary, {})
    assert "DISAGREES" not in said
    assert "could not follow the motion from t = 0 on: the " in said


@pytest.mark.long
def test_weak_kink_that_both_runs_cross_alike_is_no_disagreement():
    """What a crossing leaves, both left alike: their difference said 1e-9 where they were off by 1.5e-9."""
    rigid_body = RigidBody(Fraction(251, 250), Fraction(251, 250), Fraction(251, 500), allow_unphysical=True)
    kink = "93/500000000000*abs((g2 - 2191/10000)/(33/400000000))"
    smooth = "-5713/250 - 157/100*g2 - 611/1000*g2^2 - 277/1000*g2^3"
    potential = formula(f"(A*g1^2+C*g3^2)*({smooth} + {kink}) + 283/5000*g1 + 161/2000*g3^(-2)", rigid_body)
    motion = solve_planar(planar(rigid_body, potential, PlanarMotion(Fraction(347, 1000)), (0, 6, 12)))
    check = compare(motion, rigid_body, potential, 1e-10)
    assert check.agrees
    # Two periods of 0.78: the comparison is about something.
    assert check.horizon > 1.0
