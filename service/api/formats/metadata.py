"""What a Parquet file says of itself: the document, where the numbers come from, their units and errors."""

import json
from collections.abc import Iterable, Mapping

PREFIX = "polhode."
"""Before every name, so that a file may have metadata of others too."""

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
