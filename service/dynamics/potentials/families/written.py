"""Potentials of a client's formulas: V itself, or F and G of the general family, V = V1[F] + Q G(g2)."""

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError, FormulaError
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parameters import (
    ParameterNameError,
    bind,
    bound_formula,
    require_parameter_names,
)
from service.dynamics.formula.parser import LocatedTree, parse, parse_located
from service.dynamics.formula.rewriting import known_at_poles
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.formula.tree import Binary, Symbol, Tree, exact_tree, format_tree, post_order
from service.dynamics.potentials.angular_part.balls import CurveFunction
from service.dynamics.potentials.angular_part.field import AngularField
from service.dynamics.potentials.families.general_solution import (
    FAMILY,
    QUADRANTS,
    GeneralPotential,
    Piece,
    Quadrant,
)
from service.dynamics.potentials.potential import FormulaPotential, Potential

EXPRESSION_POINTER = "/potential/expression"
FORMULAS_CACHED = 64
"""Formulas that are remembered with their parameters and moments: lists and sweeps ask for the same ones."""


def expression_potential(text: str, parameters: Mapping[str, Fraction], body: RigidBody) -> Potential:
    """Return the potential of a formula in g1, g2, g3, the parameters and the moments A, B, C.

    Raises
    ------
    FormulaError
        The text is not a formula, is too large, has an unknown name or a
        constant without a value; the pointer is EXPRESSION_POINTER.
    ParameterNameError
        A parameter cannot have its name.
    MissingMomentError
        The formula has B, and the body does not.
    """
    require_parameter_names(parameters)
    try:
        return _made(text, tuple(parameters.items()), body).alone()
    except FormulaError as error:
        raise error.at(pointer=EXPRESSION_POINTER) from error


@lru_cache(maxsize=FORMULAS_CACHED)
def _made(text: str, parameters: tuple[tuple[str, Fraction], ...], body: RigidBody) -> FormulaPotential:
    numbers = {"A": body.A, "B": body.B, "C": body.C, **dict(parameters)}

    def symbol(name: str) -> Tree:
        number = numbers.get(name)
        return Symbol(name) if number is None else exact_tree(number)

    try:
        return Potential.from_tree(parse(text, symbol), "expression")
    except FormulaError:
        # Where it is at fault is not known of a formula whose names are numbers already.
        located = parse_located(text)
        constants = dict(parameters) | _moments(located, body)
        bind(located.tree, constants, positions=located.positions)
        raise


def _moments(located: LocatedTree, body: RigidBody) -> dict[str, Fraction]:
    """Return the moments that are known, insisting on B where the formula has it."""
    moments = {"A": body.A, "C": body.C}
    if any(isinstance(node, Symbol) and node.name == "B" for node in post_order(located.tree)):
        moments["B"] = body.require_B("the formula")
    elif body.B is not None:
        moments["B"] = body.B
    return moments


FormulaText = str | Mapping[Quadrant, str]
"""One formula for all quadrants, or one for each."""
_ANGLE_BITS = 128


class QuadrantError(DynamicsError):
    """Formulas for something else than the four quadrants."""

    code = "quadrants"


class ReferenceAngleError(DynamicsError):
    """A reference angle that is not strictly between 0 and π/2."""

    code = "reference_angle"


def general_potential(
    body: RigidBody,
    F: FormulaText,
    G: FormulaText,
    parameters: Mapping[str, Fraction],
    reference_angle: str = "pi/4",
) -> GeneralPotential:
    """Return V1[F] + Q G of formulas F in ``w`` and G in ``g2``, the parameters, pi, A, B and C.

    ``reference_angle`` is a formula without variables for φ0, the angle
    arctan |g3/g1| at which V1 = 0. It is strictly between 0 and π/2: at the
    ends V1 would exist for some F only, and it exists for all of them from any
    angle between. Another one changes V by Q times an even function of g2.

    Raises
    ------
    EqualMomentsError
        A = C.
    FormulaError, MissingMomentError
        As for expression_potential; the pointer is /potential/F, /potential/G
        (with the quadrant, if there is one) or /potential/reference_angle.
    ParameterNameError
        A parameter cannot have its name.
    QuadrantError
        A mapping is not of the four quadrants.
    ReferenceAngleError
        The angle is undefined, or not strictly between 0 and π/2.
    """
    body.require_planar()
    _require_names(parameters)
    angle = bound_formula(reference_angle, (), parameters, body, "/potential/reference_angle")
    angle_tape = _angle_tape(angle)
    pieces: dict[tuple[str, str], Piece] = {}
    chosen = []
    for quadrant in QUADRANTS:
        texts = _text(F, "F", quadrant), _text(G, "G", quadrant)
        if texts not in pieces:
            pointers = _pointer(F, "F", quadrant), _pointer(G, "G", quadrant)
            F_tree = bound_formula(texts[0], ("w",), parameters, body, pointers[0])
            G_tree = bound_formula(texts[1], ("g2",), parameters, body, pointers[1])
            pieces[texts] = _piece(body, F_tree, G_tree, angle_tape)
        chosen.append(pieces[texts])
    return GeneralPotential((chosen[0], chosen[1], chosen[2], chosen[3]), angle)


def _piece(body: RigidBody, F: Tree, G: Tree, angle: Tape) -> Piece:
    moments = [
        Binary("*", exact_tree(moment), Binary("^", Symbol(name), exact_tree(Fraction(2))))
        for moment, name in ((body.A, "g1"), (body.C, "g3"))
    ]
    even = Potential.from_tree(Binary("*", Binary("+", moments[0], moments[1]), G), FAMILY)
    even = replace(even, tape=known_at_poles(even.tape))
    function = CurveFunction(compile_tape(F, ("w",)))
    return Piece(AngularField(RigidBody(body.A, None, body.C), function, angle), even, F, G)


def _require_names(parameters: Mapping[str, Fraction]) -> None:
    require_parameter_names(parameters)
    if "w" in parameters:
        raise ParameterNameError(
            "'w' cannot be a parameter: it has a meaning already", pointer="/potential/parameters/w"
        )


def _text(formula: FormulaText, name: str, quadrant: Quadrant) -> str:
    if isinstance(formula, str):
        return formula
    if set(formula) != set(QUADRANTS):
        raise QuadrantError(
            f"{name} needs one formula, or one for each of {', '.join(QUADRANTS)} (signs of g1 and g3); "
            f"it has {', '.join(sorted(map(str, formula))) or 'none'}",
            pointer=f"/potential/{name}",
        )
    return formula[quadrant]


def _pointer(formula: FormulaText, name: str, quadrant: Quadrant) -> str:
    return f"/potential/{name}" if isinstance(formula, str) else f"/potential/{name}_{quadrant}"


def _angle_tape(angle: Tree) -> Tape:
    tape = compile_tape(angle, ())
    with ctx.workprec(_ANGLE_BITS):
        phi = tape.evaluate(BallAlgebra(), ())
        if not (phi > 0 and phi < arb.pi() / 2):
            raise ReferenceAngleError(
                f"the reference angle {format_tree(angle)} is not strictly between 0 and pi/2",
                pointer="/potential/reference_angle",
            )
    return tape
