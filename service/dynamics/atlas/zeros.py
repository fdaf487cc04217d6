"""Encloses the zeros of p² along half curves, for many λ: by estimates and bounds, or at latitudes that stay.

At the latitude g2 = y with ρ = 1 − y² the curve of λ is where the curve of λ' = λ ρ^{(1/α − 1)/2} crosses
the equator, shrunk by √ρ (primed axes). So one enclosure of y bounds g1 and g3 there for every λ, also for
zeros of even order, at the equator, or next to a pole, at which no sign of p² changes between two places.

Such potentials are V = c₀(g2) + c₁(g2) g1² on the sphere. For them D = g1 V_3 − g3 V_1 = −2 g1 g3 c₁(g2):
p² has its signs and zeros at the same g2 on every curve, with the same orders. Among the admissible
potentials, V = V1[F] + Q G(g2), these are the ones with a constant F. With any other F, the sum of (V1 +
F)/Q and G, of whose sign p² is, changes along each circle g2 = const: no zero stays there for every λ.

Where F is a constant k, V1[F] + Q G(g2) has the formula V = −k + Q (G + k / (C T₀ (1 − g2²))):
V1[k] = −k T (1/T − 1/T₀) with T = Q / (C ρ), ρ = 1 − g2², and T₀ = α cos² φ₀ + sin² φ₀ in the reference
direction (theory.md, 2.2).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.atlas.curves import (
    HalfCurves,
    LambdaStretch,
    d_on_curves,
    equator_of,
    grouped,
    zero_between,
)
from service.dynamics.atlas.sign_maps import EQUATOR, Finest, Signature, brackets_of, signature_of, signs_in
from service.dynamics.atlas.structures import LambdaPart
from service.dynamics.atlas.turns import settled_sign_maps
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.formula.algebras.monomials import (
    ALL_ATOMS,
    LOG_G1,
    LOG_G3,
    SPHERE,
    NotAMonomialSumError,
    Rules,
    read,
)
from service.dynamics.formula.tape import Tape
from service.dynamics.reduction.geometry.point import RANGES, make_equator, place_of
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import QUARTER_TURN, Cells, equators, heights
from service.dynamics.reduction.sign_proofs.cells import Curves, signs_on_cells
from service.dynamics.reduction.sign_proofs.signs import SignMap
from service.dynamics.reduction.window import Arc, ArcEnd, Window
from service.dynamics.reduction.windows import REDUCTION_BITS

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
ZERO_RELATIVE_WIDTHS = np.array([8.0**-k for k in range(16, 4, -1)])
"""Relative widths to both sides of a estimate that are tried, from 3.6e-15 to 3e-5."""
CELL_RELATIVE_WIDTH = 1e-15


@dataclass(frozen=True, slots=True)
class Zeros:
    """Zeros of p² on one half curve for single λ, from the north pole to the south pole; shape (λ, zeros)."""

    low: FloatArray
    """Bounds of the distance from the pole; where they are not proved, NaN."""
    high: FloatArray
    hemisphere: IntArray
    """The sign of g2, shape (zeros,)."""
    size: tuple[FloatArray, FloatArray]
    """Bounds of |g1|, in the client's axes."""
    height: tuple[FloatArray, FloatArray]
    """Bounds of g2."""

    def beside(self, other: "Zeros") -> "Zeros":
        """Return these zeros and others for the same λ."""

        def joined(one: FloatArray, two: FloatArray) -> FloatArray:
            return np.concatenate([one, two], axis=-1)

        size, height = (
            (joined(one[0], two[0]), joined(one[1], two[1]))
            for one, two in ((self.size, other.size), (self.height, other.height))
        )
        hemisphere = np.concatenate([self.hemisphere, other.hemisphere])
        return Zeros(joined(self.low, other.low), joined(self.high, other.high), hemisphere, size, height)


def zeros_of(half: HalfCurves, number: int, part: LambdaPart, single: Sequence[LambdaStretch]) -> Zeros:
    """Return the zeros for single λ of a part on its half curve ``number``."""
    parts = [_zeros_of(half, number, part, group) for group in grouped(single)]

    def joined(bounds: Sequence[FloatArray]) -> FloatArray:
        return np.concatenate(bounds)

    return Zeros(
        joined([part.low for part in parts]),
        joined([part.high for part in parts]),
        parts[0].hemisphere,
        (joined([part.size[0] for part in parts]), joined([part.size[1] for part in parts])),
        (joined([part.height[0] for part in parts]), joined([part.height[1] for part in parts])),
    )


