"""The decomposition V = V1[F] + Q G of an admissible potential.

F is a function of the curve, w = |A - C|^(α-1) |g3|^(2α)/g1², and G of g2. With
the reference angle phi0 = pi/4 both are determined by V in each quadrant of
(g1, g3): F(w) = -h, the energy of the motion along the curve, and G is V/Q on the
section phi = phi0, where V1 is zero (H. M. Yehia, (V1) and (V2) of the paper).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import arb, ctx
from numpy.typing import ArrayLike, NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.printer import format_tree
from service.dynamics.formula.tape import compile_tape
from service.dynamics.inverse.curve_function import (
    F_formula,
    F_on_curves,
    NoDecompositionError,
    is_F_confirmed,
)
from service.dynamics.inverse.enclosures import BallFunction, Values, enclose
from service.dynamics.inverse.monomial_sums import Expansion, expand_in_quadrant
from service.dynamics.inverse.section import G_on_section, is_G_confirmed, section, substituted_formula
from service.dynamics.inverse.terms import Terms, read_terms
from service.dynamics.potentials.families.general_solution import SIGNS, GeneralPotential, Quadrant
from service.dynamics.potentials.potential import Potential
from service.dynamics.verdict.proofs.energy_terms import EnergyTerms, energy_terms
from service.dynamics.verdict.proofs.proof import Signs, prove
from service.dynamics.verdict.sphere.points import Point, fine_sphere_points, sphere_points

FloatArray = NDArray[np.float64]

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
