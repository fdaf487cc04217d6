"""Finds the body and the order of axes of a classical motion, or says which body there would be.

The order of axes says which axis of the client is which axis of the case, with the signs of the centre. A
change of axes by a signed permutation S is an exact symmetry: γ → S γ, ω → det(S) S ω, centre → S centre.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import permutations
from types import MappingProxyType

import numpy as np
from flint import arb, ctx, fmpq, fmpq_poly
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.classical.cases import (
    bobylev_steklov,
    chaplygin,
    dokshevich_1965,
    elliptic_x_minus_k_over_x,
    goriatchev,
    grioli,
    hess,
    konosevich_pozdnyakovich,
    kowalewski,
    staude,
    steklov,
)
from service.dynamics.classical.protocol import CASE_BITS, ClassicalCase, Number, real_roots
from service.dynamics.errors import (
    CaseCentreError,
    CaseConditionError,
    CaseMomentsError,
    UnphysicalInertiaError,
)
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.numerics import is_within
from service.dynamics.problem import ClassicalMotion
from service.dynamics.solution.dense_output import exact_middle

_MODULES = (
    hess,
    staude,
    bobylev_steklov,
    goriatchev,
    steklov,
    chaplygin,
    kowalewski,
    grioli,
    dokshevich_1965,
    konosevich_pozdnyakovich,
    elliptic_x_minus_k_over_x,
)
CASES: Mapping[str, ClassicalCase] = MappingProxyType({module.CASE.name: module.CASE for module in _MODULES})
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


_WHERE = {
    "axis": "on a principal axis: one of a, b, c is not 0, and the others are",
    "plane": "in a principal plane and on no axis: one of a, b, c is 0, and the others are not",
}


@dataclass(frozen=True, slots=True)
class AxisOrder:
    """Axis i of the case is the client's axis ``axes[i]``, turned round if ``signs[i]`` is −1."""

    axes: tuple[int, int, int] = (0, 1, 2)
    signs: tuple[int, int, int] = (1, 1, 1)

    @property
    def determinant(self) -> int:
        """1 or −1."""
        i, j, k = self.axes
        parity = 1 if (j - i) * (k - i) * (k - j) > 0 else -1
        return parity * self.signs[0] * self.signs[1] * self.signs[2]

    def moments(self, client: Sequence[Number]) -> tuple[Number, Number, Number]:
        """Return moments in the order of the case."""
        i, j, k = self.axes
        return client[i], client[j], client[k]

    def moments_back(self, own: Sequence[Number]) -> tuple[Number, Number, Number]:
        """Return moments in the client's order."""
        places = [self.axes.index(axis) for axis in range(3)]
        return own[places[0]], own[places[1]], own[places[2]]

    def vector(self, client: Sequence[Number]) -> tuple[Number, Number, Number]:
        """Return a vector such as γ or the centre, from the client's axes to those of the case."""
        x, y, z = self.moments(list(client))
        s = self.signs
        return s[0] * x, s[1] * y, s[2] * z

    def vector_back(self, own: Sequence[Number]) -> tuple[Number, Number, Number]:
        """Return a vector from the axes of the case to the client's."""
        signed = [s * x for s, x in zip(self.signs, own, strict=True)]
        return self.moments_back(signed)

    def axial(self, client: Sequence[Number]) -> tuple[Number, Number, Number]:
        """Return an angular velocity, from the client's axes to those of the case."""
        x, y, z = self.vector(client)
        d = self.determinant
        return d * x, d * y, d * z

    def axial_back(self, own: Sequence[Number]) -> tuple[Number, Number, Number]:
        """Return an angular velocity, from the axes of the case to the client's."""
        x, y, z = self.vector_back(own)
        d = self.determinant
        return d * x, d * y, d * z


def frames(case: ClassicalCase, centre: Sequence[Fraction]) -> tuple[AxisOrder, ...]:
    """Return the orders of axes in which the centre is where the case has it.

    Raises
    ------
    CaseCentreError
        There is none.
    """
    if case.centre == "any":
        return (AxisOrder(),)
    found = tuple(_fitting(case, centre))
    if not found:
        told = ", ".join(f"{name} = {value}" for name, value in zip("abc", centre, strict=True))
        raise CaseCentreError(
            f"the case {case.name} needs the centre of the potential {_WHERE[case.centre]}; here {told}",
            pointer="/potential",
        )
    return found


