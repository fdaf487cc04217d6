"""Finds the arcs of a loop that a half of it meets, from the zeros and signs of P on its halves.

An arc goes on through a pole only if p² has the same limit on both sides of it.
"""

from collections.abc import Callable
from dataclasses import dataclass

from flint import arb, ctx

from service.dynamics.errors import DynamicsError
from service.dynamics.potentials.recognition import is_written_even
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.root_finding.radicand import HalfLoop, precise_radicand
from service.dynamics.reduction.root_finding.zeros import LoopPlace, PoleKind, Region, Zero, ZeroKind
from service.dynamics.reduction.window import Arc, ArcEnd

LIMIT_BITS = 10240
"""Bits for comparing two limits that the formula does not show to be equal."""
FAR_LOG2_DISTANCE, NEAR_LOG2_DISTANCE = -352, -704
"""log2 of the distances from the pole at which the values on both sides are compared."""
LIMIT_RELATIVE_DIFFERENCE = 2.0**-24
"""Relative difference of values that are known to 32 bits at least."""
SHRINKING_RATIO = 2.0**-16
"""A difference that shrinks more between the two comes from the distance to the pole, not from the limits."""


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
        They differ by less than LIMIT_BITS can resolve, and are not proved equal.
    """
    if is_even(loop) or _is_analytic(loop):
        return True
    if not loop.potential.has_formula:
        # Nothing is proved of an integral, and many of its digits cost too much.
        here, there = (
            precise_radicand(loop, sign)(LoopPlace(side, arb(2) ** FAR_LOG2_DISTANCE)) for sign in (1, -1)
        )
        return bool(abs(here - there) < abs(here) * LIMIT_RELATIVE_DIFFERENCE)
    with ctx.workprec(LIMIT_BITS):
        finer = loop.refined()
        sides = [precise_radicand(finer, sign) for sign in (1, -1)]
        far, near = (
            _difference([P(LoopPlace(side, arb(2) ** e)) for P in sides])
            for e in (FAR_LOG2_DISTANCE, NEAR_LOG2_DISTANCE)
        )
    if near > far * SHRINKING_RATIO:
        return False
    if near < far * SHRINKING_RATIO:
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


_ENDS: dict[ZeroKind, ArcEnd] = {
    "simple": "rest",
    "multiple": "double",
    "standstill": "standstill",
    "flat": "flat",
    "edge": "edge",
    "infinite": "collision",
}


@dataclass(frozen=True, slots=True)
class _Break:
    """A place on the (unrolled) loop where an arc can end."""

    v: arb
    end: ArcEnd


def arcs_of(loop: Loop, g3_sign: int, scan: Callable[[Loop, int], HalfLoop]) -> list[Arc]:
    """Return the arcs that meet the half of the loop where g3 has ``g3_sign``."""
    half = scan(loop, g3_sign)
    base = arb(0) if g3_sign > 0 else -arb.pi()
    breaks = [_Break(zero.v, _ENDS[zero.kind]) for zero in half.zeros]
    first_open = half.signs[0] > 0 and half.first_pole == "passable"
    last_open = half.signs[-1] > 0 and half.last_pole == "passable"
    signs = list(half.signs)
    other = _mirror_half(loop, half, g3_sign, scan) if first_open or last_open else None
    if other is not None:
        poles: tuple[Region, Region] = ("north", "south") if g3_sign > 0 else ("south", "north")
        first_open = first_open and other.last_pole == "passable" and has_one_limit(loop, poles[0])
        last_open = last_open and other.first_pole == "passable" and has_one_limit(loop, poles[1])
    if first_open and last_open and not breaks and other is not None and not other.zeros:
        return [Arc(loop, base, base + 2 * arb.pi(), None, None, half.slow + other.slow)]
    lower = (
        _beyond(other, base, before=True)
        if first_open and other
        else _Break(base, _pole_end(half.first_pole))
    )
    top = base + arb.pi()
    upper = (
        _beyond(other, top, before=False) if last_open and other else _Break(top, _pole_end(half.last_pole))
    )
    edges = [lower, *breaks, upper]
    slow = half.slow + (other.slow if other else ())
    arcs = [
        Arc(loop, left.v, right.v, left.end, right.end, slow)
        for left, right, sign in zip(edges, edges[1:], signs, strict=False)
        if sign > 0
    ]
    isolated = [
        Arc(loop, at.v, at.v, at.end, at.end)
        for at, left, right in zip(breaks, signs, signs[1:], strict=False)
        if at.end in ("double", "standstill", "flat") and left < 0 and right < 0
    ]
    return sorted(arcs + isolated, key=lambda arc: float(arc.lower))


def _mirror_half(loop: Loop, half: HalfLoop, g3_sign: int, scan: Callable[[Loop, int], HalfLoop]) -> HalfLoop:
    """Return the other half of the loop: the mirror image, to the last bit, if the formula is even there."""
    if half.slow or not is_even(loop):
        return scan(loop, -g3_sign)
    zeros = tuple(Zero(-zero.v, zero.kind) for zero in reversed(half.zeros))
    return HalfLoop(zeros, half.signs[::-1], half.last_pole, half.first_pole)


def _beyond(other: HalfLoop, pole: arb, *, before: bool) -> _Break:
    """Return where an arc that passes a pole ends on the mirror curve.

    The mirror half runs over −π < v < 0 or 0 < v < π; seen from the pole at
    ``pole`` its zeros are moved by whole turns to the right side of it. If it
    has none, the arc comes round to the far pole, which then ends it.
    """
    zeros = other.zeros
    if not zeros:
        kind = other.first_pole if before else other.last_pole
        return _Break(pole - arb.pi() if before else pole + arb.pi(), _pole_end(kind))
    zero = zeros[-1] if before else zeros[0]
    v = zero.v
    with ctx.workprec(max(ctx.prec, v.bits() + 64)):
        turn = 2 * arb.pi()
        while before and v > pole:
            v = v - turn
        while not before and v < pole:
            v = v + turn
    return _Break(v, _ENDS[zero.kind])


def _pole_end(kind: PoleKind) -> ArcEnd:
    # P > 0 up to a pole that cannot be passed: it diverges, or dies out there, or
    # has another limit on the mirror curve.
    if kind == "flat":
        return "flat"
    return "collision" if kind == "collision" else "pole"
