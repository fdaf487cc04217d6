"""The documents that state problems, as models: problems, jobs, validations, audits.

A job adds labels and a note to a problem, an audit changes some of one, a validation leaves parts out.
"""

from fractions import Fraction
from typing import Annotated

from pydantic import AfterValidator, BaseModel, Field

from service.dynamics.problem import Accept, Method, Output
from service.schemas.problem.motions import MOTIONS, EquatorStartIn, MotionIn, PointStartIn, RestStartIn
from service.schemas.problem.potentials import MODELS, PotentialIn
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
from service.schemas.problem.trusted import DEFAULT_OUTPUTS
from service.schemas.reading.documents import Document
from service.schemas.reading.numbers import Exact, Positive, SearchDegree, refuse
from service.schemas.reading.parts import WireModel, given, one_of_each, within

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
