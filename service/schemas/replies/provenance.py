"""The answer of /v1/solutions/{id}/provenance: PROV-JSON, a W3C member submission of 2013."""

from pydantic import Field

from service.schemas.replies.response_model import ResponseModel

Records = dict[str, dict[str, object]]
"""Attributes of records, by the identifiers of the records."""

_SOLUTION, _ATTEMPT, _WORKER = (
    "polhode:solution/019f0000",
    "polhode:job/019f0001/attempt/1",
    "polhode:worker/h",
)


class ProvenanceGraphOut(ResponseModel):
    """Entities, activities and agents, and how they are related."""

    prefix: dict[str, str] = Field(
        description="What the prefixes of identifiers stand for.",
        examples=[{"polhode": "urn:polhode:provenance:"}],
    )
    entity: Records = Field(
        description="The problem, the kept result of its examination, the solution.",
        examples=[{_SOLUTION: {"prov:type": "polhode:Solution", "polhode:tier": "standard"}}],
    )
    activity: Records = Field(
        description="The examination, and each attempt at computing the solution.",
        examples=[{_ATTEMPT: {"prov:startTime": "2026-01-02T03:04:05+00:00", "polhode:numerics": 1}}],
    )
    agent: Records = Field(
        description="Workers, and the software with its versions.",
        examples=[{_WORKER: {"prov:label": "h"}}],
    )
    used: Records = Field(description="What each activity began with.")
    wasGeneratedBy: Records = Field(  # noqa: N815
        description="What each activity made.",
        examples=[{"_:generation1": {"prov:entity": _SOLUTION, "prov:activity": _ATTEMPT}}],
    )
    wasDerivedFrom: Records = Field(description="What each entity was made of.")  # noqa: N815
    wasAssociatedWith: Records = Field(  # noqa: N815
        description="Who or what carried each activity out.",
        examples=[{"_:association1": {"prov:activity": _ATTEMPT, "prov:agent": _WORKER}}],
    )
