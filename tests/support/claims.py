"""Claimed errors against certified motions, for tests and the benchmark of honesty."""

from dataclasses import dataclass, replace
from fractions import Fraction
from math import nan

import numpy as np
from flint import arb, ctx

from service.dynamics.formula.algebras.ball import ball
from service.dynamics.problem import PlanarMotion, Problem, Tier
from service.dynamics.reduction.window import starting_point
from service.dynamics.solution.dense_output import FloatArray
from service.schemas.problem.problem import read_problem
from tests.support.random_documents import Document, Drawn, Family, draw_problem, with_times
from workers.computation.compute import solve
from workers.computation.outputs import in_units
from workers.solvers.certified.by_integral import integral_motion
from workers.solvers.certified.certify import Certified, first_try
from workers.solvers.choose import enclose
from workers.solvers.errors import CertifiedUnavailableError, PrecisionNeededError

CLAIMS = {
    "samples": "the asked samples",
    "stored": "the stored function of time, at the same times",
    "attitude": "the quaternion and the angles, at the asked times",
    "trace": "the trace of the multipliers",
    "multipliers": "each multiplier",
    "period": "the period",
    "energy": "the energy",
}
BITS = 128
PASSAGE_BITS = 80
"""Bits of references of motions through poles. They miss 2^-72 at most, a thousandth of what the smallest
claim of a double can be, and both radii count in the comparison."""
UNSEEN = 1e-17
"""Errors of variables below it count as it: a double nearest to the truth has about as much."""
LATEST = 4.0
"""Logarithm of the number of periods up to which times are asked."""


@dataclass(frozen=True)
class Case:
    """A problem with its times and its enclosures."""

    drawn: Drawn
    problem: Problem
    """As it was read, once: the tiers share what a process remembers of its potential."""
    times: list[float]
    reference: Certified

    @property
    def about(self) -> str:
        """What is said of it in a list."""
        return " to ".join(self.drawn.window.ends)

    def document(self, tier: Tier) -> Document:
        """Return the whole document that asks a tier for it."""
        return with_times(self.drawn.document, [repr(t) for t in self.times], tier)


@dataclass(frozen=True)
class Claim:
    """A claimed error, the actual one, and whether it is proven that the claim is too small."""

    name: str
    claimed: float
    actual: float
    is_exceeded: bool


def make_case(family: Family, draws: np.random.Generator) -> Case:
    """Draw a problem, times over one period and late ones, and enclose its motion.

    Raises
    ------
    CertifiedUnavailableError
        There is no reference.
    """
    drawn = draw_problem(family, draws)
    problem = read_problem(with_times(drawn.document, ["0"], "standard"))
    assert isinstance(problem.motion, PlanarMotion)
    early, late = (5, 4) if family == "three-term" else (2, 2)
    turns = [0.0, *draws.uniform(0, 1, early), *10.0 ** draws.uniform(1, LATEST, late)]
    sign = 1.0 if draws.random() < 0.8 else -1.0
    found = _by_one_way(drawn, problem, sign, turns) if family == "passage" else None
    if found is None:
        period = float(enclose(problem.body, problem.potential, problem.motion, [], 64).period)
        times = [sign * float(turn) * period + 0.0 for turn in turns]
        exact = [Fraction(repr(t)) for t in times]
        found = times, enclose(problem.body, problem.potential, problem.motion, exact, BITS)
    return Case(drawn, problem, *found)


def _by_one_way(
    drawn: Drawn, problem: Problem, sign: float, turns: list[float]
) -> tuple[list[float], Certified] | None:
    """Return the times of ``turns`` and the motion there; None where PASSAGE_BITS do not suffice.

    The dear part, time as a function of the phase, is made once for the period and all times.
    """
    assert isinstance(problem.motion, PlanarMotion)
    precision, bits = first_try(PASSAGE_BITS, Fraction(round(10**LATEST)))
    try:
        with ctx.workprec(precision):
            motion = integral_motion(starting_point(drawn.window, problem.motion), bits)
            times = [sign * float(turn) * float(motion.period) + 0.0 for turn in turns]
            at = tuple(ball(Fraction(repr(t))) for t in times)
            states = motion.states(at)
    except (CertifiedUnavailableError, PrecisionNeededError):
        return None
    widest = max(float(value.rad()) for state in states for value in state)
    if not widest < 2.0 ** (8 - PASSAGE_BITS):
        return None
    return times, Certified(motion.period, motion.energy, states, at, PASSAGE_BITS, "integral")


def claims_of(case: Case, tier: Tier) -> list[Claim]:
    """Solve the case and compare.

    Raises
    ------
    DynamicsError
        It is refused.
    """
    problem = replace(read_problem(case.document(tier)), potential=case.problem.potential)
    motion = in_units(problem, lambda units: units.motion(solve(units.pose(problem))))
    dense, period = motion.dense, motion.dense.period
    assert period is not None
    # The difference of two balls of 128 bits and a time's, with room to spare.
    with ctx.workprec(3 * BITS):
        return [
            _of_states("samples", motion.error, motion.samples, case.reference),
            _of_states(
                "stored", dense.error_at(motion.times), dense(motion.times, motion.low_parts), case.reference
            ),
            _of_ball("period", period.error, case.reference.period - arb(period.hi) - arb(period.lo)),
            _of_ball("energy", motion.energy.error, case.reference.energy - arb(motion.energy.value)),
        ]


def _of_states(name: str, claimed: float, samples: FloatArray, reference: Certified) -> Claim:
    apart = [
        value - arb(found)
        for state, row in zip(reference.states, samples.tolist(), strict=True)
        for value, found in zip(state, row, strict=True)
    ]
    worst = _of_ball(name, claimed, max(apart, key=lambda ball: float(abs(ball.mid()))))
    return Claim(name, claimed, max(worst.actual, UNSEEN), worst.is_exceeded)


def _of_ball(name: str, claimed: float, apart: arb) -> Claim:
    # What is proven; of a ball wider than the claim it says nothing about the ratio.
    actual = float(abs(apart).abs_lower())
    return Claim(name, claimed, actual if float(apart.rad()) <= claimed else nan, not actual <= claimed)