def _hemispheres(signature: Signature) -> list[int]:
    """Return the sign of g2 at each zero."""
    border = signature.index(EQUATOR)
    north, south = (len(signs_in(part)) - 1 for part in (signature[:border], signature[border:]))
    return [1] * north + [-1] * south


def _zeros_of(half: HalfCurves, number: int, part: LambdaPart, single: Sequence[LambdaStretch]) -> Zeros:
    assert part.signatures is not None
    curves, signature = half.over(single), part.signatures[number]
    hemisphere = np.array(_hemispheres(signature), dtype=np.int64)
    low = np.full((len(single), len(hemisphere)), np.nan)
    high = low.copy()
    for k, sign_map in enumerate(_sign_maps(half, number, part, single)):
        found = brackets_of(sign_map) if signature_of(sign_map) == signature else []
        if [each.hemisphere for each in found] == hemisphere.tolist():
            low[k], high[k] = [each.low for each in found], [each.high for each in found]
    low, high = _enclosed(curves, hemisphere, _estimates(half, single, hemisphere, low, high))
    cells = _cells(hemisphere, low, high)
    full = (len(single), len(hemisphere))
    size, height = _sizes(curves, cells), heights(curves.loops, cells)
    return Zeros(low, high, hemisphere, _shaped(size, full), _shaped(height, full))


def _sign_maps(
    half: HalfCurves, number: int, part: LambdaPart, single: Sequence[LambdaStretch]
) -> list[SignMap]:
    """Return those of the stretches of the part; a λ that was rounded out of all of them is looked at."""
    known = [part.sign_maps_at(each, number) for each in single]
    missing = [each for each, sign_map in zip(single, known, strict=True) if sign_map is None]
    fresh = iter(
        settled_sign_maps(half, missing, [None] * len(missing), [Finest()] * len(missing)) if missing else []
    )
    return [next(fresh) if sign_map is None else sign_map for sign_map in known]


