"""The documents that state problems, as models: problems, jobs, validations, audits; rules between parts.

A job adds labels and a note to a problem, an audit changes some of one, a validation leaves parts out.

Between the parts there are rules. Each reads as little as it needs, so that a fault elsewhere, or a part that
is unreadable, does not hide its own. Then there are the problem and its canonical document.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Annotated

from pydantic import AfterValidator, BaseModel, Field

from service.dynamics.body import RigidBody
from service.dynamics.classical.bodies import CASES
from service.dynamics.errors import DynamicsError
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import Accept, Method, Output, PlanarMotion, Problem
from service.schemas.problem.motions import (
    CURVE_FIELDS,
    MOTIONS,
    ClassicalMotionIn,
    EquatorStartIn,
    MotionIn,
    PointStartIn,
    RestStartIn,
    curve_faults,
)
from service.schemas.problem.potentials import MODELS, GravityIn, PotentialIn, PotentialModel
from service.schemas.problem.sections import (
    LABELS_HELP,
    NOTE_HELP,
    AccuracyIn,
    BodyIn,
    BudgetIn,
    Labels,
    Note,
    RelativeIn,
    TierIn,
    TimeIn,
    TimeListIn,
    TimePeriodsIn,
    TimeSpanIn,
    ToleranceIn,
)
from service.schemas.problem.trusted import DEFAULT_OUTPUTS, ONE_AT_A_TIME, body_of, potential_of, problem_of
from service.schemas.reading.documents import Document, Fault, Part, fault_of
from service.schemas.reading.numbers import Exact, Positive, SearchDegree, refuse
from service.schemas.reading.parts import Section, WireModel, fields_of, given, one_of_each, within

MAX_POINTS = 1000


_WITH_MOMENTS = within("body", given("A", "C"))
"""Without a classical motion no moment follows from others."""
_OF_TYPE_CLASSICAL = {"type": "object", "required": ["type"], **within("type", {"const": "classical"})}
_CLASSICAL = {"required": ["motion"], **within("motion", _OF_TYPE_CLASSICAL)}


class ProblemIn(WireModel):
    """A problem."""

    model_config = one_of_each([_WITH_MOMENTS, _CLASSICAL])

    body: BodyIn = Field(description="The rigid body.")
    potential: PotentialIn = Field(description="The potential V(g1, g2, g3) of the field of force.")
    motion: MotionIn = Field(description="Which of the motions.")
    time: TimeIn = Field(description="At which times its samples are stored; others can be asked for later.")
    accept: Accept = Field(
        default="proved",
        description="`proved`: a planar motion needs a potential that is proved admissible. `undecided`: it"
        " may be neither proved nor refuted; then q = 0 is proved on the motion's own curve, or the job is"
        " refused. Without meaning for a state.",
    )
    # By a factory: client generators drop operations whose bodies have objects as defaults.
    accuracy: AccuracyIn = Field(
        default_factory=lambda: TierIn(tier="standard"),
        description='How accurate; `{"tier": "standard"}` if left out.',
    )
    method: Method = Field(
        default="auto",
        description="`auto`: quadrature for planar motions, integration for states; `both` compares the two.",
    )
    outputs: Annotated[list[Output], Field(min_length=1, max_length=20)] = Field(
        default_factory=lambda: list(DEFAULT_OUTPUTS),
        description="What is computed and stored; gamma and omega if left out.",
    )


def _inside(g2: Fraction) -> Fraction:
    if abs(g2) >= 1:
        raise refuse("out_of_range", f"g2 = {g2}; accepted is -1 < g2 < 1")
    return g2


class PointsIn(WireModel):
    """Points at which the functions of the decomposition V = V1[F(w)] + Q G(g2) are evaluated."""

    w: Annotated[list[Positive], Field(max_length=MAX_POINTS)] = Field(
        default_factory=list, description="Arguments of F, > 0; none if left out."
    )
    g2: Annotated[list[Annotated[Exact, AfterValidator(_inside)]], Field(max_length=MAX_POINTS)] = Field(
        default_factory=list, description="Arguments of G, -1 < g2 < 1; none if left out."
    )


class NearestIn(WireModel):
    """The search for the nearest admissible polynomial to one that is not admissible."""

    degree: SearchDegree = Field(description="Largest degree that it may have on the sphere.")


class ValidationIn(WireModel):
    """A body and a potential, and perhaps a motion or a whole problem: what ``POST /v1/validations`` takes.

    With a motion and times it is a problem, and checked as ``POST /v1/jobs`` would check it.
    """

    model_config = one_of_each([_WITH_MOMENTS, _CLASSICAL])

    body: BodyIn = Field(description="The rigid body.")
    potential: PotentialIn = Field(description="The potential that is judged.")
    motion: MotionIn | None = Field(default=None, description="If given, the answer lists its windows.")
    time: TimeIn | None = Field(
        default=None, description="With times and a motion, the document is checked as a whole problem."
    )
    accept: Accept = Field(default="proved", description="Of a whole problem, as for jobs.")
    accuracy: AccuracyIn = Field(
        default_factory=lambda: TierIn(tier="standard"), description="Of a whole problem, as for jobs."
    )
    method: Method = Field(default="auto", description="Of a whole problem, as for jobs.")
    outputs: Annotated[list[Output], Field(min_length=1, max_length=20)] = Field(
        default_factory=lambda: list(DEFAULT_OUTPUTS), description="Of a whole problem, as for jobs."
    )
    points: PointsIn | None = Field(
        default=None, description="If given, the answer has the values of F and G there."
    )
    nearest: NearestIn | None = Field(
        default=None,
        description="How far the nearest admissible polynomial is searched for one that is not admissible;"
        " up to its degree plus 6 if left out.",
    )


class JobIn(ProblemIn):
    """A problem with labels and a note, which are no part of it: what ``POST /v1/jobs`` takes."""

    labels: Labels = Field(default_factory=dict, description=LABELS_HELP)
    note: Note | None = Field(default=None, description=NOTE_HELP)


class AuditIn(WireModel):
    """Another accuracy or method; what is left out or null is as in the solution's problem."""

    accuracy: AccuracyIn | None = Field(default=None, description="Another tier, tolerance or budget.")
    method: Method | None = Field(default=None, description="Another method.")


