"""The answer of GET /v1/families: families of potentials and named cases."""

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


class FamiliesOut(ResponseModel):
    """The catalogue."""

    items: list[FamilyOut] = Field(description="The families.")
    cases: list[CaseOut] = Field(description="The named cases of the literature.")
