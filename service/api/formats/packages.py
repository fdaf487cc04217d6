"""A sweep as one file that others can read without this program: a ZIP with a Frictionless data package.

The descriptor ``datapackage.json`` (https://datapackage.org, version 2.0)
names the files beside it with their sizes, checksums, columns and units.
Points are written piece by piece, so that memory does not grow with the sweep.
"""

import hashlib
import json
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime

from service.api.formats.columns import ColumnKind, Sink, units_of
from service.schemas.reading.documents import Part, instant_text

POINTS, DOCUMENT, DESCRIPTOR = "points.parquet", "sweep.json", "datapackage.json"
PROFILE = "https://datapackage.org/profiles/2.0/datapackage.json"
ZIP = "application/zip"
_TYPES: Mapping[ColumnKind, str] = {
    "integer": "integer",
    "number": "number",
    "word": "string",
    "series": "list",
}


@dataclass(frozen=True, slots=True)
class Package:
    """The contents of a sweep's descriptor."""

    sweep: str
    """Its id."""
    document: Part
    finished_at: datetime
    kinds: Mapping[str, ColumnKind]
    errors: Mapping[str, str]
    """For each column that has one, the column with the bounds of its errors."""
    provenance: Part


def package(about: Package, parquet: Iterable[bytes]) -> Iterator[bytes]:
    """Yield the ZIP file; ``parquet`` are the pieces of the points' file."""
    sink, archive = Sink(), _Archive(about.finished_at)
    with zipfile.ZipFile(sink, "w") as file:
        for name, pieces in (
            (DOCUMENT, [_json(about.document)]),
            (POINTS, parquet),
            # Last: it has the checksums of the others.
            (DESCRIPTOR, archive.descriptor(about)),
        ):
            with file.open(archive.entry(name), "w", force_zip64=True) as member:
                for piece in pieces:
                    member.write(piece)
                    archive.count(name, piece)
                    yield sink.take()
    yield sink.take()


@dataclass(slots=True)
class _Archive:
    """Sizes and checksums of what has been written."""

    made: datetime
    _sizes: dict[str, int] = field(default_factory=dict)
    _hashes: dict[str, "hashlib._Hash"] = field(default_factory=dict)

    def entry(self, name: str) -> zipfile.ZipInfo:
        """Return the entry of a file; the same sweep gives the same bytes, whenever it is asked for."""
        return zipfile.ZipInfo(name, self.made.timetuple()[:6])

    def count(self, name: str, piece: bytes) -> None:
        """Add a piece to the size and the checksum of a file."""
        self._sizes[name] = self._sizes.get(name, 0) + len(piece)
        self._hashes.setdefault(name, hashlib.sha256()).update(piece)

    def descriptor(self, about: Package) -> Iterator[bytes]:
        """Yield the descriptor, once all else has been written."""
        yield _json(
            {
                "$schema": PROFILE,
                "name": f"polhode-sweep-{about.sweep}",
                "id": f"urn:uuid:{about.sweep}",
                "title": "Motions of a rigid body about a fixed point: a sweep over numbers of one problem",
                "created": instant_text(about.finished_at),
                "provenance": about.provenance,
                "resources": [
                    {
                        **self._resource("points", POINTS, "parquet", "application/vnd.apache.parquet"),
                        "description": "A row for each point; `outcome` is `solved`, or why not.",
                        "schema": {"fields": list(_fields(about)), "primaryKey": ["index"]},
                    },
                    {
                        **self._resource("sweep", DOCUMENT, "json", "application/json"),
                        "description": "The document that POST /v1/sweeps takes to compute the same again.",
                    },
                ],
            }
        )

    def _resource(self, name: str, path: str, format_name: str, media_type: str) -> Part:
        return {
            "name": name,
            "path": path,
            "format": format_name,
            "mediatype": media_type,
            "bytes": self._sizes[path],
            "hash": f"sha256:{self._hashes[path].hexdigest()}",
        }


def _fields(about: Package) -> Iterator[dict[str, object]]:
    units = units_of(about.kinds)
    for name, kind in about.kinds.items():
        described: dict[str, object] = {"name": name, "type": _TYPES[kind]}
        if name in units:
            described["unit"] = units[name]
        if name in about.errors:
            described["errorBound"] = about.errors[name]
        if kind == "series":
            described["itemType"] = "number"
        yield described


def _json(document: Part) -> bytes:
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False).encode() + b"\n"