def audited_problem(problem: Document, document: Document) -> Document:
    """Return the ``problem`` with what a valid ``document`` of an audit changes of it."""
    return {**problem, **{name: value for name, value in document.items() if value is not None}}


MEMBERS: dict[str, type[BaseModel]] = {
    **MODELS,
    **MOTIONS,
    "equator": EquatorStartIn,
    "rest": RestStartIn,
    "point": PointStartIn,
    "stop": TimeSpanIn,
    "periods": TimePeriodsIn,
    "times": TimeListIn,
    "tolerance": ToleranceIn,
    "relative": RelativeIn,
    "tier": TierIn,
    "budget_seconds": BudgetIn,
}
"""Classes by their tags, without the prefix of tags."""


SECTIONS = ("body", "potential", "motion", "time", "accuracy")
"""Parts of a problem that have canonical documents of their own."""


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
            potential = potential_of(fields_of(potential_in), moments)
        except DynamicsError:
            # They look for what is wrong in balls, too.
            with ONE_AT_A_TIME:
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
    try:
        return body_of(
            {"body": fields_of(body), "motion": fields_of(motion), "potential": fields_of(potential)}
        )
    except DynamicsError as error:
        faults.append(fault_of(error))
        return None


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
    outputs = parts.get("outputs")
    is_integrated = kind == "state" or parts.get("method") == "integration"
    asked = outputs if isinstance(outputs, list) else []
    if kind == "state" and "stability" in asked:
        message = (
            "stability is of periodic motions; leave it out for a state motion, whose period is not known"
        )
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
    write: Callable[[], Document]
    """Makes the canonical document, which takes as long as reading a formula; workers need none."""

    @cached_property
    def canonical(self) -> Document:
        """The canonical document: documents that state the same problem have the same.

        In it numbers are exact, as strings; formulas are printed by our printer; defaults are filled in.
        """
        return self.write()


@dataclass(frozen=True, slots=True)
class Reading:
    """The readable parts of a document, and all its faults."""

    parts: Mapping[str, object]
    body: RigidBody | None
    potential: Potential | None
    faults: list[Fault]

    def document(self) -> Part:
        """Return the parts as a document has them, with exact numbers and defaults."""
        return {
            name: fields_of(part) if isinstance(part, BaseModel) else part
            for name, part in self.parts.items()
        }

    def problem(self) -> CheckedProblem | None:
        """Return the problem, None if a part is missing."""
        found = {name: part for name in SECTIONS if isinstance(part := self.parts.get(name), Section)}
        if self.body is None or self.potential is None or len(found) < len(SECTIONS):
            return None
        problem = problem_of(self.document(), self.body, self.potential)

        def canonical() -> Document:
            document: Document = {name: part.canonical() for name, part in found.items()}
            document |= {"method": problem.method, "outputs": list(problem.outputs)}
            # Left out at its default, so that older documents keep their digests.
            if problem.accept != "proved" and isinstance(problem.motion, PlanarMotion):
                document["accept"] = problem.accept
            return document

        return CheckedProblem(problem, canonical)
