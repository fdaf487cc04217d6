"""The base class of all answers, and words that several of them and the page share."""

from collections.abc import Iterable, Mapping
from typing import Generic, Literal, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict


def _may_grow(schema: JsonDict) -> None:
    """Allow unknown fields in the schema of an answer, so that clients accept fields of later versions."""
    schema.pop("additionalProperties", None)


class ResponseModel(BaseModel):
    """The base class of all answers: every field is always present."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, json_schema_extra=_may_grow)


Item = TypeVar("Item")
Columns = dict[str, float | str | bool | None]
"""A row of a list that was asked for by its columns."""


class PageOut(ResponseModel, Generic[Item]):
    """The base class of all pages of lists."""

    items: list[Item] = Field(
        description="In the order that was asked for; with `columns` the values of these by their names."
    )
    total: int | None = Field(
        description="Items that match in all; null with `where` or `after`, unless `count=exact`."
    )
    limit: int = Field(description="Items on a page at most.")
    offset: int = Field(description="Items left out before this page.")
    next: str | None = Field(
        description="Query of the next page, to be resolved against the URL that was asked; also in the"
        " header Link. Null on the last one."
    )


QuadrantOut = Literal["pp", "mp", "pm", "mm"]
"""Signs of g1 and g3."""
QUADRANTS_OUT: tuple[QuadrantOut, ...] = get_args(QuadrantOut)

ENDS_IN_WORDS: Mapping[str, str] = {
    "rest": "turns at rest",
    "equator": "crosses the equator",
    "pole": "passes a pole",
    "equilibrium": "tends to an equilibrium",
    "standstill": "comes to a standstill",
    "collision": "runs into a collision",
    "edge": "reaches the edge of the domain",
}
"""Words for what a motion does at an end of its range, by the name of the end."""
STABILITY_IN_WORDS: Mapping[str, str] = {
    "stable": "linearly stable",
    "unstable": "linearly unstable",
    "marginal": "not decided by the linear equation",
}
"""Words for how a motion is against leaving its plane, by the verdict."""


def range_in_words(ends: Iterable[str]) -> str:
    """Return what a motion does at the ends of its range, each once."""
    return ", ".join(dict.fromkeys(ENDS_IN_WORDS[end] for end in ends))
