r"""The energy −F(w) of general potentials: its derivation, a check in balls, and its formula.

The proof that H[V1[F] + Q G(g2)] = −F(w), for all F and G at once. With
T = Q/(C ρ), ρ = g1² + g3², dT = −(α − 1) dz/(1 + z)² and T = (α + z)/(1 + z),
V1 = T ∫ F(w) dτ/τ² up to τ = T at fixed ρ, and D is the derivative by the turn,
which leaves ρ and g2 alone and changes Q at the rate D Q = −2(A − C) g1 g3:

* D V1 = (D T / T)(V1 + F(w)) = −2(A − C) g1 g3 (V1 + F(w))/Q, so H[V1] = V1 − (V1 + F(w)) = −F(w);
* D(Q G) = −2(A − C) g1 g3 G, so H[Q G] = Q G − Q G = 0.

w is constant on the curves |g3| = λ |g1|^{C/A}, hence so is H, and L(V) = 0.
"""

from collections.abc import Sequence
from fractions import Fraction

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.equations.compatibility import energy_on_curve
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.errors import FormulaError
from service.dynamics.formula.parameters import PI
from service.dynamics.formula.parser import parse
from service.dynamics.formula.printer import exact_tree, format_tree
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import Binary, Call, Negation, Symbol, Tree, fold_tree, post_order
from service.dynamics.potentials.angular_part.balls import curve_ball
from service.dynamics.potentials.families.general_solution import QUADRANTS, GeneralPotential, Quadrant
from service.dynamics.verdict.sphere.points import Point

_BITS = 192
_ARC_BITS = 64
"""The arcs are 2^-64 long: the slope over them keeps 128 bits of the 192, and H varies by 2^-64."""


def energy_defect(body: RigidBody, potential: GeneralPotential, point: Point) -> arb:
    """Return a ball that contains H + F(w) at some place of a short arc through ``point``.

    D is enclosed by the slope of V over the arc (the mean value theorem), so
    the values of V alone are tested: if the ball excludes zero, V is not what
    it should be for this body. Not finite where V is not defined.
    """
    balls = BallAlgebra()
    with ctx.workprec(_BITS):
        A, C = balls.constant(body.A), balls.constant(body.C)
        g1, g2, g3 = (balls.constant(coordinate) for coordinate in point)
        angle = arb(2) ** -_ARC_BITS
        arc = angle * arb(0.5, 0.5)
        start, end, along = (_turned(g1, g3, t) for t in (arb(0), angle, arc))
        values = [potential.value_ball(place[0], g2, place[1]) for place in (start, end)]
        slope = (values[1] - values[0]) / angle
        # A gradient along the arc with this slope, D = g1 V_3 - g3 V_1.
        rho = g1 * g1 + g3 * g3
        gradient = (-slope * along[1] / rho, arb(0), slope * along[0] / rho)
        V = potential.value_ball(along[0], g2, along[1])
        H = energy_on_curve(A, C, (along[0], g2, along[1]), V, gradient)
        piece = potential.piece(1 if point[0] > 0 else -1, 1 if point[2] > 0 else -1)
        return H + piece.angular.F.ball(curve_ball(body, along[0], along[1]), 0)[0]


def energy_formulas(body: RigidBody, potential: GeneralPotential) -> dict[Quadrant, str] | None:
    """Return h = −F(w) on each quadrant, in ``lambda``, or in ``nu`` if A = 2C; None if beyond the limits."""
    try:
        texts = [energy_text(body, piece.F) for piece in potential.pieces]
    except FormulaError:
        return None
    return dict(zip(QUADRANTS, texts, strict=True))


def energy_text(body: RigidBody, F: Tree) -> str:
    """Return h = −F(w) in ``lambda``, or in ``nu`` if A = 2C; F may have names of parameters in it."""
    w = _curve_tree(body)

    def build(index: int, node: Tree, operands: Sequence[Tree]) -> Tree:
        if isinstance(node, Symbol):
            return w if node.name == "w" else node
        if isinstance(node, Negation):
            return Negation(operands[0])
        if isinstance(node, Call):
            return Call(node.function, operands[0])
        return Binary(node.operator, operands[0], operands[1]) if isinstance(node, Binary) else node

    value = fold_tree(F, build)
    text = format_tree(value.operand if isinstance(value, Negation) else Negation(value))
    again = parse(text)
    names = {node.name for node in post_order(again) if isinstance(node, Symbol)} - {PI}
    compile_tape(again, sorted(names))
    return text


def _curve_tree(body: RigidBody) -> Tree:
    """Return w = |A − C|^(α−1) λ^(2α); λ² = |nu|, so that it is C nu² for A = 2C."""
    alpha, difference = body.alpha, abs(body.A - body.C)
    if alpha == 2:
        power: Tree = Binary("^", Symbol("nu"), exact_tree(Fraction(2)))
    else:
        power = Binary("^", Symbol("lambda"), exact_tree(2 * alpha))
    if difference == 1:
        return power
    factor = exact_tree(difference)
    return Binary("*", factor if alpha == 2 else Binary("^", factor, exact_tree(alpha - 1)), power)


def _turned(g1: arb, g3: arb, angle: arb) -> tuple[arb, arb]:
    sine, cosine = angle.sin_cos()
    return g1 * cosine - g3 * sine, g1 * sine + g3 * cosine
