"""The catalogue of potentials, as clients see it."""

from pydantic import Field

from service.schemas.verdict import ResponseModel


class FamilyOut(ResponseModel):
    """A family of potentials."""

    type: str = Field(description="The potential's `type`.")
    title: str = Field(description="A few words for people.")
    potential: str = Field(description="V, as a formula.")
    conditions: list[str] = Field(description="What the body and the parameters must meet.")
    parameters: dict[str, str] = Field(description="What each field of the potential means, by its name.")
    source: str = Field(description="Where the potential is from.")
    example: dict[str, object] = Field(description="A problem that can be sent to /v1/jobs.")


class CaseOut(ResponseModel):
    """A case that has a name."""

    name: str = Field(description="Stable word for programs.")
    title: str = Field(description="A few words for people.")
    family: str = Field(description="The `type` of the family it belongs to.")
    special: str = Field(description="What it has beyond its family.")
    source: str = Field(description="Where the case is from.")
    example: dict[str, object] = Field(description="A problem that can be sent to /v1/jobs.")


class FamiliesOut(ResponseModel):
    """The catalogue."""

    items: list[FamilyOut] = Field(description="The families.")
    cases: list[CaseOut] = Field(description="The cases of the literature that have names.")
