"""The cross-check believes the witness as far as the witness believes itself."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.body import RigidBody
from service.dynamics.potentials.gravity import gravity_potential
from service.dynamics.problem import PlanarMotion
from tests.support.planar import formula, planar
from workers.solvers.cross_check import compare
from workers.solvers.quadrature.solve import solve_planar

ZERO, ONE = Fraction(0), Fraction(1)
HEAVY = gravity_potential(-ONE, ZERO, ZERO)


def body(B: str) -> RigidBody:
    return RigidBody(Fraction(2), Fraction(B), ONE, allow_unphysical=True)


def quadrature(rigid_body, potential, nu, times):
    return solve_planar(planar(rigid_body, potential, PlanarMotion(None, nu=Fraction(nu)), times))


@pytest.mark.parametrize("integrator", ["heyoka", "dop853"])
@pytest.mark.parametrize("text", ["-g1", "-g1 + 1/(20*g3^2)", "-g1 + 1/(50*g3^2) + 6/5*(g1^2 - g2^2)"])
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
    # A factor 100 in the seed of the growth is 1.5 periods.
    assert 3.5 * period <= check.horizon <= 7.0 * period
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
    assert not compare(motion, rigid_body, HEAVY, 1e-10, limit=0.0).agrees
    at_zero = replace(motion, times=np.zeros(1), samples=motion.samples[:1])
    assert compare(at_zero, rigid_body, HEAVY, 1e-10).agrees
