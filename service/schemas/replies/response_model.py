"""The base class of all answers."""

from typing import Literal, get_args

from pydantic import BaseModel, ConfigDict
from pydantic.config import JsonDict


def _may_grow(schema: JsonDict) -> None:
    """Allow unknown fields in the schema of an answer, so that clients accept fields of later versions."""
    schema.pop("additionalProperties", None)


class ResponseModel(BaseModel):
    """The base class of all answers: every field is always present."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, json_schema_extra=_may_grow)


QuadrantOut = Literal["pp", "mp", "pm", "mm"]
"""Signs of g1 and g3."""
QUADRANTS_OUT: tuple[QuadrantOut, ...] = get_args(QuadrantOut)
