"""Encloses the zeros of p² along one half curve for many single λ: doubles estimate, bounds prove."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.dynamics.atlas.curves import (
    HalfCurves,
    LambdaStretch,
    d_on_curves,
    equator_of,
    grouped,
    zero_between,
)
from service.dynamics.atlas.sign_maps import (
    EQUATOR,
    Finest,
    Signature,
    brackets_of,
    signature_of,
    signs_in,
)
from service.dynamics.atlas.structures import LambdaPart
from service.dynamics.atlas.turns import settled_sign_maps
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import Cells, heights
from service.dynamics.reduction.sign_proofs.cells import Curves, signs_on_cells
from service.dynamics.reduction.sign_proofs.signs import SignMap

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
        cells = _cells(
            np.repeat(hemisphere, len(ZERO_RELATIVE_WIDTHS)), *_about(point.reshape(len(estimates), -1))
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


def _about(point: FloatArray) -> tuple[FloatArray, FloatArray]:
    return point * (1.0 - CELL_RELATIVE_WIDTH), point * (1.0 + CELL_RELATIVE_WIDTH)


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
