r"""The curve of a planar motion as a closed loop with one coordinate v.

For A > C the curve |g3| = λ |g1|^{C/A} with g1 of one sign closes through both
poles g2 = ±1. With Z and G the values of |g3| and |g1| at the equator
(Z² + G² = 1, G = (Z/λ)^α, α = A/C) it is covered once by

.. math:: g_3 = Z \sin v,\quad |g_1| = G|\sin v|^{\alpha},\quad g_2 = c(v)\cos v,

.. math:: c^2 = Z^2 + G^2 \frac{1-|\sin v|^{2\alpha}}{\cos^2 v} ,

where v = 0 is the north pole, π/2 the equator, π the south pole and v < 0 the
mirror curve g3 → −g3. On it the motion is

.. math:: \dot v = -\frac{c\,p}{Z},\qquad
          p^2 = P(v) = \frac{C\,g_3\,D}{(A-C)\,A\,g_1},\qquad r = -\frac{A g_1}{C g_3}\,p ,

so that every turning type is a feature of the one function P: a simple zero is
a rest point, a double zero an equilibrium or separatrix, and the equator and
(where P stays finite) the poles are ordinary points. A body with A < C is
mirrored first: (A, C; g1, g3; p, r) → (C, A; g3, g1; −r, −p), λ → λ^{−A/C}.
"""

from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.ball import DomainBalls, ball
from service.dynamics.formula.tape import Instruction
from service.dynamics.identity_cache import IdentityCache
from service.dynamics.potentials.potential import FormulaPotential, Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.point import BALLS, REALS, Equator, make_equator, place_of

FloatArray = NDArray[np.float64]


class NuNeedsDoubleMomentError(DynamicsError):
    """``nu`` was given for a body with A ≠ 2C."""

    code = "nu_needs_double_moment"


FEW_BITS = 640
"""Precision up to which the equator is looked for with all bits from the beginning."""
BOX = 2.0**-40
"""Half the side of the boxes about the poles on which V is looked at."""


class LoopPoint(NamedTuple):
    """A point of the loop, at one v, in balls; primed (mirrored) axes if the loop is mirrored."""

    g1: arb
    g2: arb
    g3: arb
    c: arb
    """g2 / cos v, positive."""
    P: arb
    """p² in primed axes."""


