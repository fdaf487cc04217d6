"""Computes the energy of every point from the formulas of the family's proofs.

A job encloses the energy in a ball of 160 bits and rounds it once. Here it is
enclosed by another formula in as many bits; both round to the same double
unless the ball contains a rounding boundary, and then the point is left to a single job.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from flint import arb, ctx, fmpq

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.potentials.families.general_solution import Quadrant
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.windows import REDUCTION_BITS
from service.dynamics.verdict.verdict import Verdict
from workers.sweeping.parameters.family import SweepFamily

KNOWN_BITS = 110
"""A ball of this relative accuracy has lost no more than 50 bits by cancellation."""
TINY = 2.0**-30
"""Share of the parameters below which an energy is the rest of a cancellation."""


@dataclass(frozen=True, slots=True)
class Energies:
    """h = h_0 + Σ p_k h_k on every curve, as a function of λ²."""

    tapes: tuple[Tape, ...]
    """h_0 and h_0 + h_k, in nu if A = 2C, else in λ."""
    in_nu: bool
    sign: int
    """Sign of nu."""

    def terms(self, lambda_squared: fmpq) -> tuple[arb, ...]:
        """Return h_0 and the h_k, at the current precision."""
        balls, square = BallAlgebra(), arb(lambda_squared)
        variable = square * self.sign if self.in_nu else square.sqrt()
        origin, *units = (tape.evaluate(balls, (variable,)) for tape in self.tapes)
        return (origin, *(unit - origin for unit in units))

    def rounded(
        self, parameters: Sequence[Sequence[fmpq]], lambdas_squared: Sequence[fmpq]
    ) -> list[tuple[float, float]]:
        """Return the energy of each point and the bound of its error as a job has them; NaN if in doubt."""
        known: dict[tuple[int, int], tuple[arb, ...]] = {}
        found: list[tuple[float, float]] = []
        with ctx.workprec(REDUCTION_BITS):
            for row, square in zip(parameters, lambdas_squared, strict=True):
                key = int(square.p), int(square.q)
                terms = known.get(key)
                if terms is None:
                    terms = known[key] = self.terms(square)
                total = terms[0]
                for p, term in zip(row, terms[1:], strict=True):
                    total = total + arb(p) * term
                found.append(rounded(total, float(arb(max(map(abs, row), default=fmpq(0))))))
        return found


def energies_of(body: RigidBody, family: SweepFamily, motion: PlanarMotion) -> Energies | None:
    """Return the energies on the quadrant of ``motion``, None if a member's energy has no formula."""
    in_nu = body.A == 2 * body.C
    quadrant = _quadrant(motion)
    texts = [_formula(member.verdict, quadrant) for member in family.members]
    if any(text is None for text in texts):
        return None
    name = "nu" if in_nu else "lambda"
    tapes = tuple(compile_tape(parse(str(text)), (name,)) for text in texts)
    return Energies(tapes, in_nu, motion.sign_of_g1)


def _quadrant(motion: PlanarMotion) -> Quadrant:
    if motion.sign_of_g1 > 0:
        return "pp" if motion.g3_sign > 0 else "pm"
    return "mp" if motion.g3_sign > 0 else "mm"


def _formula(verdict: Verdict, quadrant: Quadrant) -> str | None:
    if verdict.energy_formula is not None or verdict.energy_formulas is None:
        return verdict.energy_formula
    return verdict.energy_formulas.get(quadrant)


def rounded(energy: arb, scale: float) -> tuple[float, float]:
    """Return an energy and the bound of its error as a job has them; NaN if in doubt.

    ``scale`` is the size of what it is the rest of.
    """
    if energy.is_zero():
        # A job's ball has 0 in it; how wide it is, is told by no formula.
        return 0.0, math.nan
    if not energy.is_finite() or energy.rel_accuracy_bits() < KNOWN_BITS:
        return math.nan, math.nan
    value = _one_double(energy)
    if not abs(value) > TINY * scale:
        return math.nan, math.nan
    # Of an exact double only the rest of the job's own ball is left.
    return value, math.nextafter(_one_double(abs(energy - value)), math.inf)


def _one_double(ball: arb) -> float:
    """Return the double that the whole ball rounds to, NaN if there are two."""
    low, high = float(ball.lower()), float(ball.upper())
    return low if low == high else math.nan
