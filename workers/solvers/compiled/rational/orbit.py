"""Motions in rational potentials of bodies with A = 2C, to the last digit at any time."""

import math

from flint import arb, ctx, fmpq

from service.dynamics.problem import PlanarMotion, StartAtPoint
from service.dynamics.solution.dense_output import Period
from workers.solvers.compiled.frame import Frame
from workers.solvers.compiled.rational.roots import (
    GAP_BITS,
    PRECISIONS,
    Radicand,
    Stretch,
    find_stretch,
    period_of_x,
)
from workers.solvers.compiled.records import ARC, Loop, Records, Start, new_records
from workers.solvers.compiled.windows.arcs import REST, choose_start
from workers.solvers.three_terms import RootsUndecidedError

Orbit = tuple[Records, Period]
"""A loop with an orbit on it and its start, and the period."""


def rational_orbit(radicand: Radicand, motion: PlanarMotion, frame: Frame) -> Orbit | None:
    """Return the orbit with all its constants rounded last, None if it is not periodic or not decided.

    Of ``motion`` only the window and the start count: the curve is that of the radicand.
    """
    for precision in PRECISIONS:
        with ctx.workprec(precision):
            try:
                stretch = find_stretch(radicand, motion.window)
                if stretch is None or not stretch.is_periodic:
                    return None
                return _orbit(stretch, motion, frame.shared.copy())
            except RootsUndecidedError:
                continue
    return None


def _orbit(stretch: Stretch, motion: PlanarMotion, loops: Records) -> Orbit | None:
    loop: Loop = loops[0]
    nu = arb(stretch.radicand.nu.numerator) / stretch.radicand.nu.denominator
    loop.z, loop.g = _double((nu * stretch.x1).sqrt()), _double(stretch.x1)
    rotates = stretch.passes_pole and not stretch.high_is_root
    if rotates:
        start = _start_of_rotation(stretch, motion, loop)
        loop.rotates, loop.direction = True, loop.s_sign * loop.half
        sense, kind = 1.0, 0
    else:
        chosen = _libration(stretch, motion, loop)
        if chosen is None:
            return None
        start, sense, kind = chosen
    if start is None:
        return None
    loop.start, loop.sense = start, sense
    _set_roots(stretch, loop, kind)
    period = period_of_x(stretch)
    if period is None:
        return None
    trips = 1.0 if stretch.low_is_root and stretch.high_is_root else 2.0
    return loops, Period(trips * period.hi, trips * period.lo, trips * period.error)


def _start_of_rotation(stretch: Stretch, motion: PlanarMotion, loop: Loop) -> float | None:
    if loop.kind == REST:
        return None
    u = 0.5
    if isinstance(motion.start, StartAtPoint):
        quarter = _point(stretch, motion.start, mirrored=loop.mirrored)
        if quarter is None:
            return None
        u = float(quarter / arb.pi()) if loop.g2_sign > 0.0 else float(1 - quarter / arb.pi())
    return u if loop.s_sign > 0.0 else 2.0 - u


def _point(stretch: Stretch, start: StartAtPoint, *, mirrored: bool) -> arb | None:
    """Return 0 < v < π/2 where the client's |g1| is that of the start, None beyond the equator."""
    size = abs(arb(start.g1.numerator) / start.g1.denominator)
    # Mirrored, the client's g1 is g3 here: g3² = ν x.
    nu = arb(stretch.radicand.nu.numerator) / stretch.radicand.nu.denominator
    x = size * size / nu if mirrored else size
    return _angle(stretch, x) if x < stretch.x1 else None


