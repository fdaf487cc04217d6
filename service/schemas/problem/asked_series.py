"""Reads only the times and the functions of time that a stored problem asks for."""

from collections.abc import Mapping

from pydantic import ConfigDict, Field

from service.dynamics.motion import COLUMNS
from service.schemas.problem.sections import DEFAULT_OUTPUTS, OutputName, TimeIn
from service.schemas.reading.choices import WireModel


class AskedSeries(WireModel):
    """The fields of a problem that select the samples; the rest is not read."""

    model_config = ConfigDict(extra="ignore")

    time: TimeIn
    outputs: list[OutputName] = Field(default_factory=lambda: list(DEFAULT_OUTPUTS))

    def columns(self) -> list[str]:
        """Return the names of the requested ones among the six variables."""
        return [name for name in COLUMNS if ("gamma" if name.startswith("g") else "omega") in self.outputs]


def asked_series(document: Mapping[str, object]) -> AskedSeries:
    """Read the times and outputs of a problem document that was accepted before."""
    return AskedSeries.model_validate(document)
