"""The sections of a problem document as pydantic models, and their canonical documents."""

from fractions import Fraction
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from service.dynamics.problem import TimeList, TimePeriods, Times, TimeSpan
from service.schemas.problem.motions import MotionIn
from service.schemas.problem.potentials import PotentialIn
from service.schemas.problem.tiers import AccuracyIn, TierIn
from service.schemas.reading.choices import TAG_MARK, WireModel, require_one, tag_by_field
from service.schemas.reading.long_lists import each_of
from service.schemas.reading.needs import given, one_of_each, within
from service.schemas.reading.numbers import (
    MAX_SAMPLES,
    Exact,
    Instant,
    Moment,
    Periods,
    Positive,
    Samples,
    SearchDegree,
    read_time,
    refuse,
)

Method = Literal["auto", "quadrature", "integration", "both"]
Accept = Literal["proved", "undecided"]
OutputName = Literal["period", "gamma", "omega", "invariants", "orientation", "stability"]
OUTPUTS: tuple[OutputName, ...] = (
    "period",
    "gamma",
    "omega",
    "invariants",
    "orientation",
    "stability",
)
MAX_POINTS = 1000
DEFAULT_OUTPUTS: tuple[OutputName, ...] = ("gamma", "omega")


class BodyIn(WireModel):
    """Principal moments of inertia at the fixed point."""

    A: Moment | None = Field(
        default=None,
        description="About the first axis, > 0; any unit, the same for all three. Only for classical motions"
        " a moment that follows from the others may be left out.",
    )
    B: Moment | None = Field(
        default=None,
        description="About the second axis, > 0. Needed for integration, stability and state motions.",
    )
    C: Moment | None = Field(
        default=None, description="About the third axis, > 0; as A. Planar motions need A ≠ C."
    )
    allow_unphysical: bool = Field(default=False, description="Accept moments that no body can have.")

    def canonical(self) -> dict[str, object]:
        """Return the document with every field."""
        return {
            "A": None if self.A is None else str(self.A),
            "B": None if self.B is None else str(self.B),
            "C": None if self.C is None else str(self.C),
            "allow_unphysical": self.allow_unphysical,
        }


_WITH_MOMENTS = within("body", given("A", "C"))
"""Without a classical motion no moment follows from others."""
_OF_TYPE_CLASSICAL = {"type": "object", "required": ["type"], **within("type", {"const": "classical"})}
_CLASSICAL = {"required": ["motion"], **within("motion", _OF_TYPE_CLASSICAL)}


class TimeSpanIn(WireModel):
    """``samples`` equidistant times from ``start`` to ``stop``, both included."""

    start: Instant = Field(default=Fraction(0), description="First time; 0 if left out.")
    stop: Instant = Field(description="Last time, after start; in the unit of time that the problem implies.")
    samples: Samples = Field(description="Number of times.")

    @model_validator(mode="after")
    def _forward(self) -> Self:
        if not self.start < self.stop:
            raise refuse(
                "out_of_range", f"stop = {self.stop} is not after start = {self.start}", below="stop"
            )
        return self

    def to_domain(self) -> Times:
        """Return the times."""
        return TimeSpan(self.start, self.stop, self.samples)

    def canonical(self) -> dict[str, object]:
        """Return the document with every field."""
        return {"start": str(self.start), "stop": str(self.stop), "samples": self.samples}


class TimePeriodsIn(WireModel):
    """``samples`` equidistant times over ``periods`` periods from 0; planar and classical motions only."""

    periods: Periods = Field(description="Number of periods, > 0; a fraction is accepted.")
    samples: Samples = Field(description="Number of times.")

    def to_domain(self) -> Times:
        """Return the times."""
        return TimePeriods(self.periods, self.samples)

    def canonical(self) -> dict[str, object]:
        """Return the document."""
        return {"periods": str(self.periods), "samples": self.samples}


class TimeListIn(WireModel):
    """The times themselves."""

    times: Annotated[
        list[Instant], Field(min_length=1, max_length=MAX_SAMPLES), each_of(read_time, most=MAX_SAMPLES)
    ] = Field(description="In any order, in the unit of time that the problem implies.")

    def to_domain(self) -> Times:
        """Return the times."""
        return TimeList(tuple(self.times))

    def canonical(self) -> dict[str, object]:
        """Return the document."""
        return {"times": [str(time) for time in self.times]}


TimeIn = Annotated[
    Annotated[TimePeriodsIn, Tag(f"{TAG_MARK}periods")]
    | Annotated[TimeListIn, Tag(f"{TAG_MARK}times")]
    | Annotated[TimeSpanIn, Tag(f"{TAG_MARK}stop")],
    Discriminator(tag_by_field(("periods", "times"), "stop")),
    BeforeValidator(
        require_one(
            ("stop", "periods", "times"),
            models=(TimeSpanIn, TimePeriodsIn, TimeListIn),
            accepted='accepted are {"start", "stop", "samples"}, {"periods", "samples"} and {"times"}',
            may_be_none=True,
        )
    ),
]


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
    outputs: Annotated[list[OutputName], Field(min_length=1, max_length=20)] = Field(
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
    outputs: Annotated[list[OutputName], Field(min_length=1, max_length=20)] = Field(
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
