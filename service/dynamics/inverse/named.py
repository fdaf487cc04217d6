"""Writes h, F, G and the nearest potential with the names of the client's parameters.

All four are linear in V. A potential Σ factor · part, the factors being products
of parameters, has the sums of what its parts have, if every part is admissible
by itself: then the formulas hold for all values of the parameters, not only for
those that were sent. Each formula is confirmed at these in balls.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction

from service.dynamics.body import RigidBody
from service.dynamics.errors import FormulaError
from service.dynamics.formula.parameters import bind, split_by_parameters
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tree import VARIABLES, Tree, format_tree
from service.dynamics.inverse.decomposition import (
    Decomposition,
    F_formula,
    G_formula,
    energy_in_quadrant,
    is_F_confirmed,
    points_with_values,
)
from service.dynamics.inverse.polynomials import as_polynomial, expand_in_quadrant
from service.dynamics.inverse.projection import Nearest, nearest_expression
from service.dynamics.inverse.section import formula_text, is_G_confirmed
from service.dynamics.potentials.families.general_solution import QUADRANTS, SIGNS, Quadrant
from service.dynamics.potentials.potential import Potential
from service.dynamics.verdict.proofs.energy_terms import (
    EnergyTerms,
    OctantTerms,
    energy_terms,
    energy_text,
    formula_of,
    signed_formulas_of,
    sum_text,
)
from service.dynamics.verdict.proofs.proof import Signs, prove

CURVE_NAMES = frozenset(("lambda", "nu", "w"))
"""Variables of the formulas: a parameter with such a name could not be told from one."""
_FAMILY = "expression"
_MAX_INSTRUCTIONS = 300
"""Instructions of a potential; the parts of a longer one would cost as much again as its verdict."""


@dataclass(frozen=True, slots=True)
class NamedFormulas:
    """The formulas with names, by quadrant (signs of g1 and g3); None where there is no such formula."""

    energy: str | None = None
    energies: Mapping[Quadrant, str] | None = None
    F: Mapping[Quadrant, str | None] | None = None
    G: Mapping[Quadrant, str | None] | None = None


@dataclass(frozen=True, slots=True)
class NamedSum:
    """V = Σ factor · part, with the values of the names in the factors."""

    values: Mapping[str, Fraction]
    parts: tuple[tuple[str, Potential], ...]

    def formulas(self, body: RigidBody, found: Decomposition | None, potential: Potential) -> NamedFormulas:
        """Return what is known of an admissible ``potential``, whose decomposition was ``found``."""
        octants = self._energy_terms(body)
        if octants is None:
            return NamedFormulas()
        energy = formula_of(body, potential, octants, self.values)
        energies = None if energy is not None else signed_formulas_of(body, potential, octants, self.values)
        if found is None:
            return NamedFormulas(energy, energies)
        F = {quadrant: self._F(found, octants, SIGNS[quadrant]) for quadrant in found.F}
        G = {quadrant: self._G(found, SIGNS[quadrant]) for quadrant in found.G}
        return NamedFormulas(energy, energies, F, G)

    def nearest(self, body: RigidBody, nearest: Nearest, potential: Potential) -> str | None:
        """Return the nearest admissible polynomial of ``potential``, which is ``nearest``."""
        del body, potential
        terms: list[str] = []
        for factor, part in self.parts:
            text = nearest_expression(nearest.space, part)
            if text is None:
                return None
            terms.append(_times(factor, text))
        return self._confirmed(
            sum_text(term for term in terms if term),
            VARIABLES,
            lambda tree: _is_same_polynomial(tree, nearest.expression),
        )

    def _energy_terms(self, body: RigidBody) -> OctantTerms | None:
        """Return the terms of the energy, the factors among their constants, if every part is proved."""
        of_parts: list[tuple[str, OctantTerms]] = []
        for factor, part in self.parts:
            proof = prove(body, part.tape)
            if proof is None:
                return None
            of_parts.append((factor, energy_terms(body, proof)))
        common = set.intersection(*(set(terms) for _, terms in of_parts))
        return {signs: _sum_of_terms(of_parts, signs) for signs in common}

    def _F(self, found: Decomposition, octants: OctantTerms, signs: tuple[int, int]) -> str | None:
        energy = energy_in_quadrant(octants, signs)
        text = None if energy is None else F_formula(found.body, energy)
        points = points_with_values(found.potential, signs)
        return self._confirmed(
            text, ("w",), lambda tree: is_F_confirmed(found.body, found.potential, format_tree(tree), points)
        )

    def _G(self, found: Decomposition, signs: tuple[int, int]) -> str | None:
        terms: list[str] = []
        for factor, part in self.parts:
            text = G_formula(found.body, part, expand_in_quadrant(part.tape, *signs), signs)
            if text is None:
                return None
            terms.append(_times(factor, text))
        return self._confirmed(
            sum_text(term for term in terms if term),
            ("g2",),
            lambda tree: is_G_confirmed(found.body, found.potential, format_tree(tree), signs),
        )

    def _confirmed(
        self, text: str | None, variables: tuple[str, ...], is_right: Callable[[Tree], bool]
    ) -> str | None:
        """Return the formula printed anew if it is right with the values of the names put in."""
        printed = None if text is None else formula_text(text)
        if printed is None:
            return None
        try:
            tree = bind(parse(printed), self.values, variables=variables)
        except FormulaError:
            return None
        return printed if is_right(tree) else None


@dataclass(frozen=True, slots=True)
class NamedSolution:
    """F and G as they were stated, quadrant by quadrant, with the moments put in."""

    F: Mapping[Quadrant, Tree]
    G: Mapping[Quadrant, Tree]

    def formulas(self, body: RigidBody, found: Decomposition | None, potential: Potential) -> NamedFormulas:
        """Return what was stated, and h = −F(w)."""
        del found, potential
        F = {quadrant: format_tree(tree) for quadrant, tree in self.F.items()}
        G = {quadrant: format_tree(tree) for quadrant, tree in self.G.items()}
        try:
            energies = {quadrant: energy_text(body, tree) for quadrant, tree in self.F.items()}
        except FormulaError:
            return NamedFormulas(F=F, G=G)
        shared = len(set(energies.values())) == 1
        return NamedFormulas(energies[QUADRANTS[0]] if shared else None, None if shared else energies, F, G)

    def nearest(self, body: RigidBody, nearest: Nearest, potential: Potential) -> str | None:
        """Return None: what is no polynomial has no nearest one."""
        del body, nearest, potential
        return None


Named = NamedSum | NamedSolution


def named_sum(tree: Tree, values: Mapping[str, Fraction]) -> NamedSum | None:
    """Return the parts of a formula whose moments are numbers already; None without parameters to name."""
    if CURVE_NAMES & set(values):
        return None
    parts = split_by_parameters(tree, values)
    if parts is None:
        return None
    try:
        potentials = tuple(
            (part.factor, Potential.from_tree(bind(part.coefficient, {}), _FAMILY)) for part in parts
        )
    except FormulaError:
        return None
    return sum_of_parts(values, potentials)


def sum_of_parts(values: Mapping[str, Fraction], parts: tuple[tuple[str, Potential], ...]) -> NamedSum | None:
    """Return the sum, None if it is none or too long."""
    size = sum(len(part.tape.instructions) for _, part in parts)
    return NamedSum(values, parts) if parts and size <= _MAX_INSTRUCTIONS else None


def _sum_of_terms(of_parts: list[tuple[str, OctantTerms]], signs: Signs) -> EnergyTerms | None:
    total: EnergyTerms = {}
    for factor, octants in of_parts:
        terms = octants[signs]
        if terms is None:
            return None
        total |= {
            (power, "*".join(filter(None, (factor, constant)))): c for (power, constant), c in terms.items()
        }
    return total


def _times(factor: str, text: str) -> str:
    """Return factor · text, empty if it is 0."""
    if text == "0" or not factor:
        return "" if text == "0" else text
    return factor if text == "1" else f"{factor}*({text})"


def _is_same_polynomial(tree: Tree, expression: str) -> bool:
    try:
        ours, theirs = (Potential.from_tree(each, _FAMILY) for each in (tree, parse(expression)))
    except FormulaError:
        return False
    return as_polynomial(ours) == as_polynomial(theirs)
