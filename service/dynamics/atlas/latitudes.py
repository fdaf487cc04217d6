"""Finds zeros of p² that stay at one g2 for every λ, as all do where F is constant, and follows them.

At the latitude g2 = y with ρ = 1 − y² the curve of λ is where the curve of λ' = λ ρ^{(1/α − 1)/2} crosses
the equator, shrunk by √ρ (primed axes). So one enclosure of y bounds g1 and g3 there for every λ, also for
zeros of even order, at the equator, or next to a pole, at which no sign of p² changes between two places.

Such potentials are V = c₀(g2) + c₁(g2) g1² on the sphere. For them D = g1 V_3 − g3 V_1 = −2 g1 g3 c₁(g2):
p² has its signs and zeros at the same g2 on every curve, with the same orders. Among the admissible
potentials, V = V1[F] + Q G(g2), these are the ones with a constant F. With any other F, the sum of (V1 +
F)/Q and G, of whose sign p² is, changes along each circle g2 = const: no zero stays there for every λ.

Where F is a constant k, V1[F] + Q G(g2) has the formula V = −k + Q (G + k / (C T₀ (1 − g2²))):
V1[k] = −k T (1/T − 1/T₀) with T = Q / (C ρ), ρ = 1 − g2², and T₀ = α cos² φ₀ + sin² φ₀ in the reference
direction (theory.md, 2.2).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
from flint import Ordering, arb, ctx, fmpq, fmpq_mpoly, fmpq_mpoly_ctx
from numpy.typing import NDArray

from service.dynamics.atlas.curves import HalfCurves, LambdaStretch, equator_of
from service.dynamics.atlas.zeros import Zeros
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.formula.tape import Tape
from service.dynamics.reduction.geometry.height import c_squared_range, log_sine_ball
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import QUARTER_TURN
from service.dynamics.reduction.sign_proofs.equators import equators
from service.dynamics.reduction.window import Arc, ArcEnd, Window
from service.dynamics.reduction.windows import REDUCTION_BITS

FloatArray = NDArray[np.float64]

MAX_ATOMS = 24
MAX_POWER = 16
MAX_TERMS = 200

Element = fmpq_mpoly | None
"""A polynomial in g3, g1, g2 and functions of g2, with g3 once at most; None is any other function."""


def turns_by_latitude(tape: Tape, g1_sign: int, g3_sign: int) -> bool:
    """Tell whether V = c₀(g2) + c₁(g2) g1² is proved where g1 and g3 have these signs; False is no claim."""
    algebra = _OfLatitude((g1_sign, g3_sign))
    found = tape.evaluate(algebra, algebra.axes())
    if found is None:
        return False
    return all(powers[0] == 0 and powers[1] in (0, 2) for powers, _ in found.terms())


@dataclass(slots=True)
class _OfLatitude:
    """An Algebra of polynomials on the sphere in which functions of g2 alone are further variables."""

    signs: tuple[int, int]
    """Signs of g1 and g3."""
    atoms: dict[tuple[str, ...], int] = field(default_factory=dict)
    context: fmpq_mpoly_ctx = field(
        default_factory=lambda: fmpq_mpoly_ctx.get(
            ["g3", "g1", "g2", *(f"f{k}" for k in range(MAX_ATOMS))], Ordering.lex
        )
    )

    def axes(self) -> tuple[Element, Element, Element]:
        """Return g1, g2 and g3."""
        g3, g1, g2 = self.context.gens()[:3]
        return g1, g2, g3

    def constant(self, value: Fraction) -> Element:
        return self.context.constant(fmpq(value.numerator, value.denominator))

    def pi(self) -> Element:
        return self._atom("pi")

    def add(self, left: Element, right: Element) -> Element:
        return None if left is None or right is None else self._reduced(left + right)

    def subtract(self, left: Element, right: Element) -> Element:
        return None if left is None or right is None else self._reduced(left - right)

    def multiply(self, left: Element, right: Element) -> Element:
        if left is None or right is None or len(left) * len(right) > MAX_TERMS**2:
            return None
        return self._reduced(left * right)

    def negate(self, operand: Element) -> Element:
        return None if operand is None else -operand

    def divide(self, left: Element, right: Element) -> Element:
        return self.multiply(left, self.power(right, Fraction(-1)))

    def power(self, base: Element, exponent: Fraction) -> Element:
        if base is None:
            return None
        if exponent.denominator == 1 and 0 < exponent <= MAX_POWER:
            power: Element = base
            for _ in range(exponent.numerator - 1):
                power = self.multiply(power, base)
            return power
        if base.is_constant() and base and exponent.denominator == 1 and abs(exponent) <= MAX_POWER:
            return self.context.constant(base.leading_coefficient() ** exponent.numerator)
        return self._atom("power", base, str(exponent)) if _is_of_latitude(base) else None

    def general_power(self, base: Element, exponent: Element) -> Element:
        if base is None or exponent is None or not (_is_of_latitude(base) and _is_of_latitude(exponent)):
            return None
        return self._atom("general_power", base, exponent)

    def call(self, name: str, argument: Element) -> Element:
        if argument is None:
            return None
        if _is_of_latitude(argument):
            return self._atom(name, argument)
        sign = self._sign(argument) if name in ("abs", "sign") else 0
        if not sign:
            return None
        return self.context.constant(fmpq(sign)) if name == "sign" else argument * sign

    def _sign(self, polynomial: fmpq_mpoly) -> int:
        """Return the sign of c g1^i g3^j, 0 for any other polynomial."""
        terms = list(polynomial.terms())
        if len(terms) != 1 or any(terms[0][0][2:]):
            return 0
        (third, first, *_), coefficient = terms[0]
        sign = 1 if coefficient > 0 else -1
        return int(sign * self.signs[0] ** (first % 2) * self.signs[1] ** (third % 2))

    def _atom(self, *key: str | fmpq_mpoly) -> Element:
        """Return the variable of a function of g2; the same function of the same polynomial is one."""
        text = tuple(map(str, key))
        if text not in self.atoms and len(self.atoms) == MAX_ATOMS:
            return None
        return self.context.gens()[3 + self.atoms.setdefault(text, len(self.atoms))]

    def _reduced(self, polynomial: fmpq_mpoly) -> Element:
        g3, g1, g2 = self.context.gens()[:3]
        found = polynomial % (g3**2 - (1 - g1**2 - g2**2))
        return found if len(found) <= MAX_TERMS else None


def _is_of_latitude(polynomial: fmpq_mpoly) -> bool:
    return all(not powers[0] and not powers[1] for powers, _ in polynomial.terms())


_Latitude = tuple[int, arb, arb]
"""The sign of g2 by which it is looked up, g2, and 1 − g2²."""

NEWTON_STEPS = 60
"""Newton's, for the place on the curve, which no bound rests on."""
NEAR_EQUATOR_COSINE = 0.7
AT_EQUATOR_COSINE = 1e-9
"""|cos v| below which a place is looked up in both hemispheres."""
POINT_RELATIVE_ROUNDING = 2.0**-48
MULTIPLE_ZERO_RADIUS = 2.0**-60
"""Room about zeros that are not simple."""


