"""Puts the parts of a problem document together: rules between them, the problem, its canonical document.

Each rule reads as little as it needs, so that a fault elsewhere, or a part that is unreadable, does not hide
its own.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property
from threading import Lock

from service.dynamics.body import RigidBody
from service.dynamics.classical.catalogue import CASES
from service.dynamics.classical.placement import place
from service.dynamics.errors import DynamicsError
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import ClassicalMotion, PlanarMotion, Problem, StateMotion
from service.schemas.problem.documents import OUTPUTS
from service.schemas.problem.motions import (
    CURVE_FIELDS,
    ClassicalMotionIn,
    PlanarMotionIn,
    StateMotionIn,
    curve_faults,
)
from service.schemas.problem.potentials import MODELS, GeneralIn, GravityIn, PotentialModel
from service.schemas.problem.sections import (
    BodyIn,
    BudgetIn,
    RelativeIn,
    TierIn,
    TimeListIn,
    TimePeriodsIn,
    TimeSpanIn,
    ToleranceIn,
)
from service.schemas.reading.documents import Fault, fault_of

ONE_AT_A_TIME = Lock()
"""Held by whoever computes in balls in a process of many threads, which has one precision for all of them.

A thread that leaves its precision sets back what it found, which is another thread's: that one would go on
with fewer bits than it asked for.
"""


def read_setting(
    document: object, parts: Mapping[str, object], faults: list[Fault]
) -> tuple[RigidBody | None, Potential | None]:
    """Return body and potential if they are valid; add the faults of both and of the motion."""
    body, moments, potential = None, None, None
    body_in, potential_in = parts.get("body"), parts.get("potential")
    if isinstance(body_in, BodyIn):
        if _motion_kind(document) == "classical":
            # Without its motion, and the centre of the potential, a body that leaves moments out is none.
            body = moments = _body_of_case(body_in, parts, faults)
        elif body_in.A is None or body_in.C is None:
            faults += _moments_missing(document)
        else:
            # Rules between the parts are checked even if no body has the given moments.
            moments = RigidBody(body_in.A, body_in.B, body_in.C, allow_unphysical=True)
            faults += motion_faults(moments, document, parts)
            try:
                body = RigidBody(body_in.A, body_in.B, body_in.C, body_in.allow_unphysical)
            except DynamicsError as error:
                faults.append(fault_of(error))
    else:
        faults += _moments_missing(document)
    if not isinstance(potential_in, PotentialModel):
        faults += _faults_of_unread(document, moments)
    elif moments is None:
        faults += map(fault_of, potential_in.text_errors())
    else:
        try:
            # The reference angle of the general solution is looked at in balls.
            with ONE_AT_A_TIME if isinstance(potential_in, GeneralIn) else nullcontext():
                potential = potential_in.to_domain(moments)
        except DynamicsError:
            faults += map(fault_of, potential_in.errors(moments))
    return body, potential


def _body_of_case(body: BodyIn, parts: Mapping[str, object], faults: list[Fault]) -> RigidBody | None:
    """Return the body of a classical motion with all its moments; add the faults of both."""
    motion, potential = parts.get("motion"), parts.get("potential")
    if isinstance(potential, PotentialModel) and not isinstance(potential, GravityIn):
        message = "a classical motion needs a potential of the type gravity: a*g1 + b*g2 + c*g3"
        faults.append(Fault("/potential/type", "case_needs_gravity", message))
    if not isinstance(motion, ClassicalMotionIn) or not isinstance(potential, GravityIn):
        return None
    centre = (potential.a, potential.b, potential.c)
    try:
        with ONE_AT_A_TIME:
            placed = place(
                motion.to_domain(centre), (body.A, body.B, body.C), allow_unphysical=body.allow_unphysical
            )
    except DynamicsError as error:
        faults.append(fault_of(error))
        return None
    return placed.body


def _moments_missing(document: object) -> Iterator[Fault]:
    """Yield a fault for A and C where they were left out: only for a classical motion can they follow."""
    match document:
        case {"body": dict(body)} if _motion_kind(document) != "classical":
            for name in ("A", "C"):
                if name not in body:
                    yield Fault(f"/body/{name}", "missing_field", f'"{name}" is missing')
                elif body[name] is None:
                    message = 'a number, or a string such as "17/10", is expected'
                    yield Fault(f"/body/{name}", "invalid_number", message)


def _faults_of_unread(document: object, moments: RigidBody | None) -> Iterator[Fault]:
    """Yield the faults that can still be found in an unreadable potential."""
    match document:
        case {"potential": {"type": str(kind), **rest}} if kind in MODELS:
            yield from MODELS[kind].faults_of_unread(rest, moments)


def motion_faults(body: RigidBody, document: object, parts: Mapping[str, object]) -> Iterator[Fault]:
    """Yield a fault for each demand of the motion that the body does not meet."""
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
    if kind == "planar" and body.B is None:
        for purpose in _purposes_of_B(parts):
            yield Fault("/body/B", "missing_moment", f"{purpose} needs the moment B, which was left out")


def _purposes_of_B(parts: Mapping[str, object]) -> Iterator[str]:
    """Yield a fault for each request that needs the moment B if it was left out."""
    method, outputs = parts.get("method"), parts.get("outputs")
    if method in ("integration", "both"):
        yield f"the method {method}"
    if isinstance(outputs, list) and "stability" in outputs:
        yield "the output stability"


def combination_faults(document: object, parts: Mapping[str, object]) -> Iterator[Fault]:
    """Yield a fault for each request that the type of the motion does not support."""
    kind, method = _motion_kind(document), parts.get("method")
    if kind == "planar" and "motion" not in parts:
        given = {name for name in CURVE_FIELDS if _is_given(document, name)}
        for field, code, message in curve_faults(given):
            yield Fault(f"/motion/{field}", code, message)
    in_periods = isinstance(parts.get("time"), TimePeriodsIn)
    yield from _planar_only(kind, parts)
    if kind == "state" and method in ("quadrature", "both"):
        message = f"{method} is for planar motions; accepted for a state motion are auto and integration"
        yield Fault("/method", "method_needs_planar_motion", message)
    if kind == "state" and in_periods:
        message = (
            'a state motion has no known period; accepted are {"start", "stop", "samples"} and {"times"}'
        )
        yield Fault("/time/periods", "period_needed", message)
    if kind == "classical" and in_periods and not _closes(document):
        message = 'this case does not close; accepted are {"start", "stop", "samples"} and {"times"}'
        yield Fault("/time/periods", "period_needed", message)
    if kind in ("planar", "classical") and method == "integration" and in_periods:
        message = (
            'an integration finds no period; accepted are {"start", "stop", "samples"}, {"times"} '
            "and the methods auto, quadrature and both"
        )
        yield Fault("/time/periods", "period_needed", message)


def _planar_only(kind: str | None, parts: Mapping[str, object]) -> Iterator[Fault]:
    """Yield a fault for each request that only the quadrature of planar motions can meet."""
    accuracy, outputs = parts.get("accuracy"), parts.get("outputs")
    is_integrated = kind == "state" or parts.get("method") == "integration"
    if (
        (is_integrated or kind == "classical")
        and isinstance(accuracy, TierIn)
        and accuracy.tier == "certified"
    ):
        message = (
            "the tier certified needs the quadrature of a planar motion; the most accurate one here is high"
        )
        yield Fault("/accuracy/tier", "tier_needs_quadrature", message)
    asked = outputs if isinstance(outputs, list) else []
    if kind in ("state", "classical") and "stability" in asked:
        message = f"stability is of planar motions; leave it out for a {kind} motion"
        yield Fault(f"/outputs/{asked.index('stability')}", "output_needs_planar_motion", message)
    if is_integrated and "period" in asked:
        message = (
            "an integration finds no period; leave the output out, or use the quadrature of a planar motion"
        )
        yield Fault(f"/outputs/{asked.index('period')}", "output_needs_planar_motion", message)


def _motion_kind(document: object) -> str | None:
    """Return the type of the motion, also of a partly unreadable one."""
    match document:
        case {"motion": {"type": str(kind)}}:
            return kind
    return None


def _closes(document: object) -> bool:
    """Tell whether the motion is of a classical case that is periodic."""
    match document:
        case {"motion": {"case": str(name)}} if name in CASES:
            return CASES[name].form == "loop"
    return True


def _is_given(document: object, field: str) -> bool:
    match document:
        case {"motion": dict(motion)}:
            return motion.get(field) is not None
    return False


@dataclass(frozen=True)
class CheckedProblem:
    """A problem and its canonical document."""

    problem: Problem
    write: Callable[[], dict[str, object]]
    """Makes the canonical document, which takes as long as reading a formula; workers need none."""

    @cached_property
    def canonical(self) -> dict[str, object]:
        """The canonical document: documents that state the same problem have the same.

        In it numbers are exact, as strings; formulas are printed by our printer; defaults are filled in.
        """
        return self.write()


@dataclass(frozen=True, slots=True)
class Reading:
    """The readable parts of a document, and all its faults."""

    parts: dict[str, object]
    body: RigidBody | None
    potential: Potential | None
    faults: list[Fault]

    def problem(self) -> CheckedProblem | None:
        """Return the problem, None if a part is missing."""
        match (self.body, self.potential, self.parts):
            case (
                RigidBody() as body,
                Potential() as potential,
                {
                    "body": BodyIn() as body_in,
                    "potential": PotentialModel() as potential_in,
                    "motion": (PlanarMotionIn() | StateMotionIn() | ClassicalMotionIn()) as motion_in,
                    "time": (TimeSpanIn() | TimePeriodsIn() | TimeListIn()) as time_in,
                    "accuracy": (ToleranceIn() | RelativeIn() | TierIn() | BudgetIn()) as accuracy_in,
                    "method": ("auto" | "quadrature" | "integration" | "both") as method,
                    "outputs": list(wanted),
                    "accept": ("proved" | "undecided") as accept,
                },
            ):
                outputs = tuple(name for name in OUTPUTS if name in wanted)
                motion = motion_of(motion_in, potential_in)
                if motion is None:
                    return None
                problem = Problem(
                    body,
                    potential,
                    motion,
                    time_in.to_domain(),
                    accuracy_in.to_domain(),
                    method,
                    outputs,
                    accept,
                )

                def canonical() -> dict[str, object]:
                    document: dict[str, object] = {
                        "body": body_in.canonical(),
                        "potential": potential_in.canonical(),
                        "motion": motion_in.canonical(),
                        "time": time_in.canonical(),
                        "accuracy": accuracy_in.canonical(),
                        "method": method,
                        "outputs": list(outputs),
                    }
                    # Left out at its default, so that older documents keep their digests.
                    if accept != "proved" and isinstance(motion_in, PlanarMotionIn):
                        document["accept"] = accept
                    return document

                return CheckedProblem(problem, canonical)
        return None


def motion_of(motion: object, potential: object) -> PlanarMotion | StateMotion | ClassicalMotion | None:
    """Return the motion; that of a classical case knows the centre of its potential."""
    if isinstance(motion, ClassicalMotionIn) and isinstance(potential, GravityIn):
        return motion.to_domain((potential.a, potential.b, potential.c))
    return motion.to_domain() if isinstance(motion, PlanarMotionIn | StateMotionIn) else None
