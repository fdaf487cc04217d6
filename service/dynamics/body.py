"""The rigid body: its principal moments at the fixed point."""

from dataclasses import dataclass
from fractions import Fraction

from service.dynamics.errors import (
    EqualMomentsError,
    ExtremeMomentsError,
    ImpossibleInertiaError,
    MissingMomentError,
    UnphysicalInertiaError,
)

MAX_MOMENT_RATIO = 10**13
"""Largest ratio of A and C, either way: beyond it the curve of a planar motion is a corner in doubles."""


@dataclass(frozen=True, slots=True)
class RigidBody:
    """A rigid body with one fixed point, in its principal axes.

    Parameters
    ----------
    A, C
        Principal moments about the axes that span the plane of the angular
        velocity. Exact, in any consistent unit.
    B
        Moment about the axis orthogonal to that plane, or None where the motion
        does not depend on it.
    allow_unphysical
        Accept moments that break the triangle inequalities.

    Raises
    ------
    ImpossibleInertiaError
        A moment is not positive.
    UnphysicalInertiaError
        A moment exceeds the sum of the other two (with B unknown some B > 0
        always closes the triangle, so nothing is refused).
    """

    A: Fraction
    B: Fraction | None
    C: Fraction
    allow_unphysical: bool = False

    def __post_init__(self) -> None:
        moments = {"A": self.A, "B": self.B, "C": self.C}
        for name, moment in moments.items():
            if moment is not None and moment <= 0:
                raise ImpossibleInertiaError(
                    f"{name} = {moment} is not positive; a moment of inertia is > 0", pointer=f"/body/{name}"
                )
        if self.B is not None and not self.allow_unphysical:
            small, middle, large = sorted((self.A, self.B, self.C))
            if small + middle < large:
                raise UnphysicalInertiaError(
                    f"moments {self.A}, {self.B}, {self.C}: the largest exceeds the sum of the other two by "
                    f'{large - small - middle}; no body has them ("allow_unphysical": true accepts them)',
                    pointer="/body",
                )

    @property
    def alpha(self) -> Fraction:
        """A/C, the exponent of the curves g1 = (g3/λ)^(A/C)."""
        return self.A / self.C

    def require_planar(self) -> None:
        """Raise EqualMomentsError if A = C, where no planar family exists.

        And ExtremeMomentsError if one of them is more than MAX_MOMENT_RATIO times the other.
        """
        # In whole numbers: this is asked at every point at which something is checked.
        A, C = self.A.numerator * self.C.denominator, self.C.numerator * self.A.denominator
        if A == C:
            raise EqualMomentsError(
                f"A = C = {self.A}: the compatibility equation needs A ≠ C", pointer="/body"
            )
        if max(A, C) > MAX_MOMENT_RATIO * min(A, C):
            ratio = max(self.alpha, 1 / self.alpha)
            raise ExtremeMomentsError(
                f"A = {self.A}, C = {self.C}: one is some 1e{len(str(int(ratio))) - 1} times the other; "
                f"planar motions are computed for ratios up to {MAX_MOMENT_RATIO:.0e}",
                pointer="/body",
            )

    def require_B(self, purpose: str) -> Fraction:
        """Return B, or raise MissingMomentError saying what it is needed for."""
        if self.B is None:
            raise MissingMomentError(f"{purpose} needs the moment B, which was left out", pointer="/body/B")
        return self.B
