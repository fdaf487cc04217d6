r"""The energy: a sum of powers of λ in each octant, from the H of a proof; −F(w) of general potentials.

H is constant on the curves, so once it is cancelled down it is a sum of terms
c g1^a g3^b with a A + b C = 0, without g2 and rho. On |g3| = λ |g1|^(C/A) the
absolute value of such a term is |c| λ^b.

The sums of all octants are then written as one formula h(λ), or h(nu) with λ² = |nu| for A = 2C.

The proof that H[V1[F] + Q G(g2)] = −F(w), for all F and G at once. With
T = Q/(C ρ), ρ = g1² + g3², dT = −(α − 1) dz/(1 + z)² and T = (α + z)/(1 + z),
V1 = T ∫ F(w) dτ/τ² up to τ = T at fixed ρ, and D is the derivative by the turn,
which leaves ρ and g2 alone and changes Q at the rate D Q = −2(A − C) g1 g3:

* D V1 = (D T / T)(V1 + F(w)) = −2(A − C) g1 g3 (V1 + F(w))/Q, so H[V1] = V1 − (V1 + F(w)) = −F(w);
* D(Q G) = −2(A − C) g1 g3 G, so H[Q G] = Q G − Q G = 0.

w is constant on the curves |g3| = λ |g1|^{C/A}, hence so is H, and L(V) = 0.
"""

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from itertools import product
from types import MappingProxyType

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.equations.compatibility import energy_on_curve
from service.dynamics.errors import FormulaError
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.monomials import as_fraction
from service.dynamics.formula.parameters import PI, bind
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.formula.tree import (
    MAX_BITS,
    Binary,
    Call,
    Negation,
    Symbol,
    Tree,
    exact_tree,
    fold_tree,
    format_tree,
    post_order,
)
from service.dynamics.potentials.angular_part.balls import curve_ball
from service.dynamics.potentials.families.general_solution import QUADRANTS, SIGNS, GeneralPotential, Quadrant
from service.dynamics.potentials.potential import Potential
from service.dynamics.verdict.exact_ring.generators import (
    CircleConstant,
    Coordinate,
    Cosine,
    CosineOfTurn,
    Divisor,
    Element,
    Exponential,
    Logarithm,
    Root,
    Sine,
)
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.proofs.proof import EnergyInOctant, Proof, Signs
from service.dynamics.verdict.sphere.boxes import Point, sphere_points

EnergyTerms = dict[tuple[Fraction, str], Fraction]
"""Coefficients c of the terms c · constant · λ^b, by (b, constant as text, empty for 1)."""


def energy_terms(body: RigidBody, proof: Proof) -> dict[Signs, EnergyTerms | None]:
    """Return the terms in each octant where V can have a value; None where H is not a sum of such terms."""
    found: dict[Signs, EnergyTerms | None] = {}
    octants = {energy.signs: energy for energy in proof.octants}
    for signs in product((1, -1), repeat=3):
        computed = tuple(s if i in proof.sign_dependent else 1 for i, s in enumerate(signs))
        energy = octants.get((computed[0], computed[1], computed[2]))
        if energy is not None:
            flipped = {i for i in range(3) if signs[i] != computed[i]}
            found[signs[0], signs[1], signs[2]] = _terms(body, energy, flipped)
    return found


def _terms(body: RigidBody, energy: EnergyInOctant, flipped: set[int]) -> EnergyTerms | None:
    """Return the terms of H, where the signs of the coordinates ``flipped`` are opposite to the ring's."""
    ring, terms = energy.ring, EnergyTerms()
    for monomial, coefficient in energy.H.numerator.terms():
        value, weight, power, constants = as_fraction(coefficient), Fraction(0), Fraction(0), []
        for index, (low, shift) in enumerate(zip(monomial, energy.H.shift, strict=True)):
            exponent = int(low) + shift
            if exponent == 0:
                continue
            nature = ring.natures[index]
            if isinstance(nature, Coordinate) and nature.position != 1:
                # An element whose sign does not matter to the ring has degree 1.
                value *= -1 if exponent % 2 and nature.position in flipped else 1
                moment = body.A if nature.position == 0 else body.C
                weight += moment * Fraction(exponent, nature.degree)
                power += Fraction(exponent, nature.degree) if nature.position == 2 else 0
            else:
                text = _constant_text(ring, index, exponent)
                if text is None:
                    return None
                constants.append(text)
        if weight != 0 or max(value.numerator.bit_length(), value.denominator.bit_length()) > MAX_BITS:
            return None
        key = (power, "*".join(constants))
        terms[key] = terms.get(key, Fraction(0)) + value
    return {key: value for key, value in terms.items() if value}


