"""The answer of GET /v1/families: families of potentials, named and classical cases."""

from typing import Literal

from pydantic import Field

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
