r"""Formulas of general potentials: V1[F] is one where F is a sum of certain powers of w.

The terms of the families solve the same equation as V1 (H. M. Yehia's last formula), and the energies of B_n
and C_n are multiples of one power of w each,

.. math:: \alpha m = n + 1:\ B_n, \qquad m = -(n + 1):\ C_n, \qquad m = 0:\ V = -1.

A multiple P of the term has the energy −w^m, as V1[w^m] has; the difference is Q times a function of g2. The
logarithms that stand for B_n and C_n where these have no value are left to the integral, which is as quick
and as exact through the poles, where no bound encloses them. P and Q are homogeneous, P of the degree
d = 2(α − 1)m in g1 and g3, and V1 vanishes in the direction φ0. Hence

.. math:: V_1[w^m] = P - Q\,\rho^{d/2-1}\,\frac{P_0}{Q_0}, \qquad P_0, Q_0 = P, Q
          \text{ at } (\cos\varphi_0, \sin\varphi_0), \qquad \rho = g_1^2 + g_3^2.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce

from service.dynamics.body import RigidBody
from service.dynamics.errors import FormulaError
from service.dynamics.formula.algebras.monomials import weighted_sum
from service.dynamics.formula.algebras.power_sums import PowerAlgebra, Small
from service.dynamics.formula.algebras.power_sums import PowerSum as SumOfPowers
from service.dynamics.formula.parameters import PI
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import Tape
from service.dynamics.formula.tree import (
    FUNCTIONS,
    Binary,
    Call,
    FunctionName,
    Negation,
    Number,
    Symbol,
    Tree,
    exact_tree,
    fold_power,
)
from service.dynamics.identity_cache import IdentityCache
from service.dynamics.potentials.families.coefficients import B_term, C_term, energy_of_B, energy_of_C
from service.dynamics.potentials.families.general_solution import FAMILY, GeneralPotential
from service.dynamics.potentials.potential import FormulaPotential, Potential
from service.dynamics.potentials.terms import PowerSum, monomial_sum, multiplicity, power_terms, scaled, total

QUARTER = parse("pi/4")
"""The reference angle at which powers of the cosine and the sine are the same."""
MAX_TERMS = 8
"""Largest number of terms: those of longer sums cancel next to a pole."""
ZERO, HALF = Fraction(0), Fraction(1, 2)


SIGNED: tuple[tuple[tuple[str, ...], tuple[int, int, int, int]], ...] = (
    ((), (1, 1, 1, 1)),
    (("g1",), (1, -1, 1, -1)),
    (("g3",), (1, 1, -1, -1)),
    (("g1", "g3"), (1, -1, -1, 1)),
)
"""Products of signs of variables, and their values on QUADRANTS: what differs there is a sum of four."""


def _formula_of(potential: GeneralPotential) -> FormulaPotential | None:
    """Return the same potential by its formula; None where V1 is known as an integral only."""
    pieces = potential.pieces
    known = {id(piece): _powers_of(piece.angular.F.tape) for piece in pieces}
    powers = [known[id(piece)] for piece in pieces]
    exponents = dict.fromkeys(m for each in powers for m in each or ())
    body = pieces[0].angular.body
    terms = {m: _term(body, m) for m in exponents}
    if None in powers or None in terms.values():
        return None
    parts = list[Tree]()
    for names, signs in SIGNED:
        G = _share([piece.G for piece in pieces], signs)
        weights = {m: _share([(each or {}).get(m, ZERO) for each in powers], signs) for m in exponents}
        found = [(term, weights[m]) for m, term in terms.items() if term is not None and weights[m] != ZERO]
        if found or G != ZERO:
            sign = [Binary("/", Symbol(name), Call("abs", Symbol(name))) for name in names]
            parts.append(_product(_tree_of(body, found, G, potential.reference_angle), sign))
    try:
        return Potential.from_tree(total(parts), FAMILY)
    except FormulaError:
        return None


formula_of = IdentityCache(_formula_of)


def _share(values: Sequence[Tree | Fraction], signs: Sequence[int]) -> Tree | Fraction:
    """Return Σ sign · value / 4."""
    values = [value.value if isinstance(value, Number) else value for value in values]
    if all(value == values[0] for value in values):
        return values[0] if all(sign > 0 for sign in signs) else ZERO
    exact = sum((sign * x for sign, x in zip(signs, values, strict=True) if isinstance(x, Fraction)), ZERO)
    trees = [
        scaled(Fraction(s, 4), [x]) for s, x in zip(signs, values, strict=True) if not isinstance(x, Fraction)
    ]
    return total([*trees, exact_tree(exact / 4)]) if trees else exact / 4


def _tree_of(
    body: RigidBody, weighted: Sequence[tuple["_Term", Tree | Fraction]], G: Tree | Fraction, angle: Tree
) -> Tree:
    terms, shares = list[Tree](), [] if G == ZERO else [exact_tree(G) if isinstance(G, Fraction) else G]
    at_angle = _squares(angle)
    for term, weight in weighted:
        exact, factors = Fraction(1), list[Tree]()
        for factor in (weight, term.scale):
            if isinstance(factor, Fraction):
                exact *= factor
            else:
                factors.append(factor)
        terms.append(_product(total(term.parts(exact)), factors))
        if term.degree != 2:
            rho = monomial_sum({(2, 0, 0): Fraction(1), (0, 0, 2): Fraction(1)})
            factors.append(Binary("^", rho, exact_tree(term.degree / 2 - 1)))
        if at_angle is None:
            share = _product(term.at_quarter(-2 * exact / (body.A + body.C)), factors)
        else:
            share = Binary("/", _product(total(term.at(at_angle, -exact)), factors), _Q(body, *at_angle))
        shares.append(share)
    squares = [Binary("^", Symbol(name), exact_tree(Fraction(2))) for name in ("g1", "g3")]
    return total([*terms, Binary("*", _Q(body, *squares), total(shares))])


def _Q(body: RigidBody, first: Tree, third: Tree) -> Tree:
    return Binary("+", scaled(body.A, [first]), scaled(body.C, [third]))


def _squares(angle: Tree) -> tuple[Tree, Tree] | None:
    """Return g1² and g3² in the direction of an angle, for ρ = 1; None where both are 1/2."""
    two = exact_tree(Fraction(2))
    at = Binary("^", Call("cos", angle), two), Binary("^", Call("sin", angle), two)
    return None if angle == QUARTER else at


def _product(tree: Tree, factors: Sequence[Tree]) -> Tree:
    return reduce(lambda left, right: Binary("*", left, right), factors, tree)


@dataclass(frozen=True, slots=True)
class _Term:
    """P = scale · powers, of which H is −w^m."""

    degree: Fraction
    """d, of P in g1 and g3 together."""
    scale: Tree | Fraction
    powers: PowerSum

    def parts(self, weight: Fraction) -> list[Tree]:
        """Return the terms of weight · P / scale."""
        return power_terms(weighted_sum([(weight, self.powers)]))

    def at(self, squares: tuple[Tree, Tree], weight: Fraction) -> list[Tree]:
        """Return the same where g1² and g3² are ``squares``, for ρ = 1."""
        return [
            scaled(
                weight * factor,
                [Binary("^", x, exact_tree(e / 2)) for x, e in zip(squares, exponents, strict=True) if e],
            )
            for exponents, factor in self.powers.items()
        ]

    def at_quarter(self, weight: Fraction) -> Tree:
        """Return the same where g1² = g3² = 1/2."""
        number, root = weight * sum(self.powers.values()), fold_power(HALF, self.degree / 2)
        power = [Binary("^", exact_tree(HALF), exact_tree(self.degree / 2))] if root is None else []
        return scaled(number * (1 if root is None else root), power)


def _term(body: RigidBody, m: Fraction) -> _Term | None:
    """Return the term with H = −w^m; None where no family has one."""
    alpha, gap = body.alpha, abs(body.A - body.C)
    if m == 0:
        return _Term(Fraction(0), Fraction(1), {(Fraction(0), Fraction(0)): Fraction(-1)})
    N = max(alpha * m, -m)
    if N.denominator != 1 or not 1 <= N <= MAX_TERMS:
        return None
    degree, n = 2 * (alpha - 1) * m, N.numerator - 1
    if (alpha > 1) == (m > 0) and multiplicity(alpha, n) is not None:
        return None
    energy = energy_of_B(alpha, n) if m > 0 else energy_of_C(alpha, n)
    powers = B_term(alpha, n) if m > 0 else C_term(alpha, n)
    known = fold_power(gap, degree / 2)
    scale = Binary("^", exact_tree(gap), exact_tree(degree / 2)) if known is None else known
    return _Term(degree, scale, weighted_sum([(-1 / energy, powers)]))


def _powers_of(F: Tape) -> Mapping[Fraction, Tree | Fraction] | None:
    """Return the coefficients of F by the exponents of w; None if it is no sum of powers."""
    w: Small[Tree] = Small(Symbol("w"), 1, 1)
    algebra = PowerAlgebra(_Trees(), w)
    found = F.evaluate(algebra, (SumOfPowers({(Fraction(1), 0): Fraction(1)}),))
    # A function of w that is no power has been asked for its value.
    return None if algebra.powers else {power[0]: factor for power, factor in found.terms.items()}


class _Trees:
    """The algebra of trees, of which nothing is computed."""

    def constant(self, value: Fraction) -> Tree:
        return exact_tree(value)

    def pi(self) -> Tree:
        return Symbol(PI)

    def add(self, left: Tree, right: Tree) -> Tree:
        return Binary("+", left, right)

    def subtract(self, left: Tree, right: Tree) -> Tree:
        return Binary("-", left, right)

    def multiply(self, left: Tree, right: Tree) -> Tree:
        return Binary("*", left, right)

    def divide(self, left: Tree, right: Tree) -> Tree:
        return Binary("/", left, right)

    def negate(self, operand: Tree) -> Tree:
        return Negation(operand)

    def power(self, base: Tree, exponent: Fraction) -> Tree:
        return Binary("^", base, exact_tree(exponent))

    def general_power(self, base: Tree, exponent: Tree) -> Tree:
        return Binary("^", base, exponent)

    def call(self, name: str, argument: Tree) -> Tree:
        return Call(_FUNCTIONS[name], argument)


_FUNCTIONS: Mapping[str, FunctionName] = {name: name for name in FUNCTIONS}
