"""Proves points to have no motion whose potentials are sums of powers, each with its body and exponents.

On the loop |g1| = G s^α and |g3| = Z s for A > C, so that p² is a sum of powers of s = |sin v|, times powers
of |g2|. Beside its lowest power of s, which leads next to the poles, it is bounded term by term.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.formula.algebras.intervals import (
    FUNCTION_ROUNDING,
    LARGEST_LOGARITHM,
    OPERATION_ROUNDING,
)
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import (
    CELL_MIN_RELATIVE_WIDTH,
    Cells,
    all_negative,
    equators,
    heights_of,
    sines,
)
from service.dynamics.verdict.proofs.power_sums import Judgement, Term, have_g2, number_of
from workers.solvers.compiled.records import Records
from workers.sweeping.parameters.programs import double_of
from workers.sweeping.planar.exclusions import LOG_LAMBDA_ERROR
from workers.sweeping.varying_body.templates import MomentsOfPoint

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


Bounds = tuple[FloatArray, FloatArray]

MOST_TERMS = 64
SMALLEST_SAFE_NUMBER = 1e-290
"""Numbers below it may have lost digits."""


@dataclass(frozen=True, slots=True)
class _Sums:
    """Sums of powers, one a loop, each array of shape (loops, terms); terms that a loop has not are 0."""

    coefficients: FloatArray
    first: FloatArray
    third: FloatArray
    """Exponents of |g1| and |g3|."""
    sine: FloatArray
    """Exponents of s, less the lowest."""
    height: FloatArray
    """Exponents of |g2|."""
    odd: FloatArray
    """1 if g2 has a sign there, else 0."""


def have_no_motion(
    judged: Sequence[tuple[MomentsOfPoint, Judgement]], loops: Records, motion: PlanarMotion
) -> BoolArray:
    """Tell which points are proved to have p² < 0 all over the half of their loops that ``motion`` names.

    ``loops`` are what :func:`.frame.loops_of` returns of them. False means not proved.
    """
    count = len(judged)
    if not count:
        return np.zeros(0, dtype=np.bool_)
    mirrored, alpha, logarithms = (np.array(loops[name]) for name in ("mirrored", "alpha", "log_lambda"))
    sums = [
        _read(judgement.squared_momentum(), moments, bool(exchanged), motion)
        for (moments, judgement), exchanged in zip(judged, mirrored, strict=True)
    ]
    stacked = _stacked(sums)
    errors = LOG_LAMBDA_ERROR * (1.0 + np.abs(logarithms))
    Z, G = equators(alpha, logarithms - errors, logarithms + errors)
    first, third = _exchanged(G, Z, mirrored), _exchanged(Z, G, mirrored)
    with np.errstate(all="ignore"):
        scales = _times(_power(_column(first), stacked.first), _power(_column(third), stacked.third))

    def signs(cells: Cells) -> IntArray:
        of = cells.owner
        with np.errstate(all="ignore"):
            powers = _power(_column(sines(cells)), stacked.sine[of])
            low, high = heights_of(alpha[of], Z, G, cells)
            size = np.minimum(np.abs(low), np.abs(high)), np.maximum(np.abs(low), np.abs(high))
            powers = _times(powers, _power(_column(size), stacked.height[of]))
            lo, hi = _times(powers, (scales[0][of], scales[1][of]))
            factors = stacked.coefficients[of] * np.where(
                stacked.odd[of] > 0.0, np.sign(cells.hemisphere)[:, None], 1.0
            )
            # Of a term that there is not, nothing is known about the powers.
            is_there = factors != 0.0
            low_terms = np.where(is_there, np.where(factors > 0.0, factors * lo, factors * hi), 0.0)
            high_terms = np.where(is_there, np.where(factors > 0.0, factors * hi, factors * lo), 0.0)
            slack = (
                (16.0 + stacked.first.shape[1])
                * OPERATION_ROUNDING
                * np.maximum(np.abs(low_terms), np.abs(high_terms)).sum(axis=1)
            )
            above, below = high_terms.sum(axis=1) + slack, low_terms.sum(axis=1) - slack
        known: IntArray = (below > 0.0).astype(np.int64) - (above < 0.0)
        return known

    is_known = np.array([each is not None for each in sums]) & ~np.isnan(Z[0]) & ~np.isnan(G[0])
    return all_negative(signs, is_known, np.full(count, CELL_MIN_RELATIVE_WIDTH))


_Row = list[tuple[float, float, float, float, float, float]]


def _read(
    terms: Sequence[Term], moments: MomentsOfPoint, is_mirrored: bool, motion: PlanarMotion
) -> "_Row | None":
    """Return the terms of p² up to a positive factor, None if there are none or too many."""
    if not terms or len(terms) > MOST_TERMS:
        return None
    A, _, C = moments
    sine = [(a + d * C / A) if is_mirrored else (a * A / C + d) for _, a, _, d, *_ in terms]
    lowest = min(sine)
    row: _Row = []
    for (coefficient, a, height, d, odd_first, odd_height, odd_third, constants), power in zip(
        terms, sine, strict=True
    ):
        if have_g2(constants):
            return None
        value = coefficient if A > C else -coefficient
        if (odd_first and motion.sign_of_g1 < 0) != (odd_third and motion.g3_sign < 0):
            value = -value
        factor = float((arb(value) * number_of(constants)).mid()) if constants else double_of(value)
        row.append(
            (
                factor,
                double_of(a),
                double_of(d),
                double_of(power - lowest),
                double_of(height),
                float(odd_height),
            )
        )
    return row


def _stacked(sums: Sequence["_Row | None"]) -> _Sums:
    width = max((len(each) for each in sums if each is not None), default=0)
    table = np.zeros((len(sums), max(width, 1), 6))
    for index, each in enumerate(sums):
        if each:
            table[index, : len(each)] = each
    coefficients, first, third, sine, height, odd = np.moveaxis(table, 2, 0)
    return _Sums(coefficients, first, third, sine, height, odd)


def _power(base: Bounds, exponent: FloatArray) -> Bounds:
    """Return bounds of base^exponent for base ≥ 0, also where the exponent was rounded."""
    low, high = np.power(base[0], exponent), np.power(base[1], exponent)
    low, high = np.where(exponent < 0.0, high, low), np.where(exponent < 0.0, low, high)
    error = np.where(
        exponent == 0.0, 0.0, FUNCTION_ROUNDING + np.abs(exponent) * OPERATION_ROUNDING * LARGEST_LOGARITHM
    )
    lower = np.where(low > SMALLEST_SAFE_NUMBER, low * (1.0 - error), 0.0)
    return lower, np.maximum(high * (1.0 + error), SMALLEST_SAFE_NUMBER)


def _times(left: Bounds, right: Bounds) -> Bounds:
    """Return bounds of a product of numbers ≥ 0, not rounded outwards but for those that doubles lose."""
    low, high = left[0] * right[0], left[1] * right[1]
    return np.where(low > SMALLEST_SAFE_NUMBER, low, 0.0), np.maximum(high, SMALLEST_SAFE_NUMBER)


def _column(bounds: Bounds) -> Bounds:
    return bounds[0][:, None], bounds[1][:, None]


def _exchanged(plain: Bounds, other: Bounds, mirrored: BoolArray) -> Bounds:
    return np.where(mirrored, other[0], plain[0]), np.where(mirrored, other[1], plain[1])
