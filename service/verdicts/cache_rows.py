"""Rows of the cache of examinations: their keys, by what a result depends on, and their checksums.

A verdict depends on the moments of inertia and on the potential; windows depend on the curve too. Both are
found once, and never change for equal versions of what computes them. A row that was damaged is noticed by
its checksum, and found anew.
"""

import hashlib
import json
from dataclasses import dataclass
from functools import cache

from service.dynamics.numerics import NUMERICS
from service.schemas.reading.documents import Part
from service.versions import version_of


def checksum_of(key: str, content: bytes) -> str:
    """Return the checksum, in hexadecimal, of a row; it covers the key: rows cannot be swapped."""
    return hashlib.sha256(key.encode() + b"\n" + content).hexdigest()


def is_sound(key: str, content: bytes, checksum: str) -> bool:
    """Tell whether a row is as it was written."""
    return checksum_of(key, content) == checksum


EXAMINATION_CODE = 3
"""Grows whenever a problem may get another verdict, proof, counterexample or window, in any form."""

_OF_CURVE = ("type", "lambda", "nu", "g1_sign", "g3_sign")
"""Members of a canonical motion that say on which curve it lies: not its window, and not its start."""


@dataclass(frozen=True, slots=True)
class CacheRow:
    """A verdict or the windows of a curve, as JSON text, under its key."""

    key: str
    """SHA-256, in hexadecimal, of what the content depends on."""
    content: str


@dataclass(frozen=True, slots=True)
class Examination:
    """The data about the examination of a problem that are stored with its job."""

    windows: str
    """Key of the windows of its curve."""
    seconds: float
    """Seconds that it took before the job was queued; next to nothing where its result was cached."""


@dataclass(frozen=True, slots=True)
class ExaminationKeys:
    """The keys of what is cached of one problem."""

    verdict: str
    windows: str
    answer: str
    """Key of the whole answer, which depends on the window, the start and the kind of times too."""


@cache
def examination_version() -> str:
    """Return the versions of all that computes verdicts and windows: rows of another one are not used."""
    parts = (version_of("polhode"), NUMERICS, EXAMINATION_CODE, version_of("python-flint"))
    return "/".join(map(str, parts))


def keys_of(canonical: Part) -> ExaminationKeys:
    """Return the keys of a canonical problem with a planar motion."""
    setting, motion = _setting(canonical), canonical["motion"]
    curve = {name: motion[name] for name in _OF_CURVE if name in motion}
    ways = [canonical["method"] == "integration", "periods" in canonical["time"], canonical.get("accept")]
    return ExaminationKeys(
        verdict=_key("verdict", *setting),
        windows=_key("windows", *setting, curve),
        answer=_key("answer", *setting, motion, ways),
    )


def _setting(canonical: Part) -> tuple[object, ...]:
    """Return the moments and the potential; B only where a formula may name it: it plays no other part."""
    body, potential = canonical["body"], canonical["potential"]
    names_B = "B" in json.dumps(potential)
    return body["A"], body["C"], body["B"] if names_B else None, potential


def _key(kind: str, *parts: object) -> str:
    content = json.dumps([kind, examination_version(), *parts], sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(content.encode()).hexdigest()
