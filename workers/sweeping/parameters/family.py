"""Proves all potentials of a sweep at once: linear in the parameters, so admissible if the terms are.

The compatibility operator L is linear in V. Where V = V_0 + Σ p_k V_k is affine
in the numbers p_k that a sweep varies, L(V_0) = 0 and L(V_0 + V_k) = 0 for every
k make L(V) = 0 for all p, and the energies add up in the same way. A formula is
seen to be affine in parameters by its tree; the families of the catalogue are in
their coefficients. Whatever is not proved so is decided point by point.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from flint import ctx
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.errors import FormulaError
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tree import Binary, Call, Negation, Symbol, Tree, fold_tree
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import make_loop
from service.dynamics.reduction.windows import REDUCTION_BITS
from service.dynamics.verdict.verdict import Verdict, decide
from service.schemas.problem.potentials import MODELS
from service.schemas.reading.pointers import with_values

FloatArray = NDArray[np.float64]
Path = tuple[str, ...]

POLES = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
CANCELLATION = 2.0
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


def potential_of(body: RigidBody, document: object) -> Potential:
    """Return the potential of a document; raises what its family raises, or ValueError for its form."""
    kind = document.get("type") if isinstance(document, dict) else None
    return MODELS[str(kind)].model_validate(document).to_domain(body)


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
        plain: NDArray[np.bool_] = np.abs(weights) @ sizes <= CANCELLATION * (1.0 + whole)
        return plain


def smooth_poles(body: RigidBody, family: SweepFamily, motion: PlanarMotion) -> Poles | None:
    """Return the second derivatives at the poles if every member is smooth there, else None."""
    with ctx.workprec(REDUCTION_BITS):
        for member in family.members:
            if not make_loop(body, member.potential, motion).is_smooth_at_poles():
                return None
    found = np.stack([member.potential.hessian(POLES) for member in family.members])
    found[1:] -= found[0]
    return Poles(found)


def _member(body: RigidBody, document: object) -> Member:
    potential = potential_of(body, document)
    return Member(potential, decide(body, potential))


def _is_linear_in(document: Mapping[str, object], path: Path) -> bool:
    """Tell whether the place is that of a parameter or a coefficient; a formula is looked at besides."""
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
