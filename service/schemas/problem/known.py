"""Reads documents whose body and potential were read before, without reading these again.

Lists, sweeps and clients ask for the same body and potential many times over. What is remembered is known by
its very text and belongs to no motion; a document with any fault is left to those who list all faults.
"""

import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

from pydantic import ValidationError

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import FormulaPotential, Potential
from service.schemas.problem.motions import PlanarMotionIn
from service.schemas.problem.rules import combination_faults, motion_faults, read_setting
from service.schemas.problem.sections import ProblemIn
from service.schemas.reading.faults import Fault
from service.schemas.reading.parts import read_part

T = TypeVar("T")

KEPT = 64
"""Settings, and as many choices of times, accuracy and outputs."""
LONGEST = 4096
"""Characters of what is remembered."""
SETTING, MOTION = ("body", "potential"), "motion"
_PLAIN = frozenset((str, int, float, bool, type(None)))
_FIELDS = frozenset(ProblemIn.model_fields)
_OTHERS = tuple(name for name in ProblemIn.model_fields if name not in (*SETTING, MOTION))


@dataclass(frozen=True, slots=True)
class KnownProblem:
    """The parts of a document without any fault."""

    parts: dict[str, object]
    body: RigidBody
    potential: Potential


def read_known(document: object) -> KnownProblem | None:
    """Return the parts of the document of a planar problem; None if it has faults, or is not of this kind."""
    if not isinstance(document, dict) or not document.keys() <= _FIELDS or not _is_plain(document):
        return None
    setting = {name: document.get(name) for name in SETTING}
    others = {name: document[name] for name in _OTHERS if name in document}
    # Deep, or not of JSON, or with a fault: others say so.
    with suppress(ValidationError, RecursionError, TypeError, ValueError, KeyError):
        stated, chosen = _remembered(_setting, setting), _remembered(_choices, others)
        motion = None if stated is None or chosen is None else read_part(ProblemIn, MOTION, document)
        if stated is None or chosen is None or not isinstance(motion, PlanarMotionIn):
            return None
        parts: dict[str, object] = {**stated.parts, MOTION: motion, **chosen}
        faults = (*combination_faults(document, parts), *motion_faults(stated.body, document, parts))
        if not faults:
            # What is kept beside a formula while it is evaluated is for one problem.
            return KnownProblem(parts, stated.body, stated.potential.alone())
    return None


def _is_plain(value: object, depth: int = 8) -> bool:
    """Say whether the text of a value tells all of it: a number may know that no double is near it."""
    kind = type(value)
    if kind in _PLAIN:
        return True
    if not depth or not isinstance(value, dict | list) or kind not in (dict, list):
        return False
    inside = value.values() if isinstance(value, dict) else value
    return all(_is_plain(each, depth - 1) for each in inside)


@dataclass(frozen=True, slots=True)
class _Setting:
    parts: Mapping[str, object]
    body: RigidBody
    potential: FormulaPotential


def _remembered(read: Callable[[str], T | None], part: Mapping[str, object]) -> T | None:
    text = json.dumps(part)
    return read(text) if len(text) <= LONGEST else None


@lru_cache(maxsize=KEPT)
def _setting(text: str) -> _Setting | None:
    document = json.loads(text)
    parts = {name: read_part(ProblemIn, name, document) for name in SETTING}
    faults: list[Fault] = []
    body, potential = read_setting({**document, MOTION: {"type": "planar"}}, parts, faults)
    if faults or body is None or not isinstance(potential, FormulaPotential):
        return None
    return _Setting(parts, body, potential)


@lru_cache(maxsize=KEPT)
def _choices(text: str) -> dict[str, object]:
    document = json.loads(text)
    if any(ProblemIn.model_fields[name].is_required() for name in _OTHERS if name not in document):
        raise KeyError(text)
    return {name: read_part(ProblemIn, name, document) for name in _OTHERS}
