"""Proves all potentials of a sweep at once, linear in the parameters, and computes the energy of every point.

The compatibility operator L is linear in V. Where V = V_0 + Σ p_k V_k is affine in the numbers p_k that a
sweep varies, L(V_0) = 0 and L(V_0 + V_k) = 0 for every k make L(V) = 0 for all p, and the energies add up in
the same way. A formula is seen to be affine in parameters by its tree; the families of the catalogue are in
their coefficients. Whatever is not proved so is decided point by point.

A job encloses the energy in a ball of 160 bits and rounds it once. Here it is enclosed by another formula, of
the family's proofs, in as many bits; both round to the same double unless the ball contains a rounding
boundary, and then the point is left to a single job.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from flint import arb, ctx, fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError, FormulaError
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.formula.tree import Binary, Call, Negation, Symbol, Tree, fold_tree
from service.dynamics.potentials.families.general_solution import Quadrant
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import make_loop
from service.dynamics.reduction.windows import REDUCTION_BITS
from service.dynamics.verdict.verdict import Verdict, decide
from service.schemas.problem.trusted import potential_of
from service.schemas.reading.documents import Part, with_values

FloatArray = NDArray[np.float64]


Path = tuple[str, ...]

POLES = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
MOST_HESSIAN_CANCELLATION = 2.0
"""Second derivatives at a pole that cancel beyond this factor are looked at point by point."""

_LISTS: Mapping[str, frozenset[str]] = {
    "rational": frozenset("abc"),
    "homogeneous": frozenset({"A", "B", "C", "log"}),
}
_MORE = 2
"""Stands for any degree above 1."""


@dataclass(frozen=True, slots=True)
class Member:
    """A potential of the family and what is proved of it."""

    potential: Potential
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class SweepFamily:
    """V_0 + Σ p_k V_k, all admissible: ``origin`` is V_0, ``units`` are V_0 + V_k in the order of the p_k."""

    origin: Member
    units: tuple[Member, ...]

    @property
    def members(self) -> tuple[Member, ...]:
        """Return all that were proved."""
        return (self.origin, *self.units)


def prove_family(
    body: RigidBody, document: Mapping[str, object], paths: Sequence[Path]
) -> SweepFamily | None:
    """Return the potentials that ``document`` states when the numbers at ``paths`` vary, None if not proved.

    Without paths there is one potential, and its verdict may be any that says admissible.
    """
    if not all(_is_linear_in(document, path) for path in paths) or not _is_affine(document, paths):
        return None
    zeros = dict.fromkeys(paths, 0)
    try:
        origin = _member(body, with_values(document, dict(zeros)))
        units = tuple(_member(body, with_values(document, {**zeros, path: 1})) for path in paths)
    except (DynamicsError, ValueError):
        return None
    family = SweepFamily(origin, units)
    proved = all(member.verdict.verdict == "admissible" for member in family.members) and (
        not paths or all(member.verdict.proof == "symbolic" for member in family.members)
    )
    return family if proved else None


@dataclass(frozen=True, slots=True)
class Poles:
    """The condition for motions through the poles to need no convention: V is twice differentiable there."""

    hessians: FloatArray
    """Second derivatives of V_0 and of each V_k at both poles, shape (terms, 2, 3, 3)."""

    def are_plain(self, parameters: FloatArray) -> NDArray[np.bool_]:
        """Say for each row of parameters (points, terms − 1) whether nothing cancels there."""
        weights = np.concatenate([np.ones((len(parameters), 1)), parameters], axis=1)
        sizes = np.abs(self.hessians).max(axis=(1, 2, 3))
        whole = np.abs(np.tensordot(weights, self.hessians, axes=1)).max(axis=(1, 2, 3))
        plain: NDArray[np.bool_] = np.abs(weights) @ sizes <= MOST_HESSIAN_CANCELLATION * (1.0 + whole)
        return plain


def smooth_poles(body: RigidBody, family: SweepFamily, motion: PlanarMotion) -> Poles | None:
    """Return the second derivatives at the poles if every member is smooth there, else None."""
    with ctx.workprec(REDUCTION_BITS):
        for member in family.members:
            if not make_loop(body, member.potential, motion).is_smooth_at_poles():
                return None
    hessians = np.stack([member.potential.hessian(POLES) for member in family.members])
    hessians[1:] -= hessians[0]
    return Poles(hessians)


def _member(body: RigidBody, document: Part) -> Member:
    potential = potential_of(document, body)
    return Member(potential, decide(body, potential))


def _is_linear_in(document: Mapping[str, object], path: Path) -> bool:
    """Tell whether the path is that of a parameter or a coefficient; a formula is looked at besides."""
    match (document.get("type"), path):
        case ("expression", ("parameters", _)):
            return True
        case ("gravity", (("a" | "b" | "c"),)):
            return True
        case (("rational" | "homogeneous") as kind, (name, _)):
            return name in _LISTS[kind]
    return False


def _is_affine(document: Mapping[str, object], paths: Sequence[Path]) -> bool:
    if document.get("type") != "expression":
        return True
    names = {path[-1] for path in paths}
    try:
        return degree_in(parse(str(document.get("expression"))), names) <= 1
    except FormulaError:
        return False


def has_symbol(document: Mapping[str, object], name: str) -> bool:
    """Tell whether a potential's formula has a symbol; it does as far as nobody can tell."""
    if document.get("type") != "expression":
        return document.get("type") not in ("gravity", *_LISTS)
    try:
        return degree_in(parse(str(document.get("expression"))), {name}) > 0
    except FormulaError:
        return True


