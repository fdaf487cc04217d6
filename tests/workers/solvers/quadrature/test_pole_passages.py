"""A way through a pole that is a convention is told in every tier, with when it is first taken."""

import json

import numpy as np
import pytest

from service.schemas.problem.problem import read_problem
from workers.computation.compute import solve, solve_document
from workers.solvers.assembly.families import SYMMETRIC_POLE_PASSAGE

# A = 2C, where the compiled solver has the motion too; V has terms in |g1|, whose slope jumps at the pole.
DOCUMENT = {
    "body": {"A": 2, "C": 1},
    "potential": {"type": "homogeneous", "A": ["4.8", "0.4", "-0.7"], "B": ["-0.85", "-0.32"]},
    "motion": {"type": "planar", "lambda": "0.546", "g1_sign": -1, "g3_sign": -1, "window": 1},
    "time": {"times": [0, "1/2", 40]},
}


@pytest.mark.parametrize("tier", ["draft", "standard", "high"])
def test_the_first_passage_is_at_a_pole(tier):
    motion = solve(read_problem({**DOCUMENT, "accuracy": {"tier": tier}}))
    assert motion.conventions == (SYMMETRIC_POLE_PASSAGE,)
    passage = motion.first_passage
    assert isinstance(passage, float)
    there = motion.dense(np.array([passage]))[0]
    # Next to the pole g3 grows with time, and its time is known to a few ulp of the period.
    assert abs(there[5]) <= motion.dense.error_at(np.array([passage]))
    assert abs(there[4]) == pytest.approx(1.0, abs=motion.error)
    before = motion.dense(np.linspace(0.0, passage, 50)[:-1])
    assert np.all(np.sign(before[:, 5]) == np.sign(before[0, 5]))


def test_it_is_told_with_the_solution():
    outcome = solve_document(json.dumps({**DOCUMENT, "accuracy": {"tier": "standard"}}))
    motion = solve(read_problem({**DOCUMENT, "accuracy": {"tier": "standard"}}))
    assert outcome.summary["evidence"]["first_pole_passage"] == motion.first_passage
    assert "proven_samples" not in outcome.summary["evidence"]