def stays_at_latitudes(halves: Sequence[HalfCurves]) -> bool:
    """Tell whether it is proved that p² has its signs at the same g2 for every λ."""
    return all(
        turns_by_latitude(half.potential.tape, half.motion.sign_of_g1, half.motion.g3_sign) for half in halves
    )


def zeros_at_latitudes(
    halves: Sequence[HalfCurves],
    single: Sequence[LambdaStretch],
    windows: Sequence[Window],
    *,
    only: ArcEnd | None = None,
) -> list[Zeros]:
    """Return for each half curve, at single λ, the zeros at the latitudes where the windows of one λ end.

    ``only`` those ends that are of this kind: where p² is infinite it is at one g2 for every λ.
    """
    latitudes: list[list[_Latitude]] = [[] for _ in halves]
    with ctx.workprec(REDUCTION_BITS):
        for window in windows:
            for arc in window.arcs:
                for number, latitude, end in _ends(halves, arc):
                    if only in (None, end):
                        latitudes[number].append(latitude)
        return [_zeros(half, single, found) for half, found in zip(halves, latitudes, strict=True)]


def _ends(halves: Sequence[HalfCurves], arc: Arc) -> Iterator[tuple[int, _Latitude, ArcEnd | None]]:
    """Yield the half curves of the ends of an arc with their latitudes; an equator is in both hemispheres."""
    loop = arc.loop
    for v, end in ((arc.lower, arc.lower_end), (arc.upper, arc.upper_end)):
        sine, cosine = v.sin_cos()
        if sine.contains(0):
            continue
        is_other = (sine > 0) != (halves[0].shape.third_sign > 0)
        square, alpha = cosine * cosine, ball(loop.alpha)
        log_sine = log_sine_ball(sine, square)
        c = c_squared_range(loop.Z * loop.Z, loop.G * loop.G, alpha, log_sine, square).sqrt()
        first = loop.G * (alpha * log_sine).exp()
        rho = first * first + loop.Z * loop.Z * sine * sine
        # Bounds enclose a simple zero, or one of 1/p²; where others are is known to the bits in use, which
        # is no bound.
        room = arb(0) if end in ("rest", "collision") else arb(0, MULTIPLE_ZERO_RADIUS)
        for side in [1] if cosine > AT_EQUATOR_COSINE else [-1] if cosine < -AT_EQUATOR_COSINE else [1, -1]:
            yield 1 if is_other and len(halves) > 1 else 0, (side, cosine * c + room, rho + room), end


