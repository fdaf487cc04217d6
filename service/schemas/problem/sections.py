"""The sections of a problem document as models, with canonical documents: accuracy, body, times, labels.

Potentials and motions have chapters of their own. Labels and a note are given with a job or a sweep, or
changed by a merge patch (RFC 7396).
"""

import re
from collections.abc import Mapping
from fractions import Fraction
from functools import partial
from typing import Annotated, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    PlainValidator,
    Tag,
    WithJsonSchema,
    model_validator,
)

from service.dynamics.accuracy import CERTIFIED_BITS, LARGEST_TOLERANCE, SMALLEST_TOLERANCE, TIERS
from service.dynamics.problem import Tier
from service.schemas.reading.documents import (
    LABEL_KEY,
    LABEL_KEYS,
    LONGEST_NOTE,
    LONGEST_VALUE,
    MOST_LABELS,
    Document,
)
from service.schemas.reading.numbers import (
    MAX_SAMPLES,
    Instant,
    Moment,
    Periods,
    Positive,
    Samples,
    each_of,
    read_positive,
    read_time,
    refuse,
)
from service.schemas.reading.parts import TAG_MARK, Section, WireModel, require_one, tag_by_field

LONGEST_BUDGET = Fraction(3600)

_ACCEPTED = (
    'accepted are {"tolerance": e}, {"relative": e}, {"tier": t} with t one of '
    f'{", ".join(TIERS)}, and {{"budget_seconds": s}}'
)


# Made from the type of positive numbers, whose description stays.
_TOLERANCE = partial(read_positive, accepted="1e-15 to 1e-2 are accepted")
_BUDGET = partial(read_positive, accepted="1e-300 to 3600 seconds are accepted")
Tolerance = Annotated[Positive, PlainValidator(_TOLERANCE)]
Budget = Annotated[Positive, PlainValidator(_BUDGET)]


def _attainable(tolerance: Fraction, name: str) -> None:
    if not SMALLEST_TOLERANCE <= tolerance <= LARGEST_TOLERANCE:
        message = f"a tolerance of {float(tolerance):.6g}; 1e-15 to 1e-2 are accepted"
        raise refuse("out_of_range", message, below=name)


class ToleranceIn(Section):
    """Largest absolute error allowed in any of the six variables over the asked times."""

    tolerance: Tolerance = Field(
        description="1e-15 to 1e-2; absolute, however large the variables are.",
        json_schema_extra={"minimum": 1e-15, "maximum": 1e-2},
    )

    @model_validator(mode="after")
    def _in_range(self) -> Self:
        _attainable(self.tolerance, "tolerance")
        return self

    def canonical(self) -> Document:
        """Return the document."""
        return {"tolerance": str(self.tolerance)}


class RelativeIn(Section):
    """Largest error allowed, relative to the largest size of the variable's group over the asked times.

    The groups are p, q, r; g1, g2, g3; the quaternion; each angle.
    """

    relative: Tolerance = Field(
        description="1e-15 to 1e-2, of the largest absolute value in the group.",
        json_schema_extra={"minimum": 1e-15, "maximum": 1e-2},
    )

    @model_validator(mode="after")
    def _in_range(self) -> Self:
        _attainable(self.relative, "relative")
        return self

    def canonical(self) -> Document:
        """Return the document."""
        return {"relative": str(self.relative)}


class TierIn(Section):
    """A named accuracy: draft 1e-6, standard 1e-10, high 1e-13, certified with proven radii.

    Relative to the largest size of the variable's group over the asked times where that is above 1.
    """

    tier: Tier = Field(description="Its name.")
    bits: Literal[64, 128, 333] | None = Field(
        default=None, description="Precision of the tier certified; 64 if left out."
    )

    @model_validator(mode="after")
    def _bits_are_certified(self) -> Self:
        if self.bits is not None and self.tier != "certified":
            raise refuse("conflicting_fields", "bits are for the tier certified only", below="bits")
        return self

    def canonical(self) -> Document:
        """Return the canonical document, with bits for the tier certified only."""
        if self.tier != "certified":
            return {"tier": self.tier}
        return {"tier": self.tier, "bits": self.bits or CERTIFIED_BITS[0]}


class BudgetIn(Section):
    """The best tier that is expected to take no longer, by the accuracy table of the installation."""

    budget_seconds: Budget = Field(description="Seconds of computing, > 0, at most 3600.")

    @model_validator(mode="after")
    def _sensible(self) -> Self:
        if self.budget_seconds > LONGEST_BUDGET:
            raise refuse("out_of_range", "at most 3600 seconds are accepted", below="budget_seconds")
        return self

    def canonical(self) -> Document:
        """Return the document."""
        return {"budget_seconds": str(self.budget_seconds)}


