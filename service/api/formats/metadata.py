"""The metadata of a Parquet file: the document, the origin of the numbers, their units and errors."""

import json
from collections.abc import Iterable, Mapping, Sequence

from service.jobs.records import SweepRecord
from service.versions import version_of

PREFIX = "polhode."
"""Before every name, so that a file may have metadata of others too."""

ERROR = "error"
"""The kept number that bounds the errors of the samples; NAME.error bounds that of NAME."""

_TIME = "the unit of time of the problem"
_RATE = "radians per unit of time of the problem"
_UNITS = {
    "t": _TIME,
    "period": _TIME,
    "energy": "the unit of energy of the problem",
    **dict.fromkeys(("p", "q", "r"), _RATE),
    **dict.fromkeys(("g1", "g2", "g3", "q0", "q1", "q2", "q3"), "1"),
    **dict.fromkeys(("psi1", "psi3"), "radians"),
}


def units_of(columns: Iterable[str]) -> dict[str, str]:
    """Return the unit of each column that has one; nothing is converted, so units are the client's own."""
    return {name: _UNITS[name] for name in columns if name in _UNITS}


def metadata(about: Mapping[str, object]) -> dict[str, str]:
    """Return the metadata of a file: each thing as JSON."""
    return {PREFIX + name: json.dumps(thing, allow_nan=False) for name, thing in about.items()}


def about_points(record: SweepRecord, columns: Sequence[str], series: Sequence[str]) -> dict[str, str]:
    """Return what a file of points says of the sweep that it is from."""
    return metadata(
        {
            "sweep": record.id,
            "document": dict(record.document),
            "provenance": provenance_of_points(record),
            "units": units_of(columns),
            "errors": errors_of_points(columns, series),
        }
    )


def provenance_of_points(record: SweepRecord) -> dict[str, object]:
    """Return what computed the points, and how many there are."""
    return {
        "version": version_of("polhode"),
        "points": record.points,
        "done": record.done,
        "way": record.way,
    }


def errors_of_points(columns: Sequence[str], series: Sequence[str]) -> dict[str, str]:
    """Return for columns of points the ones that hold the bounds of their errors."""
    errors = {name: f"{name}.{ERROR}" for name in columns if f"{name}.{ERROR}" in columns}
    return errors | {name: ERROR for name in series if ERROR in columns}
