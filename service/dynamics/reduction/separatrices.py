"""Proves a suspected double zero of p², or proves that p² stays away from zero there."""

from collections.abc import Iterable
from dataclasses import replace

from flint import arb, ctx

from service.dynamics.formula.algebras.ball import ball
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.grid_minima import (
    SAME_MINIMUM_DISTANCE,
    GridMinima,
    are_apart,
    grid_minima_of,
    is_at_one_of,
)
from service.dynamics.reduction.root_finding.gap import (
    KNOWN_BITS,
    NearRest,
    SeparatrixUndecidedError,
    box_about,
    ladder,
    near_rest,
    slopes,
)
from service.dynamics.reduction.root_finding.radicand import HalfLoop
from service.dynamics.reduction.root_finding.rest_proof import proved_rest
from service.dynamics.reduction.root_finding.zeros import BRACKET_BITS, Zero
from service.dynamics.reduction.sign_proofs.cells import half_of
from service.dynamics.reduction.sign_proofs.high_zeros import order_at_part
from service.dynamics.reduction.window import height

SAME_POINT_DISTANCE = 2.0**-64
"""Distance in v of two places that are one, known with different bits."""
SIGNS_RELATIVE_DISTANCE = 2.0 ** (8 - BRACKET_BITS)
"""Distance from a zero at which signs locate it, relative to its distance from the pole."""
NEAR_REST_RELATIVE_REACH = 2.0**-12
"""Reach of a near rest, against the distance from the pole, up to which it is one."""


def with_near_rests(
    loop: Loop, half: HalfLoop, g3_sign: int, turns: Iterable[arb], minima: GridMinima | None = None
) -> HalfLoop:
    """Return the half with the places where P nearly touches 0 and is proved not to.

    They are looked for next to the zeros, the equator and the ``turns`` of P, 0 < v < π, and where
    ``minima``, which says what a grid shows of P, does not exclude them.
    """
    minima = grid_minima_of([loop], g3_sign)[0] if minima is None else minima
    zeros = [zero for zero in half.zeros if zero.kind != "infinite"]
    # Next to another place P is no simple zero's, however straight it looks.
    turned = [v * g3_sign for v in turns]
    apart = are_apart([*(zero.v for zero in zeros), *turned])
    plain = [
        abs(float(zero.v))
        for zero in zeros
        if apart and zero.kind == "simple" and minima.passes_plainly(loop, zero.v)
    ]
    places = [zero.v for zero in zeros if abs(float(zero.v)) not in plain]
    if not minima.is_far_at_equator:
        places.append(arb.pi() / 2 * g3_sign)
    places.extend(turned)
    places.extend(arb(x) * g3_sign for x in minima.lowest() if not is_at_one_of(x, plain))
    found: list[NearRest] = []
    for v in places:
        near = _known(loop, v)
        # From afar Newton's method leads anywhere: then the place is another's.
        if (
            near is None
            or not _is_close(near)
            or not abs(near.v - v) < 2 * near.reach + SAME_MINIMUM_DISTANCE
        ):
            continue
        # Two places that agree within their errors are the same unless they are proved different.
        same = [other for other in found if not abs(near.v - other.v) > near.reach]
        if all(near.v.rad() < other.v.rad() for other in same):
            found = [*(other for other in found if other not in same), near]
    return replace(half, slow=tuple(found))


def _known(loop: Loop, v: arb) -> NearRest | None:
    """Return the near rest next to ``v``; compute a close one with more bits, if they resolve its square."""
    near = near_rest(loop, v)
    if near is None or not _is_close(near) or near.square.rel_accuracy_bits() >= KNOWN_BITS:
        return near
    with ctx.workprec(4 * ctx.prec):
        finer = near_rest(loop, v)
    return finer if finer is not None and finer.square.rel_accuracy_bits() >= KNOWN_BITS else None


def _is_told(near: NearRest) -> bool:
    """Tell whether the gap is known, and where it is a window or a wall, its ends apart from its middle."""
    if near.square.rel_accuracy_bits() < KNOWN_BITS:
        return False
    return bool(near.square > 0 or arb(near.v.rad()) < near.reach * arb(2) ** -KNOWN_BITS)


def _is_close(near: NearRest) -> bool:
    return bool(near.square.abs_upper() < (NEAR_REST_RELATIVE_REACH * near.v.sin()) ** 2)


