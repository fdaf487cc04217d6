"""The rules between the parts of a document, also of one that could not be read as a whole.

Each rule looks at as little as it needs, so that a fault elsewhere does not keep it silent.
"""

from collections.abc import Iterator, Mapping
from fractions import Fraction

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.errors import FormulaError, UndefinedConstantError
from service.dynamics.potentials.expression import require_parameter_names
from service.dynamics.potentials.potential import Potential
from service.schemas.faults import Fault, fault_of
from service.schemas.motions import CURVE_FIELDS, curve_faults
from service.schemas.potentials import MAX_PARAMETERS, ExpressionIn, GravityIn, RationalIn
from service.schemas.sections import BodyIn, TimePeriodsIn

_STAND_IN = RigidBody(Fraction(17), Fraction(19), Fraction(23))
"""Moments without simple relations: lets a formula be checked although the body at hand is faulty."""


def read_setting(
    document: object, parts: Mapping[str, object], faults: list[Fault]
) -> tuple[RigidBody | None, Potential | None]:
    """Return body and potential where they can be had; add what speaks against them and the motion."""
    body, potential = None, None
    body_in, potential_in = parts.get("body"), parts.get("potential")
    # Rules between the parts are checked even if no body has the given moments.
    moments = _STAND_IN
    if isinstance(body_in, BodyIn):
        moments = RigidBody(body_in.A, body_in.B, body_in.C, allow_unphysical=True)
        faults += _motion_faults(moments, document, parts)
        try:
            body = body_in.to_domain()
        except DynamicsError as error:
            faults.append(fault_of(error))
    is_exact = isinstance(body_in, BodyIn) and potential_in is not None
    if potential_in is None:
        potential_in = _salvage(document)
    if isinstance(potential_in, ExpressionIn):
        bad = {name: list(_name_faults(name)) for name in potential_in.parameters}
        faults += [fault for found in bad.values() for fault in found]
        good = {name: value for name, value in potential_in.parameters.items() if not bad[name]}
        potential_in = potential_in.model_copy(update={"parameters": good})
    if isinstance(potential_in, ExpressionIn | GravityIn | RationalIn):
        try:
            potential = potential_in.to_domain(moments)
        except DynamicsError as error:
            # With numbers that stand in for unread ones, only the text itself can be judged.
            is_about_text = isinstance(error, FormulaError) and not isinstance(error, UndefinedConstantError)
            if is_exact or is_about_text:
                faults.append(fault_of(error))
    return body, potential


def _salvage(document: object) -> ExpressionIn | None:
    """Return what can still be checked of an expression whose parameters could not be read."""
    match document:
        case {"potential": {"type": "expression", "expression": str(text), **rest}}:
            given = rest.get("parameters")
            names = [str(name) for name in given] if isinstance(given, dict) else []
            if len(names) <= MAX_PARAMETERS:
                stand_ins = dict.fromkeys(names, Fraction(29))
                return ExpressionIn(type="expression", expression=text, parameters=stand_ins)
    return None


def _name_faults(name: str) -> Iterator[Fault]:
    try:
        require_parameter_names({name: Fraction(1)})
    except DynamicsError as error:
        yield fault_of(error)


def _motion_faults(body: RigidBody, document: object, parts: Mapping[str, object]) -> Iterator[Fault]:
    kind = _motion_kind(document)
    if kind == "planar":
        try:
            body.require_planar()
        except DynamicsError as error:
            yield fault_of(error)
        if _is_given(document, "nu") and body.A != 2 * body.C:
            message = f'nu needs A = 2C, and A = {body.A}, C = {body.C}; accepted is "lambda"'
            yield Fault("/motion/nu", "nu_needs_double_moment", message)
    elif kind == "state" and body.B is None:
        yield Fault("/body/B", "missing_moment", "a state motion needs the moment B, which was left out")
    if kind == "planar" and body.B is None and (method := parts.get("method")) in ("integration", "both"):
        yield Fault(
            "/body/B", "missing_moment", f"the method {method} needs the moment B, which was left out"
        )


def combination_faults(document: object, parts: Mapping[str, object]) -> Iterator[Fault]:
    """Yield what is asked of a motion that cannot be had for it."""
    kind, method = _motion_kind(document), parts.get("method")
    if kind == "planar" and "motion" not in parts:
        given = {name for name in CURVE_FIELDS if _is_given(document, name)}
        for field, code, message in curve_faults(given):
            yield Fault(f"/motion/{field}", code, message)
    in_periods = isinstance(parts.get("time"), TimePeriodsIn)
    if kind == "state" and method in ("quadrature", "both"):
        message = f"{method} is for planar motions; accepted for a state are auto and integration"
        yield Fault("/method", "method_needs_planar_motion", message)
    if kind == "state" and in_periods:
        message = 'a state has no known period; accepted are {"start", "stop", "samples"} and {"times"}'
        yield Fault("/time/periods", "period_needed", message)
    if kind == "planar" and method == "integration" and in_periods:
        message = (
            'an integration finds no period; accepted are {"start", "stop", "samples"}, {"times"} '
            "and the methods auto, quadrature and both"
        )
        yield Fault("/time/periods", "period_needed", message)


def _motion_kind(document: object) -> str | None:
    """Return the type of the motion, also of one that could not be read as a whole."""
    match document:
        case {"motion": {"type": str(kind)}}:
            return kind
    return None


def _is_given(document: object, field: str) -> bool:
    match document:
        case {"motion": dict(motion)}:
            return motion.get(field) is not None
    return False
