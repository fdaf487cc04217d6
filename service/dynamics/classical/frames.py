"""The order of axes of a case: which axis of the client is which, with the signs of the centre.

A change of axes by a signed permutation S is an exact symmetry: γ → S γ, ω → det(S) S ω, centre → S centre.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import permutations

from service.dynamics.classical.errors import CaseCentreError
from service.dynamics.classical.protocol import ClassicalCase
from service.dynamics.classical.reduced import Number

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
