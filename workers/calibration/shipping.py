"""Writes the table that is shipped: ``python -m workers.calibration.shipping [FILE]``."""

import json
import sys
from pathlib import Path

from service.schemas.replies.installation import AccuracyTableModel
from service.storage.solutions.shipped_accuracy import SHIPPED
from workers.calibration.measurement import FULL, calibrate, whole_jobs


def shipped_text() -> str:
    """Measure this machine and return the document as it is committed."""
    with whole_jobs() as seconds_of:
        table = calibrate(FULL, seconds_of, source="shipped")
    return json.dumps(AccuracyTableModel.of(table).model_dump(), indent=1) + "\n"


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else SHIPPED
    target.write_text(shipped_text(), encoding="utf-8")
