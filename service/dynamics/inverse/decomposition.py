"""The decomposition V = V1[F] + Q G of an admissible potential, with F and the known terms from its energy.

Powers of λ in H belong to the B_n, C_n and logarithmic terms, each with its own
power; what is left beside them is a constant and Q times a function of g2.

F is a function of the curve, w = |A - C|^(α-1) |g3|^(2α)/g1², and G of g2. With
the reference angle phi0 = pi/4 both are determined by V in each quadrant of
(g1, g3): F(w) = -h, the energy of the motion along the curve, and G is V/Q on the
section phi = phi0, where V1 is zero (H. M. Yehia, (V1) and (V2) of the paper).
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import exp, floor, log, log1p

import numpy as np
from flint import arb, ctx
from numpy.typing import ArrayLike, NDArray

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError, FormulaError
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.monomials import weighted_sum
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import MAX_BITS, fold_power, format_tree
from service.dynamics.inverse.polynomials import (
    GENERATORS,
    ExpandedTerms,
    Expansion,
    expand_in_quadrant,
    unit,
)
from service.dynamics.inverse.section import (
    BallFunction,
    G_on_section,
    Values,
    enclose,
    formula_text,
    is_G_confirmed,
    section,
    substituted_formula,
)
from service.dynamics.potentials.families.coefficients import B_term, C_term, energy_of_B, energy_of_C
from service.dynamics.potentials.families.general_solution import SIGNS, GeneralPotential, Quadrant
from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.terms import MAX_TERMS, PowerSum, energy_of_log, log_term, multiplicity
from service.dynamics.verdict.proofs.energy_terms import (
    EnergyTerms,
    energy_terms,
    power_text,
    sum_text,
    term_text,
)
from service.dynamics.verdict.proofs.proof import Signs, prove
from service.dynamics.verdict.sphere.boxes import Point, fine_sphere_points, sphere_points

FloatArray = NDArray[np.float64]

_ZERO = Fraction(0)
_G1, _G3, _RHO, _LOG_G1, _LOG_G3, _LOG_RHO = (unit(position) for position in (0, 2, 3, 4, 5, 6))


@dataclass(frozen=True, slots=True)
class Terms:
    """V = constant + Q Σ A_n g2^n + Σ B_n-terms + Σ C_n-terms + Σ log_n-terms, in one quadrant.

    The terms are those of :mod:`service.dynamics.potentials.families.coefficients`,
    functions of |g1| and |g3|; the lists begin with n = 0.
    """

    constant: Fraction
    A: tuple[Fraction, ...]
    B: tuple[Fraction, ...]
    C: tuple[Fraction, ...]
    log: tuple[Fraction, ...]


def read_terms(body: RigidBody, expansion: Expansion | None, energy: EnergyTerms | None) -> Terms | None:
    """Return the terms of a potential expanded in a quadrant, with its energy; None if it has others."""
    if expansion is None or energy is None:
        return None
    weights: dict[str, dict[int, Fraction]] = {"B": {}, "C": {}, "log": {}}
    parts: list[tuple[Fraction, ExpandedTerms]] = [(Fraction(1), expansion.terms)]
    constant = _ZERO
    for (power, factor), value in energy.items():
        if factor:
            return None
        if power == 0:
            constant = value
            parts.append((-value, {(_ZERO,) * GENERATORS: Fraction(1)}))
            continue
        index = _index(body.alpha, power)
        if index is None:
            return None
        name, n = index
        weight = weights[name][n] = value / _energy(body.alpha, name, n)
        parts.append((-weight, _monomials(body.alpha, name, n)))
    # H of the rest is zero: it is Q G(g2), and its values on one section are enough.
    G = section(body, Expansion(weighted_sum(parts), expansion.atoms))
    A = None if G is None else G.polynomial()
    if A is None or len(A) > MAX_TERMS:
        return None
    return Terms(constant, tuple(A), *(_listed(weights[name]) for name in ("B", "C", "log")))


def _index(alpha: Fraction, power: Fraction) -> tuple[str, int] | None:
    """Return the list and the index of the term with the energy λ^power, None if there is none."""
    name, order = ("B", power / 2) if power > 0 else ("C", -power / (2 * alpha))
    if order.denominator != 1 or order > MAX_TERMS:
        return None
    n = order.numerator - 1
    # The series with a gap is that of the larger moment.
    has_gap = (alpha > 1) == (name == "B") and multiplicity(alpha, n) is not None
    return "log" if has_gap else name, n


def _energy(alpha: Fraction, name: str, n: int) -> Fraction:
    if name == "log":
        return energy_of_log(alpha, n)
    return energy_of_B(alpha, n) if name == "B" else energy_of_C(alpha, n)


def _monomials(alpha: Fraction, name: str, n: int) -> ExpandedTerms:
    if name != "log":
        return _from_power_sum(B_term(alpha, n) if name == "B" else C_term(alpha, n))
    term = log_term(alpha, n)
    moments = (Fraction(1), term.alpha) if term.is_exchanged else (term.alpha, Fraction(1))
    log_square = {_LOG_G3 if term.is_exchanged else _LOG_G1: Fraction(2), _LOG_RHO: Fraction(-1)}
    total = _from_power_sum(term.rest)
    for square, moment in zip((_G1, _G3), moments, strict=True):
        for logarithm, factor in log_square.items():
            powers = tuple(
                2 * s + term.power * r + one for s, r, one in zip(square, _RHO, logarithm, strict=True)
            )
            total[powers] = term.residue * moment * factor
    return total


def _from_power_sum(terms: PowerSum) -> ExpandedTerms:
    return {
        tuple(first * a + third * b for a, b in zip(_G1, _G3, strict=True)): factor
        for (first, third), factor in terms.items()
    }


def _listed(weights: Mapping[int, Fraction]) -> tuple[Fraction, ...]:
    return tuple(weights.get(n, _ZERO) for n in range(max(weights, default=-1) + 1))


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


REFERENCE_ANGLE = "pi/4"
_SEARCH_BITS = 128
_CHECK_POINTS = 4
"""Points of a quadrant where a formula for F is compared with the energy."""


@dataclass(frozen=True, slots=True)
class Decomposition:
    """F and G in every quadrant where V has values.

    ``F`` and ``G`` hold formulas in ``w`` and in ``g2``, None where there is
    none and only :meth:`F_at` and :meth:`G_at` know the function. ``terms``
    holds the coefficients of the known terms where V is a sum of them.
    ``reference_angle`` is a formula for phi0.
    """

    body: RigidBody
    potential: Potential
    F: Mapping[Quadrant, str | None]
    G: Mapping[Quadrant, str | None]
    terms: Mapping[Quadrant, Terms | None]
    reference_angle: str = REFERENCE_ANGLE

    def F_at(self, quadrant: Quadrant, w: ArrayLike) -> Values:
        """Return F at w > 0 of any shape, with bounds of the errors; raises as :func:`F_on_curves`."""
        formula = self.F[quadrant]
        if formula is not None:
            return enclose(_in_balls(formula, "w"), w)
        return enclose(F_on_curves(self.body, self.potential, SIGNS[quadrant]), w)

    def energy_at(self, quadrant: Quadrant, curve: ArrayLike) -> Values:
        """Return h at λ > 0, if A = 2C at nu with the sign of g1, of any shape; raises as :meth:`F_at`."""
        body, balls, formula = self.body, BallAlgebra(), self.F[quadrant]
        F = F_on_curves(body, self.potential, SIGNS[quadrant]) if formula is None else _in_balls(formula, "w")
        power = Fraction(2) if body.A == 2 * body.C else 2 * body.alpha

        def h(x: arb) -> arb:
            scale = balls.power(balls.constant(abs(body.A - body.C)), body.alpha - 1)
            return -F(scale * balls.power(abs(x), power))

        return enclose(h, curve)

    def G_at(self, quadrant: Quadrant, g2: ArrayLike) -> Values:
        """Return G at -1 < g2 < 1 of any shape, with bounds of the errors."""
        formula = self.G[quadrant]
        if formula is not None:
            return enclose(_in_balls(formula, "g2"), g2)
        return enclose(G_on_section(self.body, self.potential, SIGNS[quadrant]), g2)


def decompose(body: RigidBody, potential: Potential) -> Decomposition:
    """Return F and G of ``potential``, which must be admissible for ``body``.

    Formulas come from a proof that V is admissible. Without one the functions
    are computed from V when they are asked for, and F tells then whether the
    energy differs between two points of a curve. A potential of the general
    family is decomposed as it was stated, with its reference angle.

    Raises
    ------
    EqualMomentsError
        A = C.
    NoDecompositionError
        The energy differs between g2 > 0 and g2 < 0.
    """
    body.require_planar()
    if isinstance(potential, GeneralPotential):
        return _as_stated(body, potential)
    proof = prove(body, potential.tape)
    energies = {} if proof is None else energy_terms(body, proof)
    F: dict[Quadrant, str | None] = {}
    G: dict[Quadrant, str | None] = {}
    terms: dict[Quadrant, Terms | None] = {}
    for quadrant, signs in SIGNS.items():
        points = points_with_values(potential, signs)
        if points:
            energy = energy_in_quadrant(energies, signs)
            expansion = expand_in_quadrant(potential.tape, *signs)
            F[quadrant] = _confirmed_F(body, potential, energy, points)
            G[quadrant] = G_formula(body, potential, expansion, signs)
            terms[quadrant] = read_terms(body, expansion, energy)
    return Decomposition(body, potential, F, G, terms)


def _as_stated(body: RigidBody, potential: GeneralPotential) -> Decomposition:
    pieces = {quadrant: potential.piece(*signs) for quadrant, signs in SIGNS.items()}
    return Decomposition(
        body,
        potential,
        F={quadrant: format_tree(piece.F) for quadrant, piece in pieces.items()},
        G={quadrant: format_tree(piece.G) for quadrant, piece in pieces.items()},
        terms=dict.fromkeys(pieces),
        reference_angle=format_tree(potential.reference_angle),
    )


def _confirmed_F(
    body: RigidBody, potential: Potential, energy: EnergyTerms | None, points: Sequence[Point]
) -> str | None:
    formula = None if energy is None else F_formula(body, energy)
    return formula if formula is not None and is_F_confirmed(body, potential, formula, points) else None


def G_formula(
    body: RigidBody, potential: Potential, expansion: Expansion | None, signs: tuple[int, int]
) -> str | None:
    """Return the simplified formula, else that of V with the section put in, if its balls meet those of V."""
    simplified = None if expansion is None else section(body, expansion)
    text = None if simplified is None else simplified.text()
    if text is not None and is_G_confirmed(body, potential, text, signs):
        return text
    text = substituted_formula(body, potential.tree, signs)
    return text if text is not None and is_G_confirmed(body, potential, text, signs) else None


def energy_in_quadrant(
    energies: Mapping[Signs, EnergyTerms | None], signs: tuple[int, int]
) -> EnergyTerms | None:
    """Return the terms of the energy in both hemispheres of a quadrant, None if they are not known."""
    found = [energies[octant] for octant in ((signs[0], s, signs[1]) for s in (1, -1)) if octant in energies]
    if not found or any(terms is None for terms in found):
        return None
    if found[0] != found[-1]:
        raise NoDecompositionError(
            "the energy on a curve differs between g2 > 0 and g2 < 0; V = V1[F] + Q G needs one energy",
            pointer="/potential",
        )
    return found[0]


def points_with_values(potential: Potential, signs: tuple[int, int]) -> list[Point]:
    """Return a few points of the quadrant where V and its derivatives have values, if there are any."""
    found: list[Point] = []
    with ctx.workprec(_SEARCH_BITS):
        for point in _candidates(signs):
            balls = BallAlgebra()
            g1, g2, g3 = (balls.constant(coordinate) for coordinate in point)
            if all(part.is_finite() for part in potential.value_and_D_ball(g1, g2, g3)):
                found.append(point)
            if len(found) == _CHECK_POINTS:
                break
    return found


def _candidates(signs: tuple[int, int]) -> Iterator[Point]:
    for points in (sphere_points(), fine_sphere_points()):
        yield from (point for point in points if point[0] * signs[0] > 0 and point[2] * signs[1] > 0)


def _in_balls(formula: str, variable: str) -> BallFunction:
    tape = compile_tape(parse(formula), (variable,))
    return lambda x: tape.evaluate(BallAlgebra(), (x,))
