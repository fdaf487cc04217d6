"""Finds F from the energy: F(w) = -h on the curve with w = |A - C|^(α-1) λ^(2α), for each quadrant."""

from collections.abc import Iterable
from fractions import Fraction
from math import exp, floor, log, log1p

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.errors import FormulaError
from service.dynamics.formula.folding import fold_power
from service.dynamics.formula.limits import MAX_BITS
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.inverse.enclosures import BallFunction
from service.dynamics.inverse.section import formula_text
from service.dynamics.potentials.potential import Potential
from service.dynamics.verdict.proofs.energy_terms import EnergyTerms, power_text, sum_text, term_text
from service.dynamics.verdict.sphere.points import Point

_CHECK_BITS = 128
_LATITUDES = tuple(
    (Fraction(rho), sign)
    for rho, sign in (("1/2", 1), ("1/3", -1), ("4/5", 1), ("1/9", -1), ("1/2", -1), ("1/3", 1))
)
"""rho = 1 - g2² and the sign of g2 of the points of a curve where the energy is taken, in turn."""
_ENERGIES_NEEDED = 2
"""Points of the curve whose energies must agree."""
_MAX_STEPS = 80


class NoDecompositionError(DynamicsError):
    """The energy takes two values on one curve: V is not V1[F] + Q G."""

    code = "no_decomposition"


def F_formula(body: RigidBody, terms: EnergyTerms) -> str | None:
    """Return F as a formula in ``w`` from the terms of the energy, None if it is too large."""
    parts: list[str] = []
    for (power, constant), value in terms.items():
        exponent = power / (2 * body.alpha)
        factor, root = _power_of_number(abs(body.A - body.C), -exponent * (body.alpha - 1))
        parts.append(term_text(-value * factor, constant, root, power_text("w", exponent)))
    return formula_text(sum_text(parts))


def is_F_confirmed(body: RigidBody, potential: Potential, F: str, points: Iterable[Point]) -> bool:
    """Whether the balls of F meet those of -H at the exact points."""
    balls = BallAlgebra()
    try:
        tape = compile_tape(parse(F), ("w",))
    except FormulaError:
        return False  # a constant of it is beyond the limits
    with ctx.workprec(_CHECK_BITS):
        for point in points:
            g1, g2, g3 = (balls.constant(coordinate) for coordinate in point)
            scale = balls.power(balls.constant(abs(body.A - body.C)), body.alpha - 1)
            w = scale * balls.power(abs(g3), 2 * body.alpha) / (g1 * g1)
            value = tape.evaluate(balls, (w,))
            if not (value.is_finite() and value.overlaps(-potential.H_ball(body, g1, g2, g3))):
                return False
    return True


def F_on_curves(body: RigidBody, potential: Potential, signs: tuple[int, int]) -> BallFunction:
    """Return F as a function of a ball w > 0, computed from H at two points of the curve.

    Raises
    ------
    NoDecompositionError
        The function, where the energies at the two points are certainly different.
    """

    def F(w: arb) -> arb:
        balls = BallAlgebra()
        scale = balls.constant(abs(body.A - body.C)).log() * balls.constant(body.alpha - 1)
        log_curve = (w.log() - scale) / balls.constant(2 * body.alpha)
        if not log_curve.is_finite():
            return arb("nan")
        energies: list[arb] = []
        for rho, g2_sign in _LATITUDES:
            H = potential.H_ball(body, *_point(body, log_curve, signs, float(rho), g2_sign))
            if H.is_finite():
                energies.append(H)
            if len(energies) == _ENERGIES_NEEDED:
                break
        if not energies:
            return arb("nan")
        if not energies[0].overlaps(energies[-1]):
            raise NoDecompositionError(
                f"on the curve w = {float(w):.6g} the energy has the values {float(energies[0]):.17g} and "
                f"{float(energies[-1]):.17g}; V = V1[F] + Q G needs it constant on every curve",
                pointer="/potential",
            )
        return -energies[0].union(energies[-1])

    return F


def _point(
    body: RigidBody, log_curve: arb, signs: tuple[int, int], rho: float, g2_sign: int
) -> tuple[arb, arb, arb]:
    """Enclose a point of the curve |g3| = λ |g1|^(C/A) with g1² + g3² close to ``rho``."""
    balls = BallAlgebra()
    log_g1 = arb(_log_g1(float(log_curve), float(1 / body.alpha), log(rho)))
    g1 = log_g1.exp()
    g3 = (log_curve + log_g1 * balls.constant(1 / body.alpha)).exp()
    g2 = (1 - g1 * g1 - g3 * g3).sqrt()
    return signs[0] * g1, g2_sign * g2, signs[1] * g3


def _log_g1(log_curve: float, slope: float, log_rho: float) -> float:
    """Return t with exp(2t) + exp(2 log λ + 2 slope t) = rho, by Newton's method in logarithms.

    The logarithm of the sum is convex and increasing, so that the iteration
    converges from anywhere; its accuracy only moves the point along the curve.
    """
    t = min(log_rho / 2, (log_rho / 2 - log_curve) / slope)
    for _ in range(_MAX_STEPS):
        first, third = 2 * t, 2 * (log_curve + slope * t)
        larger, gap = max(first, third), abs(first - third)
        share = 1 / (1 + exp(-gap)) if gap < 700 else 1.0
        weight = share if first >= third else 1 - share
        excess = larger + log1p(exp(-gap)) - log_rho
        step = excess / (2 * (weight + slope * (1 - weight)))
        t -= step
        if abs(step) <= 1e-12 * max(1.0, abs(t)):
            break
    return t


def _power_of_number(base: Fraction, exponent: Fraction) -> tuple[Fraction, str]:
    """Return base^exponent as a rational times a text, which is empty for 1."""
    try:
        exact = fold_power(base, exponent)
    except FormulaError:
        return Fraction(1), power_text(f"({base})", exponent)
    if exact is not None:
        return exact, ""
    whole = floor(exponent)
    bits = max(base.numerator.bit_length(), base.denominator.bit_length())
    if abs(whole) * bits > MAX_BITS:
        whole = 0
    text = str(base) if base.denominator == 1 else f"({base})"
    return base**whole, power_text(text, exponent - whole)
