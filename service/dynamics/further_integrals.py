r"""Further integrals of bodies with A = B = 2C and A = B = 4C: of Kovalevskaya, Goriachev and Chaplygin.

For A = B = 2C, with z = p + i q, ζ = g1 + i g2 and, modulo constants and γ·γ = 1,

.. math::
    V = a g_1 + b g_2 + c_1 (g_1^2 - g_2^2) + 2 c_2 g_1 g_2 + b_1 / g_3^2 , \\
    C W = C z^2 - (a + i b) \zeta + (c_1 + i c_2) g_3^2 - b_1 \zeta^2 / g_3^2 ,

the complex W turns at the rate −r: W' = −i r W, so K = \|W\|² is constant. For linear V
this holds along every motion (Kovalevskaya 1889), otherwise where the areas
integral is zero (Chaplygin 1903, Goriachev 1916). Off that level K' is
proportional to the areas integral I3.

For A = B = 4C the integral of Goriachev (1900) and Chaplygin (1901) is

.. math::
    V = a g_1 + b g_2 + b_1 / g_3^2 , \qquad
    K = r \Big(p^2 + q^2 + \frac{b_1}{2 C g_3^2}\Big) - \frac{g_3}{C} (a p + b q) , \qquad
    K' = \frac{b p - a q}{4 C^2} I_3 ,

so K is constant where I3 = 0, and without a and b, where r is constant too, always.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from typing import Literal, TypeVar

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.potentials.terms import Exponents
from service.dynamics.verdict.exact_ring.generators import (
    Coordinate,
    Element,
    Layout,
    NoProofError,
    UndefinedInOctantError,
)
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.ring_functions.ring_algebra import RingAlgebra, in_large_enough_ring

FloatArray = NDArray[np.float64]
T = TypeVar("T", FloatArray, arb)
N = TypeVar("N")

DRIFT_BITS = 128
"""Precision of the balls for a drift: near a collision the terms of W cancel like those of the energy."""


@dataclass(frozen=True, slots=True)
class FurtherIntegral:
    """K for one field, with the exact parameters of the module's formulas.

    ``kind`` tells along which motions it is constant: along every one, or those with I3 = 0.
    """

    name: Literal["kovalevskaya", "goriachev", "goriachev_chaplygin"]
    kind: Literal["general", "zero_areas"]
    C: Fraction
    a: Fraction
    b: Fraction
    c1: Fraction
    c2: Fraction
    b1: Fraction

    @property
    def is_cubic(self) -> bool:
        """Whether K is a cubic of p, q and r, not |W|²."""
        return self.name == "goriachev_chaplygin"

    def __call__(self, omega: FloatArray, gamma: FloatArray) -> FloatArray:
        """Return K at ``omega`` and ``gamma`` of shape (..., 3), shape (...); NaN at a pole of V."""
        p, q, r = np.moveaxis(np.asarray(omega, dtype=np.float64), -1, 0)
        g1, g2, g3 = np.moveaxis(np.asarray(gamma, dtype=np.float64), -1, 0)
        if self.b1:
            g3 = np.where(g3 == 0.0, np.nan, g3)
        with np.errstate(all="ignore"):
            return np.asarray(self._value(self._numbers(nearest_double), p, q, r, g1, g2, g3))

    def balls(self, states: Sequence[Sequence[float]]) -> list[arb]:
        """Return enclosures of K at states (p, q, r, g1, g2, g3), at the current ``flint.ctx.prec``."""
        numbers = self._numbers(BallAlgebra().constant)
        return [self._value(numbers, *(arb(number) for number in state)) for state in states]

    def _numbers(self, number: Callable[[Fraction], N]) -> tuple[N, N, N, N, N]:
        a, b, c1, c2, b1 = (number(x / self.C) for x in (self.a, self.b, self.c1, self.c2, self.b1))
        return a, b, c1, c2, b1

    def _value(self, numbers: Sequence[T | float], p: T, q: T, r: T, g1: T, g2: T, g3: T) -> T:
        a, b, c1, c2, b1 = numbers
        if self.is_cubic:
            squares = p * p + q * q
            if self.b1:
                squares = squares + b1 / (2 * (g3 * g3))
            return r * squares - g3 * (a * p + b * q)
        real = (p - q) * (p + q) - (a * g1 - b * g2) + c1 * (g3 * g3)
        imaginary = 2 * p * q - (a * g2 + b * g1) + c2 * (g3 * g3)
        if self.b1:  # else g3 = 0 is a point like any other
            real = real - b1 * ((g1 - g2) * (g1 + g2)) / (g3 * g3)
            imaginary = imaginary - b1 * (2 * g1 * g2) / (g3 * g3)
        return real * real + imaginary * imaginary


def find_further_integrals(
    body: RigidBody, potential: Potential, *, g1_sign: Literal[1, -1] | None = None
) -> tuple[FurtherIntegral, ...]:
    """Return the further integral of the six equations, or nothing.

    V is recognised exactly, however it is written, if its numbers are
    rational. Nothing is returned where that fails: no claim that none exists.

    Parameters
    ----------
    g1_sign
        The sign that g1 keeps along the motion, if it does: then |g1| is
        recognised too. Otherwise V must be one and the same wherever it is defined.
    """
    ratio = body.A / body.C
    if body.A != body.B or ratio not in (2, 4):
        return ()
    try:
        parameters = _recognise(potential.tape, g1_sign)
    except NoClosedFormError:
        return ()
    if parameters is None:
        return ()
    a, b, c1, c2, _ = parameters
    if ratio == 4:
        if c1 or c2:
            return ()
        kind: Literal["general", "zero_areas"] = "zero_areas" if a or b else "general"
        return (FurtherIntegral("goriachev_chaplygin", kind, body.C, *parameters),)
    if any(parameters[2:]):
        return (FurtherIntegral("goriachev", "zero_areas", body.C, *parameters),)
    return (FurtherIntegral("kovalevskaya", "general", body.C, *parameters),)


def integral_drift(integral: FurtherIntegral, samples: FloatArray) -> tuple[float, float]:
    """Return K at the first of ``samples`` (n, 6), and its largest departure from that over all of them.

    K is taken from balls: what is found is in the samples, not in the sum. A
    sample at a pole of V, where K has no value, is left out.
    """
    with ctx.workprec(DRIFT_BITS):
        values = np.array([float(K) for K in integral.balls(np.asarray(samples).tolist())])
    departures = np.abs(values - values[0])
    return float(values[0]), float(departures[np.isfinite(departures)].max(initial=0.0))


# --- recognition ---------------------------------------------------------------------


_Parameters = tuple[Fraction, Fraction, Fraction, Fraction, Fraction]
"""a, b, c1, c2, b1."""


def _recognise(tape: Tape, g1_sign: int | None) -> _Parameters | None:
    """Return the parameters, if they are the same in every octant where V is defined."""
    found: set[_Parameters | None] = set()
    for signs in product((1, -1), repeat=3):
        if g1_sign not in (None, signs[0]):
            continue
        try:
            ring, terms = _laurent_terms(tape, (signs[0], signs[1], signs[2]))
        except UndefinedInOctantError:
            continue
        except NoProofError:
            return None
        found.add(None if terms is None else _parameters(terms))
        if not ring.sign_dependent:
            break
    return found.pop() if len(found) == 1 else None


def _parameters(terms: dict[Exponents, Fraction]) -> _Parameters | None:
    """Return the parameters of a V without powers of g2² (1 - g1² - g3² stands for it), None if not ours."""
    rest = dict(terms)

    def take(*exponents: int) -> Fraction:
        return rest.pop((exponents[0], exponents[1], exponents[2]), Fraction(0))

    take(0, 0, 0)
    # c1 (g1² - g2²) = c1 (2 g1² + g3² - 1).
    c1 = take(2, 0, 0) / 2
    if take(0, 0, 2) != c1:
        return None
    parameters = (take(1, 0, 0), take(0, 1, 0), c1, take(1, 1, 0) / 2, take(0, 0, -2))
    return None if rest else parameters


def _laurent_terms(tape: Tape, signs: tuple[int, int, int]) -> tuple[Ring, dict[Exponents, Fraction] | None]:
    """Return V as a sum of monomials in g1, g2, g3, at most linear in g2; None if it is not one visibly.

    Raises
    ------
    UndefinedInOctantError
        V has no value where g1, g2, g3 have these signs.
    NoProofError
        V is too large to be expanded.
    """

    def expanded(ring: Ring, algebra: RingAlgebra) -> dict[Exponents, Fraction] | None:
        return _monomials(ring, tape.evaluate(algebra, [ring.coordinate(position) for position in range(3)]))

    return in_large_enough_ring(Layout(), signs, expanded)


def _monomials(ring: Ring, V: Element) -> dict[Exponents, Fraction] | None:
    # Relations apply to the numerator only: what stands above the line goes there first.
    above = ring.context.term(exp_vec=tuple(max(exponent, 0) for exponent in V.shift))
    V = ring.normal(
        ring.multiply(
            ring.polynomial(above),
            Element(V.numerator, tuple(min(exponent, 0) for exponent in V.shift)),
        )
    )
    terms: dict[Exponents, Fraction] = {}
    for low, coefficient in V.numerator.terms():
        value = Fraction(int(coefficient.p), int(coefficient.q))
        exponents = [0, 0, 0]
        for index, (exponent, shift) in enumerate(zip(low, V.shift, strict=True)):
            whole = int(exponent) + shift
            if whole == 0:
                continue
            nature = ring.natures[index]
            if not isinstance(nature, Coordinate) or whole % nature.degree:
                return None
            exponents[nature.position] = whole // nature.degree
        for sign, exponent in zip(ring.signs, exponents, strict=True):
            value *= sign ** (exponent % 2)
        terms[exponents[0], exponents[1], exponents[2]] = value
    return terms
