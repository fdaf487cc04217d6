r"""The Euler-Poisson equations of a rigid body in a potential field, and their three integrals.

.. math::
    A \dot p = (B - C) q r + g_2 V_3 - g_3 V_2, \qquad \dot g_1 = r g_2 - q g_3, \\
    B \dot q = (C - A) p r + g_3 V_1 - g_1 V_3, \qquad \dot g_2 = p g_3 - r g_1, \\
    C \dot r = (A - B) p q + g_1 V_2 - g_2 V_1, \qquad \dot g_3 = q g_1 - p g_2

omega = (p, q, r) is the angular velocity and gamma = (g1, g2, g3) the space-fixed
unit vector, both in the principal axes; all arrays have shape (..., 3). V is
known up to a constant, which the energy shares.

The functions at the beginning write them in any algebra; :class:`Equations` has them for arrays of states.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from operator import add, mul, sub, truediv
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
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


class FourOperations(NamedTuple, Generic[T]):
    """An arithmetic: of arrays, of an algebra's elements, or of what compiled code computes with."""

    plus: Callable[[T, T], T]
    minus: Callable[[T, T], T]
    times: Callable[[T, T], T]
    over: Callable[[T, T], T]


BY_OPERATORS: FourOperations[FloatArray] = FourOperations(add, sub, mul, truediv)


def rates_in(
    arithmetic: FourOperations[T],
) -> Callable[[Sequence[T], Sequence[T], Sequence[T]], tuple[T, ...]]:
    """Return the function of moments as in :func:`moments_of`, a state and V_1, V_2, V_3 to its six rates."""
    plus, minus, times, over = arithmetic

    def rates(moments: Sequence[T], state: Sequence[T], slopes: Sequence[T]) -> tuple[T, ...]:
        A, B, C, B_C, C_A, A_B = moments
        p, q, r, g1, g2, g3 = state
        V1, V2, V3 = slopes
        return (
            over(plus(times(B_C, times(q, r)), minus(times(g2, V3), times(g3, V2))), A),
            over(plus(times(C_A, times(r, p)), minus(times(g3, V1), times(g1, V3))), B),
            over(plus(times(A_B, times(p, q)), minus(times(g1, V2), times(g2, V1))), C),
            minus(times(g2, r), times(g3, q)),
            minus(times(g3, p), times(g1, r)),
            minus(times(g1, q), times(g2, p)),
        )

    return rates


def integrals_in(
    arithmetic: FourOperations[T],
) -> Callable[[Sequence[T], Sequence[T], T, T], tuple[T, T, T]]:
    """Return the function of moments, a state, V and ½ to its energy, its areas and γ·γ."""
    plus, _, times, _ = arithmetic

    def integrals(moments: Sequence[T], state: Sequence[T], V: T, half: T) -> tuple[T, T, T]:
        A, B, C, _, _, _ = moments
        p, q, r, g1, g2, g3 = state
        first, second, third = times(A, p), times(B, q), times(C, r)
        twice = plus(plus(times(first, p), times(second, q)), times(third, r))
        return (
            plus(times(half, twice), V),
            plus(plus(times(first, g1), times(second, g2)), times(third, g3)),
            plus(plus(times(g1, g1), times(g2, g2)), times(g3, g3)),
        )

    return integrals


def moments_of(body: RigidBody) -> tuple[Fraction, ...]:
    """Return A, B, C, B − C, C − A, A − B.

    A moment B that was left out matters for q' alone; it is taken as A + C, the largest there is.
    """
    A, B, C = body.A, body.A + body.C if body.B is None else body.B, body.C
    return A, B, C, B - C, C - A, A - B


@dataclass(frozen=True, slots=True)
class StateRates:
    """Time derivatives of omega and gamma, shape (..., 3) each."""

    omega: FloatArray
    gamma: FloatArray


def euler_poisson_rhs(
    body: RigidBody, potential: Potential, omega: FloatArray, gamma: FloatArray
) -> StateRates:
    """Return the time derivatives of ``omega`` and ``gamma``.

    Raises
    ------
    MissingMomentError
        The body has no B.
    """
    body.require_B("the equations of motion")
    moments = [np.asarray(float(each)) for each in moments_of(body)]
    state = [*np.moveaxis(omega, -1, 0), *np.moveaxis(gamma, -1, 0)]
    found = rates_in(BY_OPERATORS)(moments, state, [*np.moveaxis(potential.gradient(gamma), -1, 0)])
    return StateRates(np.stack(found[:3], axis=-1), np.stack(found[3:], axis=-1))


def energy_integral(
    body: RigidBody, potential: Potential, omega: FloatArray, gamma: FloatArray
) -> FloatArray:
    """Return h = (A p² + B q² + C r²)/2 + V, shape (...).

    Raises
    ------
    MissingMomentError
        The body has no B, and q is not zero throughout.
    """
    h: FloatArray = kinetic_energy(body, omega) + potential.value(gamma)
    return h


def kinetic_energy(body: RigidBody, omega: FloatArray) -> FloatArray:
    """Return (A p² + B q² + C r²)/2, shape (...); raises as :func:`energy_integral`."""
    omega = np.asarray(omega, dtype=np.float64)
    T: FloatArray = np.sum(_inertia(body, omega) * omega**2, axis=-1) / 2.0
    return T


def geometric_integral(gamma: FloatArray) -> FloatArray:
    """Return γ·γ, which is 1, shape (...)."""
    square: FloatArray = np.sum(np.square(gamma), axis=-1)
    return square


def areas_integral(body: RigidBody, omega: FloatArray, gamma: FloatArray) -> FloatArray:
    """Return I3 = A p g1 + B q g2 + C r g3, shape (...); raises as :func:`energy_integral`."""
    omega = np.asarray(omega, dtype=np.float64)
    areas: FloatArray = np.sum(_inertia(body, omega) * omega * gamma, axis=-1)
    return areas


def _inertia(body: RigidBody, omega: FloatArray) -> FloatArray:
    """Return (A, B, C); a missing B is taken as 0 if q = 0, where it has no effect."""
    moment_B = 0.0
    if body.B is not None or np.any(omega[..., 1] != 0.0):
        moment_B = float(body.require_B("an integral with q ≠ 0"))
    return np.array([float(body.A), moment_B, float(body.C)])


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
