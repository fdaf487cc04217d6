"""Whether moments satisfy the condition of a case; those that were left out; the nearest body that does."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import arb, ctx, fmpq, fmpq_poly
from numpy.typing import NDArray

from service.dynamics.classical.protocol import CASE_BITS, ClassicalCase, real_roots
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.numerics import is_within
from service.dynamics.solution.dense_output import exact_middle

CONDITION_RELATIVE_ROUNDING = 1e-15
"""Relative: moments that satisfy a condition so closely mean the ones that satisfy it."""
_IMAGINARY_STEP = 1e-30
_NEWTON_STEPS = 60

Moments = tuple[Fraction, Fraction, Fraction]
Partly = Sequence[Fraction | None]
"""Moments in the order of the case, None for those left out."""


@dataclass(frozen=True, slots=True)
class Misfit:
    """The distance of three moments from a case."""

    relative: float
    """The condition over the sum of |moment · derivative|: to first order, their relative change."""
    nearest: tuple[float, float, float]
    """The moments nearest to them that satisfy the condition."""


def completed(
    case: ClassicalCase, moments: Partly, centre: Sequence[Fraction], solution: int | None
) -> Iterator[Moments]:
    """Yield the bodies of a case that have these moments, all in the order of the case."""
    with ctx.workprec(CASE_BITS):
        if case.ratios is not None:
            yield from _of_ratios(case, moments, solution)
        elif case.condition is None:
            yield from _as_given(moments)
        else:
            yield from _of_condition(case, moments, centre)


def left_out_in_vain(case: ClassicalCase, moments: Partly, centre: Sequence[Fraction]) -> bool:
    """Tell whether a moment was left out that does not follow from the others."""
    missing = [index for index, moment in enumerate(moments) if moment is None]
    if case.ratios is not None:
        return len(missing) == 3
    if case.condition is None or len(missing) > 1:
        return bool(missing)
    return bool(missing) and _polynomial(case, moments, centre, missing[0]).degree() < 1


def leaves_free(case: ClassicalCase, moments: Partly, centre: Sequence[Fraction]) -> bool:
    """Tell whether the moments satisfy the condition whatever the one is that was left out."""
    missing = [index for index, moment in enumerate(moments) if moment is None]
    return (
        len(missing) == 1
        and case.condition is not None
        and not _polynomial(case, moments, centre, missing[0])
    )


def misfit(case: ClassicalCase, moments: Moments, centre: Sequence[Fraction], solution: int | None) -> Misfit:
    """Return how far moments are from the case, and the nearest that are of it."""
    own = np.array([float(moment) for moment in moments])
    if case.ratios is not None:
        return min(
            (_misfit_of_ratio(own, ratio) for ratio in _chosen_ratios(case, solution)),
            key=lambda m: m.relative,
        )
    if case.condition is None:
        return Misfit(0.0, (own[0], own[1], own[2]))
    a, _, c = (float(x) for x in centre)
    value, slope = _slope(case, own, a, c)
    relative = abs(value) / float(np.abs(own * slope).sum())
    point = own
    # Each step is the point of the tangent plane that is nearest to the given moments.
    for _ in range(_NEWTON_STEPS):
        value, slope = _slope(case, point, a, c)
        point = own - slope * (value + float(slope @ (own - point))) / float(slope @ slope)
    return Misfit(relative, (float(point[0]), float(point[1]), float(point[2])))


def _slope(
    case: ClassicalCase, point: NDArray[np.float64], a: float, c: float
) -> tuple[float, NDArray[np.float64]]:
    assert case.condition is not None
    slope = np.empty(3)
    for k in range(3):
        shifted = point.astype(complex)
        shifted[k] += 1j * _IMAGINARY_STEP
        A, B, C = shifted.tolist()
        slope[k] = case.condition(A, B, C, a, c).imag / _IMAGINARY_STEP
    A, B, C = point.tolist()
    return float(case.condition(A, B, C, a, c)), slope


def _misfit_of_ratio(own: NDArray[np.float64], ratio: tuple[arb, arb]) -> Misfit:
    ray = np.array([1.0, float(ratio[0]), float(ratio[1])])
    nearest = ray * float(own @ ray) / float(ray @ ray)
    return Misfit(float(np.linalg.norm(own - nearest) / np.linalg.norm(own)), tuple(nearest.tolist()))


def _chosen_ratios(case: ClassicalCase, solution: int | None) -> tuple[tuple[arb, arb], ...]:
    assert case.ratios is not None
    ratios = case.ratios()
    return ratios if solution is None else ratios[solution - 1 : solution]


def _as_given(moments: Partly) -> Iterator[Moments]:
    A, B, C = moments
    if A is not None and B is not None and C is not None:
        yield A, B, C


def _of_ratios(case: ClassicalCase, moments: Partly, solution: int | None) -> Iterator[Moments]:
    for second, third in _chosen_ratios(case, solution):
        ratio = (arb(1), second, third)
        k, given = next((k, moment) for k, moment in enumerate(moments) if moment is not None)
        scale = ball(given) / ratio[k]
        own = [given if i == k else exact_middle(scale * ratio[i]) for i in range(3)]
        if all(
            moment is None or is_within(abs(float(moment / exact - 1)), CONDITION_RELATIVE_ROUNDING)
            for moment, exact in zip(moments, own, strict=True)
        ):
            yield own[0], own[1], own[2]


def _of_condition(case: ClassicalCase, moments: Partly, centre: Sequence[Fraction]) -> Iterator[Moments]:
    assert case.condition is not None
    missing = next((k for k, moment in enumerate(moments) if moment is None), None)
    given: Fraction | None = None
    if missing is None:
        A, B, C = (moment or Fraction(0) for moment in moments)
        if case.condition(A, B, C, centre[0], centre[2]) == 0:
            yield A, B, C
            return
        missing = case.solved
        given = moments[missing]
    closest: Moments | None = None
    for root in _positive_roots(_polynomial(case, moments, centre, missing)):
        own = [root if k == missing else moment or Fraction(0) for k, moment in enumerate(moments)]
        if given is None:
            yield own[0], own[1], own[2]
        elif closest is None or abs(given - root) < abs(given - closest[missing]):
            closest = own[0], own[1], own[2]
    if closest is None or given is None:
        return
    if is_within(abs(float(given / closest[missing] - 1)), CONDITION_RELATIVE_ROUNDING):
        yield closest


def _polynomial(case: ClassicalCase, moments: Partly, centre: Sequence[Fraction], unknown: int) -> fmpq_poly:
    """Return the condition as a polynomial in one of the moments."""
    assert case.condition is not None
    A, B, C = [
        fmpq_poly([0, 1]) if k == unknown else fmpq_poly([_flint(moment or Fraction(0))])
        for k, moment in enumerate(moments)
    ]
    a, c = (fmpq_poly([_flint(centre[k])]) for k in (0, 2))
    found: fmpq_poly = case.condition(A, B, C, a, c)
    return found


def _positive_roots(polynomial: fmpq_poly) -> Iterator[Fraction]:
    if polynomial.degree() == 1:
        constant, slope = polynomial[0], polynomial[1]
        root = -constant / slope
        if root > 0:
            yield Fraction(int(root.p), int(root.q))
    elif polynomial.degree() > 1:
        yield from (exact_middle(root) for root in real_roots(polynomial) if root > 0)


def _flint(number: Fraction) -> fmpq:
    return fmpq(number.numerator, number.denominator)