@dataclass(frozen=True, slots=True)
class Loop:
    """The curve of one planar motion together with its radicand P(v)."""

    potential: Potential
    A: Fraction
    C: Fraction
    """Moments in primed axes: A > C."""
    mirrored: bool
    """The body has A < C and the first and third axes are exchanged."""
    g1_sign: int
    """Sign of the primed g1, constant on the loop."""
    factor: Fraction
    """C / ((A − C) A), the constant of P."""
    lambda_squared: Fraction
    """λ² of the client's (not mirrored) axes."""
    Z: arb
    G: arb
    balls: dict[int, tuple[Equator[arb], arb]] = field(
        default_factory=dict, init=False, compare=False, repr=False
    )
    """The equator and the factor as balls, cached by precision, since every point needs them."""
    finer: "dict[int, Loop]" = field(default_factory=dict, init=False, compare=False, repr=False)
    """Results of :meth:`refined`, cached by precision."""
    smooth: dict[int, bool] = field(default_factory=dict, init=False, compare=False, repr=False)
    """Whether V is smooth at the poles, cached by precision."""
    bits: int = field(default=0, compare=False, repr=False)
    """The precision at which Z and G were computed; 0 if that is not known."""
    alpha: Fraction = field(init=False, compare=False, repr=False)
    """A/C > 1 in primed axes."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "alpha", self.A / self.C)

    def is_smooth_at_poles(self) -> bool:
        """Tell whether the motion through the poles is the only one the equations allow.

        It needs |g3|^α to be a polynomial in g3 (α an even integer), and V to
        have bounded second derivatives about the poles.
        """
        A, C = self.A, self.C
        if (A.numerator * C.denominator) % (2 * A.denominator * C.numerator):
            return False
        smooth = self.smooth.get(ctx.prec)
        if smooth is None:
            smooth = self.smooth[ctx.prec] = _is_smooth_at_poles(self.potential)
        return smooth

    def refined(self) -> "Loop":
        """Return the loop with Z and G recomputed at the current precision."""
        if self.bits == ctx.prec:
            return self
        found = self.finer.get(ctx.prec)
        if found is None:
            Z, G = _equator(self.alpha, _log_lambda(self))
            found = self.finer[ctx.prec] = replace(self, Z=Z, G=G, bits=ctx.prec)
        return found

    def point(self, v: arb) -> LoopPoint:
        """Return the point at ``v`` (sin v ≠ 0 and cos v ≠ 0), at the current precision."""
        return self.point_from(*v.sin_cos())

    def point_from(self, sine: arb, cosine: arb) -> LoopPoint:
        """Return the point with these sin v ≠ 0 and cos v ≠ 0: no digits are lost near v = π."""
        first, g2, g3, c = place_of(BALLS, sine, cosine, self._constants()[0])
        g1 = first * self.g1_sign
        return LoopPoint(g1, g2, g3, c, self.radicand_at(g1, g2, g3))

    def radicand_from(self, sine: arb, cosine: arb) -> arb:
        """Return P at this point, in less time."""
        first, g2, g3, _ = place_of(BALLS, sine, cosine, self._constants()[0])
        return self.radicand_at(first * self.g1_sign, g2, g3)

    def has_no_value(self, sine: arb, cosine: arb) -> bool:
        """Tell whether the formula of V certainly has no value at the point with these sin v and cos v."""
        at = self.point_from(sine, cosine)
        g1, g2, g3 = (at.g3, at.g2, at.g1) if self.mirrored else (at.g1, at.g2, at.g3)
        own = self.potential
        part = own if own.has_formula else own.formula_part(1 if g1 > 0 else -1, 1 if g3 > 0 else -1)
        if part is None:
            return False
        algebra = DomainBalls()
        part.tape.evaluate(algebra, (g1, g2, g3))
        return algebra.is_undefined

    def radicand_at(self, g1: arb, g2: arb, g3: arb) -> arb:
        """Return P at a place, in primed axes."""
        _, factor = self._constants()
        return factor * g3 * self._D(g1, g2, g3) / g1

    def _constants(self) -> tuple[Equator[arb], arb]:
        found = self.balls.get(ctx.prec)
        if found is None:
            found = make_equator(self.Z, self.G, ball(self.alpha)), ball(self.factor)
            self.balls[ctx.prec] = found
        return found

    def energy(self, v: arb) -> arb:
        """Return h = V + A Q P / (2 C g3²), the same at every v if the potential is admissible."""
        at = self.point(v)
        first, third = (at.g3, at.g1) if self.mirrored else (at.g1, at.g3)
        A, C = ball(self.A), ball(self.C)
        Q = A * at.g1 * at.g1 + C * at.g3 * at.g3
        return self.potential.value_ball(first, at.g2, third) + A * Q * at.P / (2 * C * at.g3 * at.g3)

    def radicand_real(self, sine: FloatArray, cosine: FloatArray) -> FloatArray:
        """Return P in doubles at the points with these sin v and cos v; not finite where it overflows."""
        return self.radicand_on(float(self.Z), float(self.G), sine, cosine)

    def radicand_on(
        self, Z: float | FloatArray, G: float | FloatArray, sine: FloatArray, cosine: FloatArray
    ) -> FloatArray:
        """Return the same on other curves of the same body, potential and signs: those of Z and G."""
        equator = make_equator(np.asarray(Z), np.asarray(G), np.asarray(float(self.alpha)))
        with np.errstate(all="ignore"):
            size, g2, g3, _ = place_of(REALS, sine, cosine, equator)
            g1 = self.g1_sign * size
            first, third = (g3, g1) if self.mirrored else (g1, g3)
            D = self.potential.D_real(first, g2, third)
            factor = float(self.factor) * (-1.0 if self.mirrored else 1.0)
            result: FloatArray = factor * g3 * D / g1
        return result

    def _D(self, g1: arb, g2: arb, g3: arb) -> arb:
        if self.mirrored:
            return -self.potential.D_ball(g3, g2, g1)
        return self.potential.D_ball(g1, g2, g3)


def make_loop(body: RigidBody, potential: Potential, motion: PlanarMotion) -> Loop:
    """Return the loop of ``motion``, at the current precision.

    Raises
    ------
    EqualMomentsError
        A = C.
    NuNeedsDoubleMomentError
        ``nu`` is given and A ≠ 2C.
    """
    body.require_planar()
    if motion.nu is not None and body.A != 2 * body.C:
        raise NuNeedsDoubleMomentError(
            f"nu = g3²/g1 is constant only for A = 2C (here A/C = {body.alpha}); give lambda",
            pointer="/motion/nu",
        )
    unset = arb(0)
    return loop_at(body, potential, motion, unset, unset).refined()


def loop_at(body: RigidBody, potential: Potential, motion: PlanarMotion, Z: arb, G: arb) -> Loop:
    """Return the loop of ``motion``, which exists, with values of Z and G that are known already."""
    A, C, factor, mirrored = _moments_of(body)
    sign = motion.g3_sign if mirrored else motion.sign_of_g1
    return Loop(potential, A, C, mirrored, sign, factor, motion.lambda_squared, Z, G)


def _primed(body: RigidBody) -> tuple[Fraction, Fraction, Fraction, bool]:
    """Return A > C in primed axes, the factor of P, and whether the axes are exchanged."""
    mirrored = body.A < body.C
    A, C = (body.C, body.A) if mirrored else (body.A, body.C)
    return A, C, C / ((A - C) * A), mirrored


_moments_of = IdentityCache(_primed)


def start_g3_sign(loop: Loop, motion: PlanarMotion) -> int:
    """Return the sign of the primed g3 on the half of the loop where ``motion`` is asked."""
    if loop.mirrored:
        return motion.sign_of_g1
    return motion.g3_sign


def _is_smooth_at_poles(potential: Potential) -> bool:
    """Tell whether V is smooth at both poles; known of a formula that many problems have in common."""
    if not isinstance(potential, FormulaPotential):
        return _has_bounded_curvatures(potential)
    tape = potential.tape
    known, key = _of_formula(tape.instructions), (tape.variables, tape.result, ctx.prec)
    if key not in known:
        # By a tape of its own: the problem's is asked as often as if nothing were known.
        known[key] = _has_bounded_curvatures(potential.alone())
    return known[key]


def _none_yet(_: tuple[Instruction, ...]) -> dict[tuple[tuple[str, ...], int, int], bool]:
    return {}


_of_formula = IdentityCache(_none_yet)


def _has_bounded_curvatures(potential: Potential) -> bool:
    return all(_has_bounded_curvature(potential, pole) for pole in (1, -1))


def _has_bounded_curvature(potential: Potential, pole: int) -> bool:
    """Tell whether V is proved twice differentiable on a small box about g2 = ``pole``.

    A derivative that jumps, as that of |g1|, is bounded but does not settle as the box shrinks.
    """
    near = arb(0, BOX)
    _, first, second = potential.jet_ball(near, pole + near, near)
    entries = [entry for row in second for entry in row]
    if not all(entry.is_finite() for entry in entries):
        return False
    slope = 1 + max(float(abs(entry).upper()) for entry in entries)
    return all(float(slot.rad()) < 16.0 * BOX * slope for slot in first)


def _log_lambda(loop: Loop) -> arb:
    half = ball(loop.lambda_squared).log() / 2
    # λ' = λ^(−A/C) with the client's A/C = 1/α'.
    return -half / ball(loop.alpha) if loop.mirrored else half


def _equator(alpha: Fraction, log_lambda: arb) -> tuple[arb, arb]:
    """Solve Z² + (Z/λ)^{2α} = 1 for Z, by Newton in log Z, and return (Z, G).

    F(u) = e^{2u} + e^{2α(u − log λ)} − 1 is convex and increasing and starts
    from u = min(0, log λ), where 0 < F ≤ 1: Newton goes down monotonically.
    The last step is turned into a proof: |u − u*| ≤ F/F' by convexity, and the
    ball is widened by it.
    """
    a = ball(alpha)

    def terms(u: arb) -> tuple[arb, arb]:
        return (2 * u).exp(), (2 * a * (u - log_lambda)).exp()

    u = log_lambda.mid() if log_lambda < 0 else arb(0)
    # Newton's method doubles the digits: the first steps need few bits.
    precisions = [ctx.prec]
    while precisions[-1] > FEW_BITS:
        precisions.append(precisions[-1] // 2 + 16)
    for precision in reversed(precisions):
        with ctx.workprec(precision):
            for _ in range(60 + precision.bit_length()):
                first, second = terms(u)
                step = ((first + second - 1) / (2 * first + 2 * a * second)).mid()
                u = (u - step).mid()
                # What is left is the square of it.
                if abs(step) < arb(2) ** (-8 - precision // 2):
                    break
    first, second = terms(u)
    # A slope at least half of the one at u holds within the tiny radius.
    radius = 2 * (first + second - 1).abs_upper() / (2 * first + 2 * a * second).abs_lower()
    u = arb(u, radius.abs_upper())
    return u.exp(), (a * (u - log_lambda)).exp()
