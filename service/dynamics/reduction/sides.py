"""Decides whether p² has the same limit on both sides of a pole, which a motion needs to pass it."""

from flint import arb, ctx

from service.dynamics.errors import DynamicsError
from service.dynamics.formula.parity import is_written_even
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.root_finding.radicand import precise_radicand
from service.dynamics.reduction.root_finding.zeros import LoopPlace, Region

BITS = 10240
"""Bits for comparing two limits that the formula does not show to be equal."""
FAR, NEAR = -352, -704
"""log2 of the distances from the pole at which the values on both sides are compared."""
SEEN = 2.0**-24
"""Relative difference of values that are known to 32 bits at least."""
DIES_OUT = 2.0**-16
"""A difference that shrinks more from FAR to NEAR comes from the distance to the pole, not the limits."""


class PassageUndecidedError(DynamicsError):
    """p² is neither proved to have the same limit on both sides of a pole nor found to have two."""

    code = "passage_undecided"


def has_one_limit(loop: Loop, side: Region) -> bool:
    """Tell whether p² has the same limit on both sides of a pole, if it has a limit on each.

    It is proved where V is even in the third axis, and where p² is an analytic function
    of g3 about the pole: g1 is one for an even A/C, and V without |·| that has derivatives there.
    Else the values on both sides are compared next to the pole; of a V that is given by an integral
    they are taken to agree if their known digits do.

    Raises
    ------
    PassageUndecidedError
        They differ by less than BITS can resolve, and are not proved equal.
    """
    if is_even(loop) or _is_analytic(loop):
        return True
    if not loop.potential.has_formula:
        # Nothing is proved of an integral, and many of its digits cost too much.
        here, there = (precise_radicand(loop, sign)(LoopPlace(side, arb(2) ** FAR)) for sign in (1, -1))
        return bool(abs(here - there) < abs(here) * SEEN)
    with ctx.workprec(BITS):
        finer = loop.refined()
        sides = [precise_radicand(finer, sign) for sign in (1, -1)]
        far, near = (_difference([P(LoopPlace(side, arb(2) ** e)) for P in sides]) for e in (FAR, NEAR))
    if near > far * DIES_OUT:
        return False
    if near < far * DIES_OUT:
        return True
    raise PassageUndecidedError(
        "p² is neither proved to have one limit at the pole "
        f"g2 = {1 if side == 'north' else -1} nor seen to have two, one on each side: whether the motion "
        "goes on beyond it is not known; formulas that are even in "
        f"{'g1' if loop.mirrored else 'g3'} show it",
        pointer="/potential",
    )


def _difference(values: list[arb]) -> arb:
    here, there = values
    return abs(here - there) / abs(here)


def is_even(loop: Loop) -> bool:
    """Tell whether the formula is even in the axis that changes its sign at a pole."""
    return loop.potential.has_formula and is_written_even(loop.potential.tape, 0 if loop.mirrored else 2)


def _is_analytic(loop: Loop) -> bool:
    if not loop.potential.has_formula or not loop.is_smooth_at_poles():
        return False
    return all(step.name not in ("abs", "sign") for step in loop.potential.tape.instructions)
