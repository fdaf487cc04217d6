"""Proofs that there is no motion, held against p² along the loops."""

import math
from fractions import Fraction

import numpy as np
import pytest
from flint import fmpq

from service.dynamics.problem import PlanarMotion
from service.dynamics.verdict.proofs.power_sums import judge_power_sum
from workers.solvers.compiled.frame import Bodies, loops_of
from workers.sweeping.parameters.models import model_of
from workers.sweeping.parameters.templates import MomentsOfPoint
from workers.sweeping.planar.exclusions import sums_have_no_motion

LOG_LAMBDA = math.log(0.9)


def case(text, A, C, **parameters):
    given = {name: str(value) for name, value in parameters.items()}
    document = {"type": "expression", "expression": text, "parameters": given}
    moments = MomentsOfPoint(fmpq(A), None, fmpq(C))
    potential = model_of(document, (), frozenset()).potential(moments, [])
    return moments, judge_power_sum(moments.A, moments.C, potential.tape), potential


def double(value):
    return int(value.p) / int(value.q)


def largest(moments, potential, motion):
    """The largest p², up to a positive factor, at many places of the half of the loop."""
    A, C = double(moments.A), double(moments.C)
    g1 = np.geomspace(1e-6, 1.0, 20_001)
    g3 = math.exp(LOG_LAMBDA) * g1 ** (C / A)
    g1, g3 = g1[g1**2 + g3**2 < 1.0], g3[g1**2 + g3**2 < 1.0]
    found = []
    for sign in (1.0, -1.0):
        one, three = motion.sign_of_g1 * g1, motion.g3_sign * g3
        D = potential.D_real(one, sign * np.sqrt(1.0 - g1**2 - g3**2), three)
        found.append((three * D / ((A - C) * one)).max())
    return max(found)


BODIES = [(fmpq(17, 10), 1), (2, 1), (3, 1), (1, fmpq(8, 5)), (fmpq(9, 4), fmpq(11, 10))]
TEXTS = [
    ("abs(g1)^(2*(A-C)/A) + a/abs(g3)^(2*(A-C)/C)", (-1, 0, 1, "1/9")),
    ("a*abs(g1)^(2*(A-C)/A) + (A*g1^2+C*g3^2)*(g2 - 1/3)", (-9, -1, 1, 9)),
    ("a*g1 + (A*g1^2+C*g3^2)*g2^2", (-2, "-1/9", "1/9", 2)),
]


@pytest.mark.parametrize("motion", [PlanarMotion(Fraction(9, 10)), PlanarMotion(Fraction(9, 10), g1_sign=-1)])
def test_no_motion_is_claimed_where_there_is_none_alone(motion):
    cases = [case(text, A, C, a=a) for text, values in TEXTS for a in values for A, C in BODIES]
    alpha = np.array([double(max(m.A / m.C, m.C / m.A)) for m, *_ in cases])
    bodies = Bodies(alpha, np.ones(len(cases)), np.array([m.A < m.C for m, *_ in cases]))
    loops = loops_of(bodies, motion, [LOG_LAMBDA] * len(cases))
    claimed = sums_have_no_motion([(m, judgement) for m, judgement, _ in cases], loops, motion)
    seen = np.array([largest(m, potential, motion) for m, _, potential in cases])
    assert not (claimed & (seen > 0.0)).any()
    # What is clearly negative is proved too.
    assert (claimed | (seen > -1e-9)).all()
    assert 5 < claimed.sum() < len(cases) - 5
