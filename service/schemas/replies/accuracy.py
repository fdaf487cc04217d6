"""The table of accuracy and speed: its stored form and the API's answer."""

from dataclasses import asdict
from typing import Literal, Self

from pydantic import Field

from service.dynamics.accuracy import (
    TIER_TOLERANCES,
    AccuracyRow,
    AccuracyTable,
    Family,
    Machine,
    MotionKind,
    Reference,
    Source,
    Unavailable,
)
from service.dynamics.problem import Tier
from service.schemas.replies.response_model import ResponseModel

Use = Literal["job", "request", "problem of a list", "point of a sweep"]
"""In what a tier is used."""


class MachineOut(ResponseModel):
    """Where the seconds were measured."""

    cpus: int = Field(description="Number of processors.")
    model: str | None = Field(description="Name of the processor, if known.")
    system: str = Field(description="Operating system.")


class AccuracyRowOut(ResponseModel):
    """Measured error and time of a tier on one problem."""

    tier: Tier = Field(description="The tier that was measured.")
    kind: MotionKind = Field(description="Ends of a periodic planar motion, else the kind of motion.")
    family: Family = Field(description="The kind of potential.")
    claimed_error: float = Field(description="The error that the solution claims.")
    error: float = Field(description="Largest departure from the reference in any of the six variables.")
    reference: Reference = Field(description="Method that computed the reference.")
    reference_error: float = Field(description="Bound of the reference's own error.")
    seconds: float = Field(description="For 1000 samples, median, when the problem's structure is known.")
    seconds_per_1000: float = Field(description="For each 1000 samples more.")


class UnavailableOut(ResponseModel):
    """A tier that failed on one of the problems."""

    tier: Tier = Field(description="The tier that was tried.")
    kind: MotionKind = Field(description="Ends of a periodic planar motion, else the kind of motion.")
    family: Family = Field(description="The kind of potential.")
    code: str = Field(description="The code of the error with which it failed.")
    detail: str = Field(description="A sentence for people.")


class AccuracyTableModel(ResponseModel):
    """The table as it is stored."""

    source: Source = Field(
        description="`shipped`: measured on another machine; `measured`: by `polhode calibrate` here."
    )
    date: str = Field(description="When it was measured, UTC.", json_schema_extra={"format": "date-time"})
    version: str = Field(description="Version of polhode that was measured.")
    numerics: int = Field(description="Raised whenever a computed digit changes.")
    machine: MachineOut = Field(description="Where it was measured.")
    repetitions: int = Field(description="Number of measurements behind each time.")
    rows: list[AccuracyRowOut] = Field(description="The measurements.")
    unavailable: list[UnavailableOut] = Field(description="Tiers that did not solve some of the problems.")

    @classmethod
    def of(cls, table: AccuracyTable) -> Self:
        """Return the model of a table."""
        return cls.model_validate(asdict(table))

    def to_domain(self) -> AccuracyTable:
        """Return the table."""
        fields = self.model_dump()
        return AccuracyTable(
            source=self.source,
            date=self.date,
            version=self.version,
            numerics=self.numerics,
            machine=Machine(**fields["machine"]),
            repetitions=self.repetitions,
            rows=tuple(AccuracyRow(**row) for row in fields["rows"]),
            unavailable=tuple(Unavailable(**row) for row in fields["unavailable"]),
        )


class TierCostOut(ResponseModel):
    """What one use of the service costs at each tier."""

    what: Use = Field(
        description="`job`: from its document to its solution, in a process; `request`: a `POST /v1/jobs`"
        " that waits for the solution; `problem of a list`, `point of a sweep`: from the `POST` to the last"
        " result, divided by their number."
    )
    seconds: dict[Tier, float] = Field(description="Seconds of one at each tier.")


class TierCostsOut(ResponseModel):
    """What a tier costs a user, measured when this version was made."""

    date: str = Field(description="When it was measured, UTC.", json_schema_extra={"format": "date-time"})
    version: str = Field(description="Version of polhode that was measured.")
    numerics: int = Field(description="Raised whenever a computed digit changes.")
    machine: MachineOut = Field(description="Where it was measured: not here, unless that is this machine.")
    load: float = Field(description="Load average of that machine at the start; quiet is below 1.5.")
    problem: str = Field(description="What was computed, and how it was asked.")
    rows: list[TierCostOut] = Field(description="The measurements.")


class AccuracyOut(AccuracyTableModel):
    """The errors that the tiers promise, and their measured errors and times on this installation."""

    tolerances: dict[Tier, float] = Field(
        description="Largest error of any of the six variables that a tier allows;"
        " of `certified` that of its smallest precision."
    )

    costs: TierCostsOut = Field(
        description="What a tier costs a user, of all tiers whatever the query asks: ratios count, since it"
        " was measured on the machine that is told."
    )

    @classmethod
    def beside(cls, table: AccuracyTable, costs: TierCostsOut) -> Self:
        """Return the answer: a table, and the costs that are shipped."""
        promised = {"tolerances": dict(TIER_TOLERANCES), "costs": costs.model_dump()}
        return cls.model_validate({**asdict(table), **promised})