AccuracyIn = Annotated[
    Annotated[ToleranceIn, Tag(f"{TAG_MARK}tolerance")]
    | Annotated[RelativeIn, Tag(f"{TAG_MARK}relative")]
    | Annotated[BudgetIn, Tag(f"{TAG_MARK}budget_seconds")]
    | Annotated[TierIn, Tag(f"{TAG_MARK}tier")],
    Discriminator(tag_by_field(("tolerance", "relative", "budget_seconds"), "tier")),
    BeforeValidator(
        require_one(
            ("tolerance", "relative", "tier", "budget_seconds"),
            models=(ToleranceIn, RelativeIn, TierIn, BudgetIn),
            accepted=_ACCEPTED,
            may_be_none=False,
        )
    ),
]


class BodyIn(Section):
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

    def canonical(self) -> Document:
        """Return the document with every field."""
        moments = {name: getattr(self, name) for name in ("A", "B", "C")}
        own = {name: None if moment is None else str(moment) for name, moment in moments.items()}
        return {**own, "allow_unphysical": self.allow_unphysical}


class TimeSpanIn(Section):
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

    def canonical(self) -> Document:
        """Return the document with every field."""
        return {"start": str(self.start), "stop": str(self.stop), "samples": self.samples}


class TimePeriodsIn(Section):
    """``samples`` equidistant times over ``periods`` periods from 0; planar and classical motions only."""

    periods: Periods = Field(description="Number of periods, > 0; a fraction is accepted.")
    samples: Samples = Field(description="Number of times.")

    def canonical(self) -> Document:
        """Return the document."""
        return {"periods": str(self.periods), "samples": self.samples}


class TimeListIn(Section):
    """The times themselves."""

    times: Annotated[
        list[Instant], Field(min_length=1, max_length=MAX_SAMPLES), each_of(read_time, most=MAX_SAMPLES)
    ] = Field(description="In any order, in the unit of time that the problem implies.")

    def canonical(self) -> Document:
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


_NOT_IN_VALUES = re.compile(r"[\x00-\x1f\x7f-\x9f]")
"""Control characters."""
_NOT_IN_NOTES = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
"""The same, but tabs and ends of lines."""


def _key(text: str) -> str:
    if not LABEL_KEY.match(text):
        raise refuse("invalid_label", f"{text[:60]!r} is no key of a label; accepted are {LABEL_KEYS}")
    return text


def _value(text: str) -> str:
    if not 1 <= len(text) <= LONGEST_VALUE or _NOT_IN_VALUES.search(text):
        accepted = f"accepted are 1 to {LONGEST_VALUE} characters without control characters"
        raise refuse("invalid_label", f"{text[:60]!r} is no value of a label; {accepted}")
    return text


def _note(text: str) -> str:
    if len(text) > LONGEST_NOTE or _NOT_IN_NOTES.search(text):
        accepted = f"accepted are at most {LONGEST_NOTE}; of control characters only tabs and newlines"
        raise refuse("invalid_note", f"a note of {len(text)} characters; {accepted}")
    return text


def _labels_of(value: Mapping[str, object], **further: object) -> WithJsonSchema:
    return WithJsonSchema(
        {
            "type": "object",
            "propertyNames": {"pattern": "^[A-Za-z0-9]([A-Za-z0-9_.-]{0,61}[A-Za-z0-9])?$"},
            "additionalProperties": value,
            "examples": [{"project": "thesis"}],
            **further,
        }
    )


_VALUE_SCHEMA = {
    "type": "string",
    "minLength": 1,
    "maxLength": LONGEST_VALUE,
    "pattern": r"^[^\u0000-\u001f\u007f-\u009f]+$",
}
_NOTE_SCHEMA = {
    "type": "string",
    "maxLength": LONGEST_NOTE,
    "pattern": r"^[^\u0000-\u0008\u000b-\u001f\u007f-\u009f]*$",
}

_Key = Annotated[str, AfterValidator(_key)]
_Value = Annotated[str, AfterValidator(_value)]
Labels = Annotated[
    dict[_Key, _Value], Field(max_length=MOST_LABELS), _labels_of(_VALUE_SCHEMA, maxProperties=MOST_LABELS)
]
Note = Annotated[str, AfterValidator(_note), WithJsonSchema(_NOTE_SCHEMA)]
_LabelChanges = Annotated[dict[_Key, _Value | None], _labels_of({"anyOf": [_VALUE_SCHEMA, {"type": "null"}]})]

LABELS_HELP = (
    f"Up to {MOST_LABELS} words to find it by, such as project: thesis. Keys: {LABEL_KEYS}; values: 1 to"
    f" {LONGEST_VALUE} characters without control characters. No part of what is computed."
)
NOTE_HELP = f"A text of at most {LONGEST_NOTE} characters. No part of what is computed."


class MarksPatchIn(WireModel):
    """A merge patch (RFC 7396) of labels and note: what is left out stays, what is null goes."""

    labels: _LabelChanges | None = Field(
        default=None,
        description="Values by their keys; null removes a label, and in place of the object all labels.",
    )
    note: Note | None = Field(default=None, description=f"{NOTE_HELP} null removes it.")