def degree_in(tree: Tree, names: set[str]) -> int:
    """Return a bound of the degree in the symbols ``names``: 0, 1, or more as 2."""

    def degree(_: int, node: Tree, below: Sequence[int]) -> int:
        if isinstance(node, Symbol):
            return int(node.name in names)
        if isinstance(node, Negation):
            return below[0]
        if isinstance(node, Call):
            return _MORE if below[0] else 0
        if isinstance(node, Binary):
            left, right = below
            if node.operator in "+-":
                return max(left, right)
            if node.operator == "*":
                return min(left + right, _MORE)
            if node.operator == "/":
                return _MORE if right else left
            return _MORE if left or right else 0
        return 0

    return fold_tree(tree, degree)


ENERGY_BITS = 110
"""A ball of this relative accuracy has lost no more than 50 bits by cancellation."""
CANCELLED_ENERGY_SHARE = 2.0**-30
"""Share of the parameters below which an energy is the rest of a cancellation."""


@dataclass(frozen=True, slots=True)
class Energies:
    """h = h_0 + Σ p_k h_k on every curve, as a function of λ²."""

    tapes: tuple[Tape, ...]
    """h_0 and h_0 + h_k, in nu if A = 2C, else in λ."""
    in_nu: bool
    sign: int
    """Sign of nu."""

    def terms(self, lambda_squared: fmpq) -> tuple[arb, ...]:
        """Return h_0 and the h_k, at the current precision."""
        balls, square = BallAlgebra(), arb(lambda_squared)
        variable = square * self.sign if self.in_nu else square.sqrt()
        origin, *units = (tape.evaluate(balls, (variable,)) for tape in self.tapes)
        return (origin, *(unit - origin for unit in units))

    def rounded(
        self, parameters: Sequence[Sequence[fmpq]], lambdas_squared: Sequence[fmpq]
    ) -> list[tuple[float, float]]:
        """Return the energy of each point and the bound of its error as a job has them; NaN if in doubt."""
        known: dict[tuple[int, int], tuple[arb, ...]] = {}
        energies: list[tuple[float, float]] = []
        with ctx.workprec(REDUCTION_BITS):
            for row, square in zip(parameters, lambdas_squared, strict=True):
                key = int(square.p), int(square.q)
                terms = known.get(key)
                if terms is None:
                    terms = known[key] = self.terms(square)
                total = terms[0]
                for p, term in zip(row, terms[1:], strict=True):
                    total = total + arb(p) * term
                energies.append(rounded(total, float(arb(max(map(abs, row), default=fmpq(0))))))
        return energies


def energies_of(body: RigidBody, family: SweepFamily, motion: PlanarMotion) -> Energies | None:
    """Return the energies on the quadrant of ``motion``, None if a member's energy has no formula."""
    in_nu = body.A == 2 * body.C
    quadrant = _quadrant(motion)
    texts = [_formula(member.verdict, quadrant) for member in family.members]
    if any(text is None for text in texts):
        return None
    name = "nu" if in_nu else "lambda"
    tapes = tuple(compile_tape(parse(str(text)), (name,)) for text in texts)
    return Energies(tapes, in_nu, motion.sign_of_g1)


def _quadrant(motion: PlanarMotion) -> Quadrant:
    if motion.sign_of_g1 > 0:
        return "pp" if motion.g3_sign > 0 else "pm"
    return "mp" if motion.g3_sign > 0 else "mm"


def _formula(verdict: Verdict, quadrant: Quadrant) -> str | None:
    if verdict.energy_formula is not None or verdict.energy_formulas is None:
        return verdict.energy_formula
    return verdict.energy_formulas.get(quadrant)


def rounded(energy: arb, scale: float) -> tuple[float, float]:
    """Return an energy and the bound of its error as a job has them; NaN if in doubt.

    ``scale`` is the size of what it is the rest of.
    """
    if energy.is_zero():
        # A job's ball has 0 in it; how wide it is, is told by no formula.
        return 0.0, math.nan
    if not energy.is_finite() or energy.rel_accuracy_bits() < ENERGY_BITS:
        return math.nan, math.nan
    value = _one_double(energy)
    if not abs(value) > CANCELLED_ENERGY_SHARE * scale:
        return math.nan, math.nan
    # Of an exact double only the rest of the job's own ball is left.
    return value, math.nextafter(_one_double(abs(energy - value)), math.inf)


def _one_double(ball: arb) -> float:
    """Return the double that the whole ball rounds to, NaN if there are two."""
    low, high = float(ball.lower()), float(ball.upper())
    return low if low == high else math.nan