def _shaped(bounds: tuple[FloatArray, FloatArray], full: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
    return bounds[0].reshape(full), bounds[1].reshape(full)


def _estimates(
    half: HalfCurves, single: Sequence[LambdaStretch], hemisphere: IntArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    if not low.size:
        return low
    side = hemisphere[None, :].astype(np.float64)
    Z, G = equator_of(half, single)
    return zero_between(lambda x: d_on_curves(half, Z, G, side, x), low, high)


def _enclosed(curves: Curves, hemisphere: IntArray, estimates: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the narrowest bounds between which D is proved to change its sign."""
    low, high = (np.full(estimates.shape, np.nan) for _ in range(2))
    if not estimates.size:
        return low, high
    below, above = (estimates[:, :, None] * (1.0 + sign * ZERO_RELATIVE_WIDTHS) for sign in (-1.0, 1.0))
    signs = []
    for point in (below, above):
        at = point.reshape(len(estimates), -1)
        cells = _cells(
            np.repeat(hemisphere, len(ZERO_RELATIVE_WIDTHS)),
            at * (1.0 - CELL_RELATIVE_WIDTH),
            at * (1.0 + CELL_RELATIVE_WIDTH),
        )
        signs.append(signs_on_cells(curves, cells, with_slope=False).sign.reshape(below.shape))
    is_proved = signs[0] * signs[1] < 0
    best = np.argmax(is_proved, axis=2)[:, :, None]
    found = np.take_along_axis(is_proved, best, axis=2)[:, :, 0]
    # The cells about the places are part of the enclosure.
    low = np.where(
        found, np.take_along_axis(below, best, axis=2)[:, :, 0] * (1.0 - CELL_RELATIVE_WIDTH), np.nan
    )
    high = np.where(
        found, np.take_along_axis(above, best, axis=2)[:, :, 0] * (1.0 + CELL_RELATIVE_WIDTH), np.nan
    )
    return low, high


def _cells(hemisphere: IntArray, low: FloatArray, high: FloatArray) -> Cells:
    """Return cells of arrays of shape (λ, n)."""
    count, n = low.shape
    owner = np.repeat(np.arange(count), n)
    return Cells(owner, np.tile(hemisphere.astype(np.float64), count), low.ravel(), high.ravel())


def _sizes(curves: Curves, cells: Cells) -> tuple[FloatArray, FloatArray]:
    """Return bounds of the client's |g1| on cells."""
    shape, loops = curves.loops.shape, curves.loops
    low, high = (
        np.sin(cells.low) * (1.0 - 4.0 * CELL_RELATIVE_WIDTH),
        np.sin(cells.high) * (1.0 + 4.0 * CELL_RELATIVE_WIDTH),
    )
    if shape.is_mirrored:
        return loops.Z[0][cells.owner] * low, loops.Z[1][cells.owner] * high
    alpha = float(shape.alpha)
    with np.errstate(all="ignore"):
        # sin x to the power alpha: its logarithm is at most 60, and is known to 16 digits.
        spread = 1.0 + 64.0 * alpha * CELL_RELATIVE_WIDTH
        return (
            loops.G[0][cells.owner] * low**alpha / spread,
            loops.G[1][cells.owner] * high**alpha * spread,
        )


_OF_LATITUDE = Rules(
    plain=2,
    relation=SPHERE[2],
    atoms=ALL_ATOMS,
    most_atoms=24,
    most_terms=200,
    most_products=200**2,
    most_power=16,
)
"""Sums of monomials on the sphere with g3 once at most, and functions of g2."""


def turns_by_latitude(tape: Tape, g1_sign: int, g3_sign: int) -> bool:
    """Tell whether V = c₀(g2) + c₁(g2) g1² is proved where g1 and g3 have these signs; False is no claim."""
    try:
        found = read(tape, replace(_OF_LATITUDE, signs=(g1_sign, 0, g3_sign)))
    except NotAMonomialSumError:
        return False
    return all(
        third == 0 and first in (0, 2 * found.unit) and not {LOG_G1, LOG_G3} & dict(atoms).keys()
        for first, _, third, _, atoms in found.terms
    )


_Latitude = tuple[int, arb, arb]
"""The sign of g2 by which it is looked up, g2, and 1 − g2²."""
NEWTON_STEPS = 60
"""Newton's, for the place on the curve, which no bound rests on."""
NEAR_EQUATOR_COSINE = 0.7
AT_EQUATOR_COSINE = 1e-9
"""|cos v| below which a place is looked up in both hemispheres."""
POINT_RELATIVE_ROUNDING = 2.0**-48
MULTIPLE_ZERO_RADIUS = 2.0**-60
"""Room about zeros that are not simple."""


def stays_at_latitudes(halves: Sequence[HalfCurves]) -> bool:
    """Tell whether it is proved that p² has its signs at the same g2 for every λ."""
    return all(
        turns_by_latitude(half.potential.tape, half.motion.sign_of_g1, half.motion.g3_sign) for half in halves
    )


def zeros_at_latitudes(
    halves: Sequence[HalfCurves],
    single: Sequence[LambdaStretch],
    windows: Sequence[Window],
    *,
    only: ArcEnd | None = None,
) -> list[Zeros]:
    """Return for each half curve, at single λ, the zeros at the latitudes where the windows of one λ end.

    ``only`` those ends that are of this kind: where p² is infinite it is at one g2 for every λ.
    """
    latitudes: list[list[_Latitude]] = [[] for _ in halves]
    with ctx.workprec(REDUCTION_BITS):
        for window in windows:
            for arc in window.arcs:
                for number, latitude, end in _ends(halves, arc):
                    if only in (None, end):
                        latitudes[number].append(latitude)
        return [_zeros(half, single, found) for half, found in zip(halves, latitudes, strict=True)]


def _ends(halves: Sequence[HalfCurves], arc: Arc) -> Iterator[tuple[int, _Latitude, ArcEnd | None]]:
    """Yield the half curves of the ends of an arc with their latitudes; an equator is in both hemispheres."""
    loop = arc.loop
    common = make_equator(loop.Z, loop.G, ball(loop.alpha))
    for v, end in ((arc.lower, arc.lower_end), (arc.upper, arc.upper_end)):
        sine, cosine = v.sin_cos()
        if sine.contains(0):
            continue
        is_other = (sine > 0) != (halves[0].shape.third_sign > 0)
        first, height, third, _ = place_of(RANGES, sine, cosine, common)
        rho = first * first + third * third
        # Bounds enclose a simple zero, or one of 1/p²; where others are is known to the bits in use, which
        # is no bound.
        room = arb(0) if end in ("rest", "collision") else arb(0, MULTIPLE_ZERO_RADIUS)
        for side in [1] if cosine > AT_EQUATOR_COSINE else [-1] if cosine < -AT_EQUATOR_COSINE else [1, -1]:
            yield 1 if is_other and len(halves) > 1 else 0, (side, height + room, rho + room), end


def _zeros(half: HalfCurves, single: Sequence[LambdaStretch], latitudes: Sequence[_Latitude]) -> Zeros:
    full = len(single), len(latitudes)
    hemisphere = np.array([side for side, _, _ in latitudes], dtype=np.int64)
    y = [_bounds(y) for _, y, _ in latitudes]
    height = tuple(np.broadcast_to(np.array([each[k] for each in y]), full) for k in (0, 1))
    root = [_bounds(rho.sqrt()) for _, _, rho in latitudes]
    roots = np.array([each[0] for each in root]), np.array([each[1] for each in root])
    Z, G = _on_latitudes(half, single, [rho for _, _, rho in latitudes])
    third, first = ((size[0] * roots[0], size[1] * roots[1]) for size in (Z, G))
    sizes = third if half.shape.is_mirrored else first
    x = _distances(half, single, np.abs(np.array([float(y) for _, y, _ in latitudes])), third)
    return Zeros(
        x,
        x,
        hemisphere,
        (sizes[0] * (1.0 - POINT_RELATIVE_ROUNDING), sizes[1] * (1.0 + POINT_RELATIVE_ROUNDING)),
        (height[0], height[1]),
    )


def _bounds(value: arb) -> tuple[float, float]:
    low, high = float(value.lower()), float(value.upper())
    return float(np.nextafter(low, -np.inf)), float(np.nextafter(high, np.inf))


def _on_latitudes(
    half: HalfCurves, single: Sequence[LambdaStretch], rho: Sequence[arb]
) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    """Return bounds of |g3| and |g1| over √ρ (primed), shape (λ, latitudes)."""
    logarithms = np.array([-np.log(each.low) if each.is_inverse else np.log(each.low) for each in single])
    shares = [_bounds(each.log() * (1 / ball(half.shape.alpha) - 1) / 2) for each in rho]
    low, high = (logarithms[:, None] + np.array([each[k] for each in shares]) for k in (0, 1))
    # log k and the sum are off by roundings.
    error = POINT_RELATIVE_ROUNDING * (1.0 + np.abs(logarithms)[:, None] + np.abs(low))
    return equators(half.shape.alpha, low - error, high + error)


def _distances(
    half: HalfCurves,
    single: Sequence[LambdaStretch],
    height: FloatArray,
    third: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Return the distances from the pole, in doubles: where |g3| = Z sin x and |g2| = ``height``."""
    Z, G = equator_of(half, single)
    alpha = float(half.shape.alpha)
    sine = np.minimum(0.5 * (third[0] + third[1]) / Z, 1.0)
    # With q = cos² x, q Z² + (1 − (1 − q)^α) G² is g2²: concave, so that steps from 0 do not pass the root.
    q = np.zeros(sine.shape)
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            rest = q * Z * Z - np.expm1(alpha * np.log1p(-q)) * G * G - height * height
            q = np.clip(
                q - rest / (Z * Z + alpha * G * G * (1.0 - q) ** (alpha - 1.0)), 0.0, NEAR_EQUATOR_COSINE
            )
        found: FloatArray = np.where(
            sine < NEAR_EQUATOR_COSINE, np.arcsin(sine), np.arctan2(np.sqrt(1.0 - q), np.sqrt(q))
        )
    return np.minimum(found, QUARTER_TURN)