def _number_text(ring: Ring, element: Element) -> str | None:
    """Return an element without coordinates as text, None if it has some."""
    parts = []
    for monomial, coefficient in element.numerator.terms():
        constants = []
        for index, (low, shift) in enumerate(zip(monomial, element.shift, strict=True)):
            if int(low) + shift:
                text = _constant_text(ring, index, int(low) + shift)
                if text is None:
                    return None
                constants.append(text)
        parts.append(term_text(as_fraction(coefficient), *constants))
    return sum_text(parts)


def _constant_text(ring: Ring, index: int, exponent: int) -> str | None:
    """Return a power of a generator that is a number as text, None if it is not one."""
    match ring.natures[index]:
        case CircleConstant(degree):
            return power_text("pi", Fraction(exponent, degree))
        case CosineOfTurn(order):
            return power_text(f"(2*cos({Fraction(2, order)}*pi))", Fraction(exponent))
        case Exponential(argument, degree):
            text = _number_text(ring, argument)
            return None if text is None else f"exp({term_text(Fraction(exponent, degree), f'({text})')})"
        case Root(base, degree):
            text = str(base.numerator) if base.is_number else _in_brackets(_number_text(ring, base))
            return None if text is None else power_text(text, Fraction(exponent, degree))
        case Divisor(base):
            text = _in_brackets(_number_text(ring, base))
        case Logarithm(argument):
            text = _in_brackets(_number_text(ring, argument), "log")
        case Sine(argument):
            text = _in_brackets(_number_text(ring, argument), "sin")
        case Cosine(argument):
            text = _in_brackets(_number_text(ring, argument), "cos")
        case Coordinate():
            return None
    return None if text is None else power_text(text, Fraction(exponent))


def _in_brackets(text: str | None, function: str = "") -> str | None:
    return None if text is None else f"{function}({text})"


def power_text(base: str, exponent: Fraction) -> str:
    """Return base^exponent as text, empty for the exponent 0."""
    if exponent == 0:
        return ""
    return base if exponent == 1 else f"{base}^({exponent})"


def term_text(coefficient: Fraction, *factors: str) -> str:
    """Return coefficient · factors as text; empty factors are 1."""
    text = "*".join(factor for factor in factors if factor)
    if not text:
        return str(coefficient)
    if abs(coefficient) == 1:
        return text if coefficient > 0 else f"-{text}"
    return f"{coefficient}*{text}"


def sum_text(parts: Iterable[str]) -> str:
    """Return the parts joined, their leading signs made operators; 0 if there are none."""
    text = " + ".join(parts).replace("+ -", "- ")
    return text or "0"


_CHECK_BITS = 128
_CHECK_POINTS = 16
OctantTerms = Mapping[Signs, EnergyTerms | None]
"""The terms of the energy by the signs of g1, g2, g3; None where it is no sum of such terms."""
NO_NAMES: Mapping[str, Fraction] = MappingProxyType({})


def formula_of(
    body: RigidBody, potential: Potential, octants: OctantTerms, names: Mapping[str, Fraction] = NO_NAMES
) -> str | None:
    """Return h as a formula in ``lambda``, in ``nu`` if A = 2C, or None if it has none.

    It is found from the terms of the energy in every octant, whose constants may hold ``names``, and holds
    on every curve on which V is defined, whatever the signs of g1 and g3; an energy that depends on those
    signs otherwise than through nu has no formula. What is returned agrees with H in balls at sample points.
    """
    has_nu = body.A == 2 * body.C
    by_sign: dict[int, EnergyTerms] = {}
    for signs, terms in octants.items():
        sign = signs[0] if has_nu else 1
        if terms is None or by_sign.setdefault(sign, terms) != terms:
            return None
    return _confirmed(body, potential, _text(body, by_sign), names) if by_sign else None