def _fitting(case: ClassicalCase, centre: Sequence[Fraction]) -> Iterator[AxisOrder]:
    for axes in permutations(range(3)):
        a, b, c = (centre[axis] for axis in axes)
        if a != 0 and b == 0 and (c == 0) == (case.centre == "axis"):
            i, j, k = axes
            yield AxisOrder((i, j, k), (1 if a > 0 else -1, 1, -1 if c < 0 else 1))


@dataclass(frozen=True, slots=True)
class Fitting:
    """A body that satisfies the condition of a case, with the order of axes in which it does."""

    case: ClassicalCase
    body: RigidBody
    frame: AxisOrder
    moments: Moments
    """In the order of the case."""


def fittings(motion: ClassicalMotion, moments: Partly, *, allow_unphysical: bool) -> list[Fitting]:
    """Return the bodies with these moments, None for those left out, in each order of axes that fits.

    Raises
    ------
    CaseCentreError
        The centre of the potential is not where the case has it.
    CaseMomentsError
        Moments were left out that do not follow from the others.
    CaseConditionError
        The moments do not satisfy the condition.
    UnphysicalInertiaError
        No body has the moments that do.
    """
    case = CASES[motion.case]
    orders = frames(case, motion.centre)
    views = [(f.moments(moments), f.vector(motion.centre)) for f in orders]
    is_free = any(leaves_free(case, own, centre) for own, centre in views)
    if is_free or all(left_out_in_vain(case, own, centre) for own, centre in views):
        raise CaseMomentsError(_needed(case), pointer="/body")
    found, impossible = list[Fitting](), list[UnphysicalInertiaError]()
    for frame, own in _candidates(case, orders, motion, moments):
        A, B, C = frame.moments_back(own)
        try:
            body = RigidBody(A, B, C, allow_unphysical)
        except UnphysicalInertiaError as error:
            impossible.append(error)
        else:
            found.append(Fitting(case, body, frame, own))
    if found:
        return found
    if impossible:
        raise UnphysicalInertiaError(
            f"{impossible[0].message}; the case {case.name} is real for {case.about.real}", pointer="/body"
        )
    raise _refusal(case, orders, motion, moments)


def _candidates(
    case: ClassicalCase, orders: Sequence[AxisOrder], motion: ClassicalMotion, moments: Partly
) -> Iterator[tuple[AxisOrder, Moments]]:
    for frame in orders:
        centre = frame.vector(motion.centre)
        for own in completed(case, frame.moments(moments), centre, motion.solution):
            if case.is_descending and not own[0] > own[1] > own[2]:
                continue
            yield frame, own


def _refusal(
    case: ClassicalCase, orders: Sequence[AxisOrder], motion: ClassicalMotion, moments: Partly
) -> CaseConditionError | CaseMomentsError:
    conditions = " and ".join(case.about.conditions)
    about = (
        f"the case {case.name} needs {conditions} (in some order of the axes), "
        f"and is real for {case.about.real}"
    )
    A, B, C = moments
    if A is None or B is None or C is None:
        return CaseConditionError(f"no body has these moments: {about}", pointer="/body")
    nearest: tuple[Misfit, AxisOrder] | None = None
    for frame in orders:
        found = misfit(case, frame.moments((A, B, C)), frame.vector(motion.centre), motion.solution)
        if nearest is None or found.relative < nearest[0].relative:
            nearest = found, frame
    assert nearest is not None
    found, frame = nearest
    told = ", ".join(
        f"{name} = {value:.15g}" for name, value in zip("ABC", frame.moments_back(found.nearest), strict=True)
    )
    is_body = is_within(2.0 * max(found.nearest), sum(found.nearest)) and min(found.nearest) > 0.0
    return CaseConditionError(
        f"the moments miss the condition by {found.relative:.3e} of their size; the nearest that "
        f"satisfy it are {told}{'' if is_body else ', which no body has'}; {about}",
        pointer="/body",
    )


def _needed(case: ClassicalCase) -> str:
    if case.ratios is not None:
        return f"the case {case.name} fixes the ratios of the moments: give one of A, B, C"
    if case.condition is None:
        return f"the case {case.name} leaves all moments free: give A, B and C"
    return (
        f"a moment was left out that does not follow: the case {case.name} needs {case.about.conditions[-1]}"
    )