def _zeros(half: HalfCurves, single: Sequence[LambdaStretch], latitudes: Sequence[_Latitude]) -> Zeros:
    full = len(single), len(latitudes)
    hemisphere = np.array([side for side, _, _ in latitudes], dtype=np.int64)
    y = [_bounds(y) for _, y, _ in latitudes]
    height = tuple(np.broadcast_to(np.array([each[k] for each in y]), full) for k in (0, 1))
    root = [_bounds(rho.sqrt()) for _, _, rho in latitudes]
    roots = np.array([each[0] for each in root]), np.array([each[1] for each in root])
    Z, G = _on_latitudes(half, single, [rho for _, _, rho in latitudes])
    third, first = ((size[0] * roots[0], size[1] * roots[1]) for size in (Z, G))
    sizes = third if half.shape.is_mirrored else first
    x = _distances(half, single, np.abs(np.array([float(y) for _, y, _ in latitudes])), third)
    return Zeros(
        x,
        x,
        hemisphere,
        (sizes[0] * (1.0 - POINT_RELATIVE_ROUNDING), sizes[1] * (1.0 + POINT_RELATIVE_ROUNDING)),
        (height[0], height[1]),
    )


def _bounds(value: arb) -> tuple[float, float]:
    low, high = float(value.lower()), float(value.upper())
    return float(np.nextafter(low, -np.inf)), float(np.nextafter(high, np.inf))


def _on_latitudes(
    half: HalfCurves, single: Sequence[LambdaStretch], rho: Sequence[arb]
) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    """Return bounds of |g3| and |g1| over √ρ (primed), shape (λ, latitudes)."""
    logarithms = np.array([-np.log(each.low) if each.is_inverse else np.log(each.low) for each in single])
    shares = [_bounds(each.log() * (1 / ball(half.shape.alpha) - 1) / 2) for each in rho]
    low, high = (logarithms[:, None] + np.array([each[k] for each in shares]) for k in (0, 1))
    # log k and the sum are off by roundings.
    error = POINT_RELATIVE_ROUNDING * (1.0 + np.abs(logarithms)[:, None] + np.abs(low))
    return equators(half.shape.alpha, low - error, high + error)


def _distances(
    half: HalfCurves,
    single: Sequence[LambdaStretch],
    height: FloatArray,
    third: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Return the distances from the pole, in doubles: where |g3| = Z sin x and |g2| = ``height``."""
    Z, G = equator_of(half, single)
    alpha = float(half.shape.alpha)
    sine = np.minimum(0.5 * (third[0] + third[1]) / Z, 1.0)
    # With q = cos² x, q Z² + (1 − (1 − q)^α) G² is g2²: concave, so that steps from 0 do not pass the root.
    q = np.zeros(sine.shape)
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            rest = q * Z * Z - np.expm1(alpha * np.log1p(-q)) * G * G - height * height
            q = np.clip(
                q - rest / (Z * Z + alpha * G * G * (1.0 - q) ** (alpha - 1.0)), 0.0, NEAR_EQUATOR_COSINE
            )
        found: FloatArray = np.where(
            sine < NEAR_EQUATOR_COSINE, np.arcsin(sine), np.arctan2(np.sqrt(1.0 - q), np.sqrt(q))
        )
    return np.minimum(found, QUARTER_TURN)
