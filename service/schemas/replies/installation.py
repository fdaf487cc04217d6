"""Offers of an installation: families of potentials, classical cases, and the accuracy table."""

from dataclasses import asdict
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field

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
from service.dynamics.problem import Output, Tier
from service.schemas.replies.response_model import ResponseModel


class FamilyOut(ResponseModel):
    """A family of potentials."""

    type: str = Field(description="The potential's `type`.")
    title: str = Field(description="A few words for people.")
    potential: str = Field(description="V, as a formula.")
    conditions: list[str] = Field(description="Conditions on the body and the parameters.")
    parameters: dict[str, str] = Field(description="Meaning of each field of the potential, by its name.")
    source: str = Field(description="Source in the literature.")
    example: dict[str, object] = Field(description="A problem that can be sent to /v1/jobs.")


class CaseOut(ResponseModel):
    """A case that has a name."""

    name: str = Field(description="Stable word for programs.")
    title: str = Field(description="A few words for people.")
    family: str = Field(description="The `type` of the family it belongs to.")
    special: str = Field(description="What distinguishes it within its family.")
    source: str = Field(description="Source in the literature.")
    example: dict[str, object] = Field(description="A problem that can be sent to /v1/jobs.")


class ClassicalOut(ResponseModel):
    """A classical case of the heavy body, with a potential of the type gravity."""

    case: str = Field(description="The `case` of a motion of the type classical.")
    title: str = Field(description="A few words for people.")
    author: str = Field(description="Who found it.")
    year: int | None = Field(description="When it was published; null if that is not known.")
    conditions: list[str] = Field(
        description="Conditions on the body and the centre, in one order of the axes; any other is accepted."
    )
    real: str = Field(description="For which bodies and parameters there is a motion.")
    parameters: dict[str, str] = Field(description="The fields of its motion, with ranges.")
    relations: list[str] = Field(description="What holds along the motion.")
    functions: str = Field(description="Kind of functions of time.")
    periodic: bool | None = Field(description="Whether all six variables are periodic; null if not known.")
    stability: str = Field(description="Of the example.")
    source: Literal["proved", "attribution", "candidate", "not_obtained"] = Field(
        description="`proved`: formulas and name are beyond doubt. `attribution`: the formulas are proved,"
        " the name is that of the case they look like. `candidate`: the formulas are proved, who was the"
        " first is not known. `not_obtained`: no text, hence no formulas; it cannot be computed."
    )
    example: dict[str, object] | None = Field(
        description="A problem that can be sent to /v1/jobs; null if the case cannot be computed."
    )


class FamiliesOut(ResponseModel):
    """The catalogue."""

    items: list[FamilyOut] = Field(description="The families.")
    cases: list[CaseOut] = Field(description="The named cases of the literature.")
    classical: list[ClassicalOut] = Field(description="The classical cases of the heavy body.")


Use = Literal["job", "request", "problem of a list", "point of a sweep"]
"""The uses of a tier whose cost is measured."""
Way = Literal["compiled solver", "whole job", "DOP853", "heyoka"]
"""Two of ours, and two integrators of other people."""


class MachineOut(ResponseModel):
    """The machine on which the seconds were measured."""

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


def _in_utc(date: object) -> object:
    # Tables stored by the first version end in +00:00.
    return date.replace("+00:00", "Z") if isinstance(date, str) else date


Measured = Annotated[
    str,
    BeforeValidator(_in_utc),
    Field(description="When it was measured, UTC.", json_schema_extra={"format": "date-time"}),
]


class AccuracyTableModel(ResponseModel):
    """The table as it is stored."""

    source: Source = Field(
        description="`shipped`: measured on another machine; `measured`: by `polhode calibrate` here."
    )
    date: Measured
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


class ShippedMeasurement(ResponseModel):
    """When and where something was measured that every installation shows."""

    date: Measured
    version: str = Field(description="Version of polhode that was measured.")
    numerics: int = Field(description="Raised whenever a computed digit changes.")
    machine: MachineOut = Field(description="Where it was measured: not here, unless that is this machine.")
    load: float = Field(description="Load average of that machine at the start; quiet is below 1.5.")


class TierCostOut(ResponseModel):
    """Seconds that one use of the service takes at each tier."""

    what: Use = Field(
        description="`job`: from its document to its solution, in a process; `request`: a `POST /v1/jobs`"
        " that waits for the solution; `problem of a list`, `point of a sweep`: from the `POST` to the last"
        " result, divided by their number."
    )
    seconds: dict[Tier, float] = Field(description="Seconds of one at each tier.")


class TierCostsOut(ShippedMeasurement):
    """Seconds that a user waits at each tier, measured when this version was made."""

    problem: str = Field(description="What was computed, and how it was asked.")
    rows: list[TierCostOut] = Field(description="The measurements.")


class WayOut(ResponseModel):
    """The time that a method took for the samples of one motion, and their error."""

    way: Way = Field(
        description="`compiled solver`: ours, from the potential to the samples; `whole job`: the same from"
        " the document to the solution; `DOP853`: `scipy.integrate.solve_ivp` with the equations in Python;"
        " `heyoka`: its Taylor integrator, without the compilation."
    )
    setting: str = Field(description="The tier, or the tolerance that an integrator was given.")
    seconds: float = Field(description="Processor time, median.")
    error: float = Field(
        description="Largest departure of any of the six variables from proven digits; of the tier"
        " `certified`, whose digits these are, the largest proven radius."
    )


class OutputCostOut(ResponseModel):
    """The time of a job as outputs are asked for one by one."""

    problem: str = Field(description="The motion.")
    output: Output = Field(description="What is asked for beside the outputs of the rows before.")
    seconds: float = Field(description="Of the job with this and those before it, processor time, median.")
    added: float | None = Field(
        description="Seconds more than without it; null for the first. Below zero only by the clock's noise."
    )


class ComparedWaysOut(ShippedMeasurement):
    """Ways to the same samples beside each other, and what each output adds."""

    problem: str = Field(description="What was computed, and how it was measured.")
    ways: list[WayOut] = Field(description="Each way from its cheapest setting to its best.")
    outputs: list[OutputCostOut] = Field(description="In the order in which the outputs were added.")


class AccuracyOut(AccuracyTableModel):
    """The errors that the tiers promise, and their measured errors and times on this installation."""

    tolerances: dict[Tier, float] = Field(
        description="Largest error of any of the six variables that a tier allows;"
        " of `certified` that of its smallest precision."
    )

    costs: TierCostsOut = Field(
        description="What a tier costs a user, of all tiers whatever the query asks: ratios count, since it"
        " was measured on the machine that it names."
    )

    comparison: ComparedWaysOut = Field(
        description="What other methods take and reach, and what each output costs, whatever the query asks:"
        " ratios count, since it was measured on the machine that it names."
    )

    @classmethod
    def beside(cls, table: AccuracyTable, costs: TierCostsOut, comparison: ComparedWaysOut) -> Self:
        """Return the answer: a table, and what is shipped beside it."""
        shipped = {"costs": costs.model_dump(), "comparison": comparison.model_dump()}
        return cls.model_validate({**asdict(table), "tolerances": dict(TIER_TOLERANCES), **shipped})
