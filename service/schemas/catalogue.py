"""The catalogue of potentials, as clients see it."""

from pydantic import Field

from service.schemas.verdict import ResponseModel


class FamilyOut(ResponseModel):
    """A family of potentials."""

    type: str = Field(description="The potential's `type`.")
    title: str
    potential: str = Field(description="V, as a formula.")
    conditions: list[str]
    parameters: dict[str, str]
    source: str
    example: dict[str, object] = Field(description="A problem that can be sent to /v1/jobs.")


class CaseOut(ResponseModel):
    """A case that has a name."""

    name: str
    title: str
    family: str = Field(description="The `type` of the family it belongs to.")
    special: str = Field(description="What it has beyond its family.")
    source: str
    example: dict[str, object] = Field(description="A problem that can be sent to /v1/jobs.")


class FamiliesOut(ResponseModel):
    """The catalogue."""

    items: list[FamilyOut]
    cases: list[CaseOut]