def _libration(stretch: Stretch, motion: PlanarMotion, loop: Loop) -> tuple[float, float, int] | None:
    """Describe the libration in ``loop``; return u at the start, the sense in u, and the kind of ends."""
    low, high = _angle(stretch, stretch.lo), _angle(stretch, stretch.hi)
    pi = arb.pi()
    if not stretch.high_is_root:
        places, kind = [(low, pi - low)], 1
    elif stretch.passes_pole:
        places, kind = [(-high, high), (pi - high, pi + high)], 2
    else:
        places, kind = [(low, high), (pi - high, pi - low)], 3
    arcs = new_records(ARC, len(places))
    size = 1.0 if not stretch.high_is_root else math.sin(float(high))
    for place, (a, b) in enumerate(places):
        arcs[place] = float(a), float(b), True, True, size, 0
    quarter, half, sine = None, loop.half, 0.0
    if isinstance(motion.start, StartAtPoint):
        quarter = _point(stretch, motion.start, mirrored=loop.mirrored)
        if quarter is None:
            return None
        sine = math.sin(float(quarter))
    start = Start(loop.kind, loop.s_sign, loop.g2_sign, sine)
    chosen, at, sense = choose_start(arcs, len(places), 0, start)
    if chosen < 0:
        return None
    a, b = places[chosen] if half > 0.0 else (-places[chosen][1], -places[chosen][0])
    loop.rotates, loop.half_width = False, _double((b - a) / 2)
    ((loop.s_lower, loop.c_lower), (loop.s_middle, loop.c_middle), (loop.s_upper, loop.c_upper)) = _end_sines(
        stretch, a, b
    )
    if kind == 3 and abs(loop.s_lower) > abs(loop.s_upper):
        kind = 4
    lo, hi = arcs[chosen].lo, arcs[chosen].hi
    if quarter is None:
        u = 0.5 if lo < at < hi else 0.0 if at == lo else 1.0
    else:
        exact = quarter if loop.g2_sign > 0.0 else pi - quarter
        exact += 2 * pi * round((at - float(exact)) / (2.0 * math.pi))
        below, above = exact - places[chosen][0], places[chosen][1] - exact
        if not (below > 0 and above > 0):
            return None
        # Turned before it is rounded: next to an end u is small, and 1 − u is not.
        near, far = (below, above) if half > 0.0 else (above, below)
        return float(2 * arb.atan2(near.sqrt(), far.sqrt()) / pi), sense * half, kind
    if half < 0.0:
        u = 1.0 - u
    return u, sense * half, kind


def _angle(stretch: Stretch, x: arb) -> arb:
    """Return v in [0, π/2] with x = x1 sin² v."""
    return arb.atan2(x.sqrt(), (stretch.x1 - x).nonnegative_part().sqrt())


def _end_sines(stretch: Stretch, a: arb, b: arb) -> list[tuple[float, float]]:
    """Return sine and cosine at the lower end, in the middle (exact zeros there) and at the upper end."""
    sines: list[tuple[float, float]] = []
    middle = (a + b) / 2
    for v in (a, middle, b):
        sine, cosine = v.sin_cos()
        if v is middle and not (stretch.low_is_root and stretch.high_is_root):
            quarters = round(float(2 * middle / arb.pi())) % 4
            sines.append(((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))[quarters])
        else:
            sines.append((_double(sine), _double(cosine)))
    return sines


def _set_roots(stretch: Stretch, loop: Loop, kind: int) -> None:
    """Fill in what :func:`.factor_by_roots` needs."""
    polynomial = stretch.radicand.polynomial
    leading = polynomial[polynomial.degree()]
    loop.by_roots, loop.ends = True, kind
    loop.leading, loop.mu = _quotient(leading), float(stretch.radicand.power)
    loop.reals, loop.pairs = len(stretch.reals), len(stretch.pairs)
    for k, root in enumerate(stretch.reals):
        is_below = root < stretch.hi
        distance = stretch.lo - root if is_below else root - stretch.hi
        loop.roots[k] = (-1.0 if is_below else 1.0), _double(distance)
    for k, (real, imaginary) in enumerate(stretch.pairs, start=len(stretch.reals)):
        loop.roots[k] = _double(real), _double(imaginary)


def _quotient(value: fmpq) -> float:
    """Return |value|, rounded once; beyond doubles it is infinite, of which kernels decide nothing."""
    try:
        return abs(int(value.p) / int(value.q))
    except OverflowError:
        return math.inf


def _double(value: arb) -> float:
    """Return the nearest double of a ball that is known well enough."""
    if value != 0 and value.rel_accuracy_bits() < GAP_BITS:
        raise RootsUndecidedError("a distance of roots is not known to the bits of a double")
    return float(value)