def signed_formulas_of(
    body: RigidBody, potential: Potential, octants: OctantTerms, names: Mapping[str, Fraction] = NO_NAMES
) -> dict[Quadrant, str] | None:
    """Return h on each quadrant where V is defined, as :func:`formula_of` does for all of them.

    None if a quadrant has no formula, or none has V.
    """
    texts: dict[Quadrant, str] = {}
    for quadrant, (first, third) in SIGNS.items():
        found = [octants[signs] for s in (1, -1) if (signs := (first, s, third)) in octants]
        if not found:
            continue
        terms = found[0]
        if terms is None or terms != found[-1]:
            return None
        text = _text(body, {first if body.A == 2 * body.C else 1: terms})
        confirmed = _confirmed(body, potential, text, names, (first, third))
        if confirmed is None:
            return None
        texts[quadrant] = confirmed
    return texts or None


def _text(body: RigidBody, by_sign: dict[int, EnergyTerms]) -> str:
    if body.A == 2 * body.C:
        return _text_in_nu(by_sign)
    return sum_text(
        term_text(c, text, power_text("lambda", power)) for (power, text), c in by_sign[1].items()
    )


def _confirmed(
    body: RigidBody,
    potential: Potential,
    text: str,
    names: Mapping[str, Fraction],
    quadrant: tuple[int, int] | None = None,
) -> str | None:
    """Return the formula as printed, or None if it exceeds the limits or disagrees with balls of H."""
    curve = ("nu" if body.A == 2 * body.C else "lambda",)
    try:
        tree = parse(text)
        tape = compile_tape(bind(tree, names, variables=curve), curve)
    except FormulaError:
        return None
    return format_tree(tree) if _agrees(body, potential, tape, quadrant) else None


def _text_in_nu(by_sign: dict[int, EnergyTerms]) -> str:
    """Return the sum in nu, whose sign is that of g1; the terms are in λ = |nu|^(1/2)."""
    parts: list[str] = []
    plus, minus = by_sign.get(1), by_sign.get(-1)
    for key in dict.fromkeys((*(plus or {}), *(minus or {}))):
        k = key[0] / 2
        # Where V is defined for one sign of g1 only, a whole power of nu is the simplest continuation.
        mirror = -1 if _has_parity(k, 1) else 1
        above = minus[key] * mirror if minus and plus is None else (plus or {}).get(key, Fraction(0))
        below = plus[key] * mirror if plus and minus is None else (minus or {}).get(key, Fraction(0))
        if above + below:
            base = "nu" if _has_parity(k, 0) else "abs(nu)"
            parts.append(term_text((above + below) / 2, key[1], power_text(base, k)))
        if above - below:
            signed = power_text("nu", k) if _has_parity(k, 1) else f"nu*{power_text('abs(nu)', k - 1)}"
            parts.append(term_text((above - below) / 2, key[1], signed))
    return sum_text(parts)


def _has_parity(k: Fraction, parity: int) -> bool:
    return k.denominator == 1 and k.numerator % 2 == parity


def _agrees(body: RigidBody, potential: Potential, formula: Tape, quadrant: tuple[int, int] | None) -> bool:
    """Tell whether the formula's balls meet those of H at the sample points where V is defined, at least one.

    Only points of the ``quadrant``, signs of g1 and g3, are taken if one is given.
    """
    in_nu = body.A == 2 * body.C
    balls = BallAlgebra()
    confirmed = 0
    with ctx.workprec(_CHECK_BITS):
        for point in sphere_points():
            if confirmed == _CHECK_POINTS:
                break
            if quadrant is not None and (point[0] * quadrant[0] < 0 or point[2] * quadrant[1] < 0):
                continue
            g1, g2, g3 = (balls.constant(coordinate) for coordinate in point)
            H = potential.H_ball(body, g1, g2, g3)
            if not H.is_finite():
                continue
            curve = g3 * g3 / g1 if in_nu else abs(g3) / balls.power(abs(g1), body.C / body.A)
            h = formula.evaluate(balls, (curve,))
            if not (h.is_finite() and h.overlaps(H)):
                return False
            confirmed += 1
    return confirmed > 0


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
