"""The `accuracy` of a problem document: a tolerance, absolute or relative, a tier, or a time budget."""

from fractions import Fraction
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, PlainValidator, Tag, model_validator

from service.dynamics.accuracy import (
    CERTIFIED_BITS,
    LARGEST_TOLERANCE,
    SMALLEST_TOLERANCE,
    TIER_TOLERANCES,
    TIERS,
    cheapest_tier,
)
from service.dynamics.problem import Accuracy, Measure, Tier
from service.schemas.reading.choices import TAG_MARK, WireModel, require_one, tag_by_field
from service.schemas.reading.numbers import Positive, read_positive, refuse

LONGEST_BUDGET = Fraction(3600)

_ACCEPTED = (
    'accepted are {"tolerance": e}, {"relative": e}, {"tier": t} with t one of '
    f'{", ".join(TIERS)}, and {{"budget_seconds": s}}'
)


def _read_tolerance(value: object) -> Fraction:
    return read_positive(value, accepted="1e-15 to 1e-2 are accepted")


def _read_budget(value: object) -> Fraction:
    return read_positive(value, accepted="1e-300 to 3600 seconds are accepted")


# Made from the type of positive numbers, whose description stays.
Tolerance = Annotated[Positive, PlainValidator(_read_tolerance)]
Budget = Annotated[Positive, PlainValidator(_read_budget)]


def _attainable(tolerance: Fraction, name: str) -> None:
    if not SMALLEST_TOLERANCE <= tolerance <= LARGEST_TOLERANCE:
        message = f"a tolerance of {float(tolerance):.6g}; 1e-15 to 1e-2 are accepted"
        raise refuse("out_of_range", message, below=name)


def _cheapest(tolerance: float, measure: Measure) -> Accuracy:
    """Return the cheapest tier that keeps a tolerance, if possible one without proofs."""
    tier = cheapest_tier(tolerance)
    return Accuracy(tolerance, "high" if tier == "certified" else tier, measure=measure)


class ToleranceIn(WireModel):
    """Largest absolute error allowed in any of the six variables over the asked times."""

    tolerance: Tolerance = Field(
        description="1e-15 to 1e-2; absolute, however large the variables are.",
        json_schema_extra={"minimum": 1e-15, "maximum": 1e-2},
    )

    @model_validator(mode="after")
    def _in_range(self) -> Self:
        _attainable(self.tolerance, "tolerance")
        return self

    def to_domain(self) -> Accuracy:
        """Return the cheapest tier that keeps the tolerance, if possible one without proofs."""
        return _cheapest(float(self.tolerance), "absolute")

    def canonical(self) -> dict[str, object]:
        """Return the document."""
        return {"tolerance": str(self.tolerance)}


class RelativeIn(WireModel):
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

    def to_domain(self) -> Accuracy:
        """Return the cheapest tier that keeps as many digits, if possible one without proofs."""
        return _cheapest(float(self.relative), "relative")

    def canonical(self) -> dict[str, object]:
        """Return the document."""
        return {"relative": str(self.relative)}


class TierIn(WireModel):
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

    def to_domain(self) -> Accuracy:
        """Return what the tier promises."""
        bits = self.bits or CERTIFIED_BITS[0]
        return Accuracy(TIER_TOLERANCES[self.tier], self.tier, bits, measure="above 1")

    def canonical(self) -> dict[str, object]:
        """Return the canonical document, with bits for the tier certified only."""
        if self.tier != "certified":
            return {"tier": self.tier}
        return {"tier": self.tier, "bits": self.bits or CERTIFIED_BITS[0]}


class BudgetIn(WireModel):
    """The best tier that is expected to take no longer, by the accuracy table of the installation."""

    budget_seconds: Budget = Field(description="Seconds of computing, > 0, at most 3600.")

    @model_validator(mode="after")
    def _sensible(self) -> Self:
        if self.budget_seconds > LONGEST_BUDGET:
            raise refuse("out_of_range", "at most 3600 seconds are accepted", below="budget_seconds")
        return self

    def to_domain(self) -> Accuracy:
        """Return the accuracy before the budget has been turned into a tier."""
        budget = float(self.budget_seconds)
        return Accuracy(TIER_TOLERANCES["standard"], "standard", budget_seconds=budget, measure="above 1")

    def canonical(self) -> dict[str, object]:
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
