"""Of a stored problem only what it asks to see: its times and its functions of time."""

from collections.abc import Mapping

from pydantic import ConfigDict, Field

from service.dynamics.motion import COLUMNS
from service.schemas.choices import WireModel
from service.schemas.sections import DEFAULT_OUTPUTS, OutputName, TimeIn


class AskedSeries(WireModel):
    """The part of a problem that says which samples are wanted; the rest is not read."""

    model_config = ConfigDict(extra="ignore")

    time: TimeIn
    outputs: list[OutputName] = Field(default_factory=lambda: list(DEFAULT_OUTPUTS))

    def columns(self) -> list[str]:
        """Return the names of those of the six variables that are wanted."""
        return [name for name in COLUMNS if ("gamma" if name.startswith("g") else "omega") in self.outputs]


def asked_series(document: Mapping[str, object]) -> AskedSeries:
    """Return what a problem document, which has been accepted before, asks to see."""
    return AskedSeries.model_validate(document)
