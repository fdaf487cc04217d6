r"""Bounds the energy h(λ) of planar motions, at single λ.

On the curve, with primed axes,

.. math:: h = V + \frac{(A g_1^2 + C g_3^2)\,D}{2 (A - C)\, g_1 g_3},

which has the same value at every place of it where V and D are defined.
"""

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from service.dynamics.atlas.curves import HalfCurves, LambdaStretch, grouped
from service.dynamics.formula.algebras.intervals import IntervalAlgebra
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import QUARTER, Cells, axes, heights, scales

FloatArray = NDArray[np.float64]

PLACES = ((1.0, 0.3), (1.0, 0.6), (1.0, 0.9), (1.0, 1.2), (1.0, QUARTER * 0.97), (-1.0, 0.5), (-1.0, 1.1))
"""Signs of g2, and distances from the pole of this sign, where the energy is bounded."""
THIN = 1e-15


def energies(half: HalfCurves, single: Sequence[LambdaStretch]) -> tuple[FloatArray, FloatArray]:
    """Return bounds of h at single λ; NaN where there are none."""
    parts = [_energies(half, group) for group in grouped(single)]
    return np.concatenate([low for low, _ in parts]), np.concatenate([high for _, high in parts])


def _energies(half: HalfCurves, single: Sequence[LambdaStretch]) -> tuple[FloatArray, FloatArray]:
    shape, loops = (len(single), len(PLACES)), half.loops(single)
    side, x = (np.tile(np.array(each), shape[0]) for each in zip(*PLACES, strict=True))
    cells = Cells(np.repeat(np.arange(shape[0]), shape[1]), side, x * (1.0 - THIN), x)
    algebra = IntervalAlgebra(scales(loops, cells))
    first, third = axes(algebra, loops, cells)
    g1, g3 = (third, first) if half.shape.is_mirrored else (first, third)
    g2 = algebra.interval(*heights(loops, cells))
    jets = FirstOrderJets(algebra, 1)
    seeds = [jets.seed(g1, (algebra.negate(g3),)), jets.seed(g2, (None,)), jets.seed(g3, (g1,))]
    A, C = half.body.A, half.body.C
    with np.errstate(all="ignore"):
        V = half.tape.evaluate(jets, seeds)
        total = V.value
        if V.first[0] is not None:
            # Mirrored, A and C, g1 and g3 are exchanged and D changes its sign: the quotient is the same.
            Q = algebra.add(
                algebra.multiply(algebra.constant(A), algebra.power(g1, Fraction(2))),
                algebra.multiply(algebra.constant(C), algebra.power(g3, Fraction(2))),
            )
            product = algebra.multiply(algebra.constant(2 * (A - C)), algebra.multiply(g1, g3))
            total = algebra.add(total, algebra.divide(algebra.multiply(Q, V.first[0]), product))
        lo, hi = (np.broadcast_to(bound, x.shape).reshape(shape) for bound in algebra.bounds(total))
    known = lo <= hi
    low = np.where(known, lo, -np.inf).max(axis=1)
    high = np.where(known, hi, np.inf).min(axis=1)
    is_known = np.isfinite(low) & np.isfinite(high)
    return np.where(is_known, low, np.nan), np.where(is_known, high, np.nan)
