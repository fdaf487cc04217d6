"""Finds the body and the order of axes of a classical motion, or says which body there would be.

The order of axes says which axis of the client is which axis of the case, with the signs of the centre. A
change of axes by a signed permutation S is an exact symmetry: γ → S γ, ω → det(S) S ω, centre → S centre.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import permutations

from service.dynamics.body import RigidBody
from service.dynamics.classical.catalogue import CASES
from service.dynamics.classical.conditions import (
    Misfit,
    Moments,
    completed,
    leaves_free,
    left_out_in_vain,
    misfit,
)
from service.dynamics.classical.protocol import ClassicalCase, Number
from service.dynamics.errors import (
    CaseCentreError,
    CaseConditionError,
    CaseMomentsError,
    UnphysicalInertiaError,
)
from service.dynamics.numerics import is_within
from service.dynamics.problem import ClassicalMotion

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


Partly = Sequence[Fraction | None]


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