def resolved(loop: Loop, half: HalfLoop) -> HalfLoop:
    """Return the half with every zero of order two or more proved, or resolved into what is there.

    Raises
    ------
    SeparatrixUndecidedError
        One of them is neither proved, nor distinguished from two zeros or none.
    """
    zeros, signs, slow = list[Zero](), [half.signs[0]], list(half.slow)
    for zero, before, after in zip(half.zeros, half.signs, half.signs[1:], strict=False):
        if zero.kind != "multiple":
            zeros.append(zero)
            signs.append(after)
            continue
        found = _resolved(loop, zero, before, after)
        if isinstance(found, Zero):
            zeros.append(found)
            signs.append(after)
            continue
        slow = [*(near for near in slow if not abs(near.v - found.v) < SAME_POINT_DISTANCE), found]
        if found.square < 0:
            # The two sides of a narrow gap agree in more digits than the current precision.
            with ctx.workprec(max(ctx.prec, found.v.bits()) + 64):
                zeros.extend(Zero(found.v + side * found.reach, "simple") for side in (-1, 1))
            signs.extend((-before, after))
    return replace(half, zeros=tuple(zeros), signs=tuple(signs), slow=tuple(slow))


def _resolved(loop: Loop, zero: Zero, before: int, after: int) -> Zero | NearRest:
    near = near_rest(loop, zero.v)
    rest = _proved_rest(loop, zero.v if near is None else near.v)
    if rest is not None:
        return Zero(rest, "multiple")
    if near is None:
        raise _undecided(loop, zero.v, None)
    if before != after:
        simple = _end_of_gap(loop, zero, before)
        if simple is None:
            raise _undecided(loop, zero.v, None)
        return simple
    for bits in ladder(loop, 2 * ctx.prec):
        with ctx.workprec(bits):
            near = near_rest(loop, zero.v) or near
            if _is_told(near):
                return near
    raise _undecided(loop, zero.v, near)


def _proved_rest(loop: Loop, v: arb) -> arb | None:
    """Return the place next to ``v``, −π < v < π, where P is proved to have a zero of order two or more."""
    rest = proved_rest(loop, v)
    if rest is not None or not loop.potential.has_formula:
        return rest
    sign = 1 if v > 0 else -1
    found = order_at_part(half_of(loop, loop.potential.tape, sign), v * sign)
    return found[0] * sign if found is not None and found[1] > 1 else None


def _end_of_gap(loop: Loop, zero: Zero, before: int) -> Zero | None:
    """Return the simple zero where P changes its sign: one of the two ends of a gap about a near rest.

    The zero is known to fewer digits than the gap is narrow. f'' lies in a ball about its value at the
    critical place m, on a box that holds both ends: f = f(m) + ½ f'' (τ − τ_m)² says where they are.
    """
    sine = abs(zero.v.sin())
    for bits in ladder(loop, ctx.prec):
        with ctx.workprec(bits):
            near = near_rest(loop, zero.v)
            if near is None:
                return None
            if not _is_told(near):
                continue
            if not (near.square < 0 and near.reach < SAME_POINT_DISTANCE * sine):
                return None
            refined = loop.refined()
            rate = ball(loop.C) * near.at.c * abs(near.v.sin())
            box = box_about(refined, near.at, 2 * near.reach / rate)
            bend = slopes(refined, box)[1] / slopes(refined, near.at)[1]
            if not (bend > 0.5 and bend < 2):
                return None
            # v is as good as proportional to τ.
            away = near.reach / bend.sqrt() * arb(1, (16 * near.reach / sine).abs_upper())
        # The two agree in more digits than the current precision.
        with ctx.workprec(max(bits, near.v.bits()) + 64):
            side = -1 if (before < 0) == (near.K < 0) else 1
            end = near.v + side * away
            # Else it is another zero, farther away.
            return Zero(end, "simple") if abs(end - zero.v) < SIGNS_RELATIVE_DISTANCE * sine else None
    return None


def _undecided(loop: Loop, v: arb, near: NearRest | None) -> SeparatrixUndecidedError:
    place = f"at g2 = {height(loop, v if near is None else near.v):.15g}"
    text = f"{place} p² is neither proved to have a zero of order two or more nor proved not to vanish: "
    shortest = 0.0 if near is None else _shortest_period(loop, near)
    if shortest > 0.0:
        text += f"the motion is a separatrix, or its period is longer than {shortest:.3g}"
    else:
        text += "the motion may take any time there"
    text += "; coefficients that are algebraic numbers make a proof possible"
    return SeparatrixUndecidedError(text, pointer="/potential")


def _shortest_period(loop: Loop, near: NearRest) -> float:
    """Return a time that it takes at least to pass the place, or to turn back before it.

    From the distance √ρ to ρ, the largest reach there can be, dt = Z dv/(c √P), P ≤ 1.1 K (v² + ρ²).
    """
    farthest = near.square.abs_upper().sqrt()
    rate = loop.Z / (near.at.c * near.K.abs_upper().sqrt())
    return 0.9 * float((rate * -farthest.log() / 2).lower())
