"""The Euler-Poisson equations of a body in a potential, and their three integrals, in doubles and on discs.

The functions at the beginning write them in any algebra; :class:`Equations` has them for arrays of states.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Generic, TypeVar

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.equations.euler_poisson import FourOperations, integrals_in, moments_of, rates_in
from service.dynamics.formula.algebra import Algebra
from service.dynamics.formula.algebras.discs import Disc, DiscAlgebra
from service.dynamics.formula.algebras.intervals import OPERATION_ROUNDING, IntervalAlgebra, widened
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.algebras.real import RealAlgebra
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.reduction.sign_proofs.neighbourhoods import spread_about_zeros
from service.dynamics.reduction.windows import REDUCTION_BITS

FloatArray = NDArray[np.float64]

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Integrals(Generic[T]):
    """The values of the three integrals at one state."""

    energy: T
    areas: T
    geometric: T
    """γ·γ."""


def value_and_gradient(algebra: Algebra[T], tape: Tape, gamma: Sequence[T]) -> tuple[T, tuple[T, ...]]:
    """Return V and (V_1, V_2, V_3)."""
    jets = FirstOrderJets(algebra, 3)
    V = tape.evaluate(jets, jets.variables(gamma))
    return V.value, jets.gradient(V)


def rates_at(
    algebra: Algebra[T], body: RigidBody, state: Sequence[T], gradient: Sequence[T]
) -> tuple[T, ...]:
    """Return the rates of p, q, r, g1, g2, g3; a B that was left out is as in :func:`.moments_of`."""
    return rates_in(operations_of(algebra))(_constants(algebra, body), state, gradient)


def integrals_at(algebra: Algebra[T], body: RigidBody, state: Sequence[T], value: T) -> Integrals[T]:
    """Return h = (A p² + B q² + C r²)/2 + V, A p g1 + B q g2 + C r g3, and γ·γ; V is ``value``."""
    half = algebra.constant(Fraction(1, 2))
    found = integrals_in(operations_of(algebra))(_constants(algebra, body), state, value, half)
    return Integrals(*found)


def operations_of(algebra: Algebra[T]) -> FourOperations[T]:
    """Return the four operations of an algebra."""
    return FourOperations(algebra.add, algebra.subtract, algebra.multiply, algebra.divide)


def _constants(algebra: Algebra[T], body: RigidBody) -> list[T]:
    return [algebra.constant(each) for each in moments_of(body)]


POLE_DISTANCE = 1e-12
"""|g1| and |g3| up to which a potential without a formula has no slope for doubles."""


@dataclass(frozen=True, slots=True)
class Equations:
    """The six equations of a body in a potential, for arrays of states."""

    body: RigidBody
    potential: Potential
    tape: Tape | None

    @staticmethod
    def of(body: RigidBody, potential: Potential) -> "Equations":
        """Return the equations; a potential given by an integral has no formula, and no bounds."""
        try:
            return Equations(body, potential, potential.tape)
        except NoClosedFormError:
            return Equations(body, potential, None)

    @property
    def moments(self) -> FloatArray:
        """The principal moments, a B that is left out as :func:`.moments_of` takes it."""
        return np.array([float(each) for each in moments_of(self.body)[:3]])

    def at(self, states: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return F at states of shape (n, 6), same shape, and the three integrals, shape (n, 3)."""
        algebra, columns = RealAlgebra(), list(states.T)
        gradient: Sequence[FloatArray]
        if self.tape is None:
            gamma = states[:, 3:]
            # Doubles do not tell in which direction from the pole such a place is.
            at_pole = np.maximum(np.abs(gamma[:, 0]), np.abs(gamma[:, 2])) < POLE_DISTANCE
            slopes = np.where(at_pole[:, None], np.nan, self.potential.gradient(gamma))
            value, gradient = self.potential.value(gamma), list(slopes.T)
        else:
            value, gradient = value_and_gradient(algebra, self.tape, columns[3:])
        found = integrals_at(algebra, self.body, columns, value)
        integrals = _stacked((found.energy, found.areas, found.geometric), len(states))
        return _stacked(rates_at(algebra, self.body, columns, gradient), len(states)).T, integrals.T

    @np.errstate(all="ignore")
    def bound(self, centres: FloatArray, radii: FloatArray) -> FloatArray:
        """Return bounds of |F| on discs, shapes (6, n)."""
        discs = self._rates_on(centres, radii)
        return _stacked([DiscAlgebra().bound(disc) for disc in discs], centres.shape[1])

    @np.errstate(all="ignore")
    def spread(self, centres: FloatArray, radii: FloatArray) -> FloatArray:
        """Return bounds of how far F is from its rounded value at the centres, shapes (6, n)."""
        discs = self._rates_on(centres, radii)
        return _stacked([disc.radius for disc in discs], centres.shape[1])

    @np.errstate(all="ignore")
    def integrals_on(self, centres: FloatArray, radii: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return centres and radii of the three integrals on real boxes; shapes (6, n) and (3, n).

        By discs; where V has no bound on these, as about a kink, by intervals. NaN where nothing is known.
        """
        state = _discs(centres, radii)
        value = self._formula().evaluate(DiscAlgebra(), state[3:])
        if not np.isfinite(value.radius).all():
            spread = self.value_spread(centres[3:], radii[3:]) + OPERATION_ROUNDING * np.abs(value.centre)
            value = Disc(value.centre, np.where(np.isfinite(value.radius), value.radius, spread))
        found: Integrals[Disc] = integrals_at(DiscAlgebra(), self.body, state, value)
        parts = (found.energy, found.areas, found.geometric)
        count = centres.shape[1]
        return _stacked([part.centre for part in parts], count), _stacked(
            [part.radius for part in parts], count
        )

    @np.errstate(all="ignore")
    def value_spread(self, centres: FloatArray, radii: FloatArray) -> FloatArray:
        """Return by how much V varies over real boxes at most, shapes (3, n) and (n,); NaN if not known."""
        algebra = IntervalAlgebra(())
        sides = [
            algebra.interval(*widened(c - r, c + r, OPERATION_ROUNDING))
            for c, r in zip(centres, radii, strict=True)
        ]
        lo, hi = algebra.bounds(self._formula().evaluate(algebra, sides))
        return np.broadcast_to(hi - lo, centres.shape[1:])

    def spread_about_zeros(self, centre: FloatArray, radius: FloatArray) -> float:
        """Return the same for a box, shapes (3,), in which V divides 0 by 0; NaN if no place is found."""
        with ctx.workprec(REDUCTION_BITS):
            box = [arb(c, r) for c, r in zip(centre.tolist(), radius.tolist(), strict=True)]
            return spread_about_zeros(self._formula(), box)

    def slopes(self, gamma: FloatArray) -> FloatArray:
        """Return the gradient of V at places of the shape (..., 3), same shape, where it has a formula."""
        slopes = value_and_gradient(RealAlgebra(), self._formula(), list(gamma.reshape(-1, 3).T))[1]
        return _stacked(slopes, gamma.size // 3).T.reshape(gamma.shape)

    def _rates_on(self, centres: FloatArray, radii: FloatArray) -> tuple[Disc, ...]:
        state = _discs(centres, radii)
        algebra = DiscAlgebra()
        _, gradient = value_and_gradient(algebra, self._formula(), state[3:])
        return rates_at(algebra, self.body, state, gradient)

    def _formula(self) -> Tape:
        if self.tape is None:
            raise NoClosedFormError("a potential given by an integral has no bounds on discs")
        return self.tape


def _discs(centres: FloatArray, radii: FloatArray) -> list[Disc]:
    return [Disc(centre, radius) for centre, radius in zip(centres, radii, strict=True)]


def _stacked(parts: Sequence[FloatArray], count: int) -> FloatArray:
    return np.stack([np.broadcast_to(part, (count,)) for part in parts])
