"""What every measurement says of itself that is shipped."""

from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any  # fields of a model

from service.dynamics.numerics import NUMERICS
from service.schemas.reading.documents import instant_text
from service.schemas.replies.installation import MachineOut, ShippedMeasurement
from service.versions import version_of
from workers.calibration.measurement import this_machine


def when_and_where(load: float) -> dict[str, Any]:
    """Return the fields of a measurement that began at a load average and has ended now."""
    told = ShippedMeasurement(
        date=instant_text(datetime.now(UTC), "seconds"),
        version=version_of("polhode"),
        numerics=NUMERICS,
        machine=MachineOut.model_validate(asdict(this_machine())),
        load=round(load, 2),
    )
    return told.model_dump()
