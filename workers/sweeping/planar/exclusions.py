"""Points of a sweep that no block solves: proven to have no motion, or perhaps with a zero next to a pole.

Points without a motion end with ``no_motion``, like single jobs. Near the poles D of many programs is looked
at where a solver in doubles does not look any more.

Potentials of one program and one body are bounded by the program. Of sums of powers, each with its body and
exponents, p² is bounded by its terms: on the loop |g1| = G s^α and |g3| = Z s for A > C, so that p² is a sum
of powers of s = |sin v|, times powers of |g2|, and its lowest power of s leads next to the poles.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from flint import arb, fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.intervals import (
    FUNCTION_ROUNDING,
    LARGEST_LOGARITHM,
    OPERATION_ROUNDING,
)
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import (
    CELL_MIN_RELATIVE_WIDTH,
    Cells,
    Loops,
    all_negative,
    equators,
    have_no_motion,
    heights_of,
    shape_of,
    sines,
)
from service.dynamics.verdict.proofs.power_sums import Judgement, Term, have_g2, number_of
from workers.solvers.compiled.evaluation.program import (
    ABS,
    ADD,
    CONSTANT,
    COS,
    DIVIDE,
    EXP,
    LOG,
    MULTIPLY,
    NEGATE,
    POWER,
    SIGN,
    SIN,
    SUBTRACT,
    TAN,
    Program,
)
from workers.solvers.compiled.frame import make_frame
from workers.solvers.compiled.records import Records
from workers.sweeping.parameters.templates import Group, MomentsOfPoint, double_of
from workers.sweeping.planar.doubles import logarithms_of

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
FloatArray = NDArray[np.floating]
Bounds = tuple[FloatArray, FloatArray]


KNOWN_POLE_DEPTHS = 4
"""Depths at which D must be known."""


def keep_their_sign(program: Program, rows: FloatArray, approaches: FloatArray) -> BoolArray:
    """Say for each row of constants (points, k) whether p² has one sign all the way to each pole.

    ``approaches`` (points, 2, depths, 3) are the way, begun where a solver
    in doubles stops looking. On it g1 and g3 keep their signs, hence p² has
    that of D up to a factor.
    """
    g1, g2, g3 = (approaches[..., k] for k in range(3))
    D = slopes_along(program, rows, g1, g2, g3)
    # What is beyond the numbers tells nothing.
    signs = np.sign(np.where(np.isfinite(D) & (g1 != 0.0) & (g3 != 0.0), D, np.nan))
    begun = signs[..., :1]
    same: BoolArray = ((signs == begun) | np.isnan(signs)).all(axis=(1, 2))
    return same & np.abs(begun).all(axis=(1, 2)) & ~np.isnan(signs[..., :KNOWN_POLE_DEPTHS]).any(axis=(1, 2))


@np.errstate(all="ignore")
def slopes_along(
    program: Program, rows: FloatArray, g1: FloatArray, g2: FloatArray, g3: FloatArray
) -> FloatArray:
    """Return D = g1 V_3 − g3 V_1: points by the rows of their constants, and any points of each.

    Far down the terms of D are beyond the range of doubles, but not of what processors have besides. Where
    nothing has a larger range the caller finds that it knows less.
    """
    g1, g2, g3, rows = (np.asarray(each, dtype=np.longdouble) for each in (g1, g2, g3, rows))
    values = [g1, g2, g3]
    for operation, left, right, slot in program.turn.code.tolist():
        x = values[left]
        if operation in (CONSTANT, POWER):
            number = right + (rows[:, slot, None, None] if slot >= 0 else np.zeros_like(g1))
            values.append(number + np.zeros_like(g1) if operation == CONSTANT else np.power(x, number))
        elif operation in _ARITHMETIC:
            values.append(_ARITHMETIC[operation](x, values[right]))
        else:
            values.append(_FUNCTIONS[operation](x))
    D: FloatArray = values[program.turn.results[0]]
    return D


_ARITHMETIC = {ADD: np.add, SUBTRACT: np.subtract, MULTIPLY: np.multiply, DIVIDE: np.divide}
_FUNCTIONS = {
    NEGATE: np.negative,
    EXP: np.exp,
    LOG: np.log,
    SIN: np.sin,
    COS: np.cos,
    TAN: np.tan,
    ABS: np.abs,
    SIGN: np.sign,
}


LOG_LAMBDA_ERROR = 2.0**-50
"""More than the error of log λ relative to 1 + |log λ|: λ², its logarithm, α and the quotient are rounded."""


def have_no_motion_at(
    body: RigidBody, motion: PlanarMotion, group: Group, chosen: IntArray, lambdas_squared: Sequence[fmpq]
) -> BoolArray:
    """Tell which ``chosen`` points of a group, on the curves of these λ², are proved to have no motion.

    ``motion`` gives everything but λ. False means not proved.
    """
    frame = make_frame(body, motion)
    if frame is None or not len(chosen):
        return np.zeros(len(chosen), dtype=np.bool_)
    shape = shape_of(body, motion)
    logarithms = frame.primed(np.array(logarithms_of(lambdas_squared)))
    errors = LOG_LAMBDA_ERROR * (1.0 + np.abs(logarithms))
    Z, G = equators(shape.alpha, logarithms - errors, logarithms + errors)
    inputs = tuple(column[chosen] for column in group.inputs())
    return have_no_motion(group.tape_of_all(), Loops(shape, Z, G, inputs))


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


def sums_have_no_motion(
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
