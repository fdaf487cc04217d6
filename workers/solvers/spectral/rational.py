"""Motions in rational potentials of bodies with A = 2C, to the last digit at any time."""

import math

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.dense_output import Period
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion, StartAtPoint
from workers.solvers.spectral import curve
from workers.solvers.spectral.roots import (
    GAP_BITS,
    PRECISIONS,
    Stretch,
    UndecidedError,
    find_stretch,
    period_of_x,
    rational_radicand,
)
from workers.solvers.spectral.windows import choose_start

FloatArray = NDArray[np.float64]

Orbit = tuple[FloatArray, float, float, Period]
"""The slots of a loop and an orbit on it, u at the start, the sense in u, and the period."""


def rational_orbit(
    body: RigidBody,
    potential: Potential,
    motion: PlanarMotion,
    frame: FloatArray,
    half: float,
    wishes: FloatArray,
) -> Orbit | None:
    """Return the orbit with all its constants rounded last, None if it is not of this kind or not decided."""
    radicand = rational_radicand(body, potential, motion)
    if radicand is None:
        return None
    for precision in PRECISIONS:
        with ctx.workprec(precision):
            try:
                stretch = find_stretch(radicand, motion.window)
                if stretch is None or not stretch.is_periodic:
                    return None
                return _orbit(stretch, motion, frame.copy(), half, wishes)
            except UndecidedError:
                continue
    return None


def _orbit(
    stretch: Stretch, motion: PlanarMotion, loop: FloatArray, half: float, wishes: FloatArray
) -> Orbit | None:
    nu = arb(stretch.radicand.nu.numerator) / stretch.radicand.nu.denominator
    loop[curve.Z], loop[curve.G] = _double((nu * stretch.x1).sqrt()), _double(stretch.x1)
    rotates = stretch.passes_pole and not stretch.high_is_root
    if rotates:
        start = _start_of_rotation(stretch, motion, loop, wishes)
        loop[curve.ROTATES], loop[curve.DIRECTION] = 1.0, wishes[1] * half
        sense, kind = 1.0, 0.0
    else:
        chosen = _libration(stretch, motion, loop, half, wishes)
        if chosen is None:
            return None
        start, sense, kind = chosen
    if start is None:
        return None
    _set_roots(stretch, loop, kind)
    period = period_of_x(stretch)
    if period is None:
        return None
    trips = 1.0 if stretch.low_is_root and stretch.high_is_root else 2.0
    return loop, start, sense, Period(trips * period.hi, trips * period.lo, trips * period.error)


def _start_of_rotation(
    stretch: Stretch, motion: PlanarMotion, loop: FloatArray, wishes: FloatArray
) -> float | None:
    if wishes[0] == 2.0:
        return None
    u = 0.5
    if isinstance(motion.start, StartAtPoint):
        quarter = _point(stretch, motion.start, mirrored=bool(loop[curve.MIRRORED]))
        if quarter is None:
            return None
        u = float(quarter / arb.pi()) if wishes[2] > 0.0 else float(1 - quarter / arb.pi())
    return u if wishes[1] > 0.0 else 2.0 - u


def _point(stretch: Stretch, start: StartAtPoint, *, mirrored: bool) -> arb | None:
    """Return 0 < v < π/2 where the client's |g1| is that of the start, None beyond the equator."""
    size = abs(arb(start.g1.numerator) / start.g1.denominator)
    # Mirrored, the client's g1 is g3 here: g3² = ν x.
    nu = arb(stretch.radicand.nu.numerator) / stretch.radicand.nu.denominator
    x = size * size / nu if mirrored else size
    return _angle(stretch, x) if x < stretch.x1 else None


def _libration(
    stretch: Stretch, motion: PlanarMotion, loop: FloatArray, half: float, wishes: FloatArray
) -> tuple[float, float, float] | None:
    """Describe the libration in ``loop``; return u at the start, the sense in u, and the kind of ends."""
    low, high = _angle(stretch, stretch.lo), _angle(stretch, stretch.hi)
    pi = arb.pi()
    if not stretch.high_is_root:
        places, kind = [(low, pi - low)], 1.0
    elif stretch.passes_pole:
        places, kind = [(-high, high), (pi - high, pi + high)], 2.0
    else:
        places, kind = [(low, high), (pi - high, pi - low)], 3.0
    arcs = np.zeros((64, 6))
    for row, (a, b) in zip(arcs, places, strict=False):
        row[:5] = float(a), float(b), 1.0, 1.0, math.sin(float(high))
    arcs[: len(places), 4] = 1.0 if not stretch.high_is_root else math.sin(float(high))
    quarter = None
    if isinstance(motion.start, StartAtPoint):
        quarter = _point(stretch, motion.start, mirrored=bool(loop[curve.MIRRORED]))
        if quarter is None:
            return None
        wishes = np.array([*wishes[:3], math.sin(float(quarter))])
    chosen, at, sense = choose_start(arcs, len(places), 0, wishes)
    if chosen < 0:
        return None
    a, b = places[chosen] if half > 0.0 else (-places[chosen][1], -places[chosen][0])
    loop[curve.ROTATES], loop[curve.HALF] = 0.0, _double((b - a) / 2)
    ends = _end_sines(stretch, a, b)
    loop[curve.S_LOWER : curve.S_LOWER + 6] = ends
    if kind == 3.0 and abs(loop[curve.S_LOWER]) > abs(loop[curve.S_UPPER]):
        kind = 4.0
    lo, hi = arcs[chosen, 0], arcs[chosen, 1]
    if quarter is None:
        u = 0.5 if lo < at < hi else 0.0 if at == lo else 1.0
    else:
        exact = quarter if wishes[2] > 0.0 else pi - quarter
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


def _end_sines(stretch: Stretch, a: arb, b: arb) -> list[float]:
    """Return sine and cosine at the lower end, in the middle (exact zeros there) and at the upper end."""
    sines: list[float] = []
    middle = (a + b) / 2
    for v in (a, middle, b):
        sine, cosine = v.sin_cos()
        if v is middle and not (stretch.low_is_root and stretch.high_is_root):
            quarters = round(float(2 * middle / arb.pi())) % 4
            sines += [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][quarters]
        else:
            sines += [_double(sine), _double(cosine)]
    return sines


def _set_roots(stretch: Stretch, loop: FloatArray, kind: float) -> None:
    """Fill the slots of :func:`workers.solvers.spectral.curve.factor_by_roots`."""
    polynomial = stretch.radicand.polynomial
    leading = polynomial[polynomial.degree()]
    o = curve.ROOTS_MODE
    loop[o : o + 4] = 1.0, abs(int(leading.p) / int(leading.q)), float(stretch.radicand.power), kind
    loop[o + 4], loop[o + 5] = len(stretch.reals), len(stretch.pairs)
    k = o + 6
    for root in stretch.reals:
        if root < stretch.hi:
            loop[k : k + 2] = -1.0, _double(stretch.lo - root)
        else:
            loop[k : k + 2] = 1.0, _double(root - stretch.hi)
        k += 2
    for real, imaginary in stretch.pairs:
        loop[k : k + 2] = _double(real), _double(imaginary)
        k += 2


def _double(value: arb) -> float:
    """Return the nearest double of a ball that is known well enough."""
    if value != 0 and value.rel_accuracy_bits() < GAP_BITS:
        raise UndecidedError
    return float(value)
