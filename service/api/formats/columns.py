"""Columns as files: their kinds, units and metadata, a buffer for written bytes, and NPZ."""

import io
import json
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from service.jobs.records import SweepRecord
from service.schemas.reading.documents import Document
from service.versions import version_of

ColumnKind = Literal["integer", "number", "word", "series", "instant", "truth"]
"""The values of a column; NaN becomes null, and so does a series of NaN only."""


class Sink(io.RawIOBase):
    """Buffers written bytes until they are taken."""

    def __init__(self) -> None:
        super().__init__()
        self._held = bytearray()
        self._before = 0

    def writable(self) -> bool:
        """Tell that it can be written to."""
        return True

    def tell(self) -> int:
        """Return how many bytes have been written in all."""
        return self._before + len(self._held)

    def write(self, data: "memoryview | bytes") -> int:  # type: ignore[override]
        """Buffer some bytes."""
        self._held += data
        return len(data)

    def take(self) -> bytes:
        """Return what was written since the last time."""
        piece = bytes(self._held)
        self._before += len(piece)
        self._held.clear()
        return piece


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


def metadata(about: Document) -> dict[str, str]:
    """Return the metadata of a file: each value as JSON."""
    return {PREFIX + name: json.dumps(value, allow_nan=False) for name, value in about.items()}


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


def provenance_of_points(record: SweepRecord) -> Document:
    """Return what computed the points, and how many there are."""
    return {
        "version": version_of("polhode"),
        "points": record.points,
        "done": record.done,
        "way": record.way,
        "computed_by": list(map(dict, record.provenances)),
    }


def errors_of_points(columns: Sequence[str], series: Sequence[str]) -> dict[str, str]:
    """Return for columns of points the ones that hold the bounds of their errors."""
    errors = {name: f"{name}.{ERROR}" for name in columns if f"{name}.{ERROR}" in columns}
    return errors | {name: ERROR for name in series if ERROR in columns}


NOT_COMPUTED = -1
"""The code of a point without an outcome."""


def npz_file(arrays: Mapping[str, NDArray[np.generic]]) -> bytes:
    """Return an archive of arrays; a pointer such as /body/A is called body/A in it."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        # Not np.savez: a pointer such as /body/A is no name of its parameters, nor of a file.
        for name, values in arrays.items():
            with file.open(f"{name.lstrip('/')}.npy", "w") as member:
                np.lib.format.write_array(member, np.ascontiguousarray(values), allow_pickle=False)
    return buffer.getvalue()


def coded(words: NDArray[np.object_]) -> tuple[NDArray[np.int16], NDArray[np.str_]]:
    """Return for each word its index in the list of the words that occur, and that list.

    The index of None is ``NOT_COMPUTED``. As text of fixed length a million words would be 40 MB.
    """
    flat: list[str | None] = words.ravel().tolist()
    found = dict.fromkeys(word for word in flat if word is not None)
    indices: dict[str | None, int] = {None: NOT_COMPUTED}
    indices.update((word, index) for index, word in enumerate(found))
    codes = np.fromiter(map(indices.__getitem__, flat), dtype=np.int16, count=len(flat))
    return codes.reshape(words.shape), np.array(list(found), dtype=np.str_)
