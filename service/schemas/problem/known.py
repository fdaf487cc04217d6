"""Reads documents that differ from one read before in λ alone, without reading the rest again.

Lists, sweeps and clients ask for the same body and potential many times over, at the same times. What is
remembered is known by all of the document but the number that chooses the curve; a document with any fault is
left to those who list all faults.
"""

import marshal
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any, cast  # parts of documents, of which no type is known yet

from pydantic import ValidationError

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import FormulaPotential
from service.dynamics.problem import PlanarMotion, Problem, Sign
from service.schemas.problem.motions import CURVE_FIELDS, PlanarMotionIn
from service.schemas.problem.rules import combination_faults, motion_faults, read_setting
from service.schemas.problem.sections import ProblemIn
from service.schemas.problem.stated import CheckedProblem, Reading
from service.schemas.reading.faults import Fault
from service.schemas.reading.numbers import read_nonzero, read_positive
from service.schemas.reading.parts import read_part

KEPT = 64
"""Documents, and as many settings in them."""
LONGEST = 4096
"""Bytes of what is remembered."""
SETTING, MOTION = ("body", "potential"), "motion"
_OTHERS = tuple(name for name in ProblemIn.model_fields if name not in (*SETTING, MOTION))
_FIELDS = frozenset(ProblemIn.model_fields)
_READ: Mapping[str, Callable[[object], Fraction]] = {"lambda": read_positive, "nu": read_nonzero}
"""The fields that choose the curve by a number, and how that is read."""
_WRITTEN = (str, int, float)
"""Exactly these: a number of another kind may know that no double is near it."""
_FORM = 2
"""Version of marshal's format: equal parts have the same bytes; what is none of Python's own kinds has
none."""


def read_known(document: object) -> CheckedProblem | None:
    """Return the problem that a document states; None if it has faults, or is not of a planar motion."""
    motion = document.get(MOTION) if isinstance(document, dict) else None
    if type(document) is not dict or type(motion) is not dict:
        return None
    field = "lambda" if motion.get("nu") is None else "nu"
    number = motion.get(field)
    if type(number) not in _WRITTEN:
        return None
    # Deep, or not of JSON, or with a fault: others say so.
    with suppress(ValidationError, RecursionError, TypeError, ValueError, KeyError):
        found = _document(_bytes({**document, MOTION: {**motion, field: 1}}))
        if found is not None:
            return _on_curve(found, field, _READ[field](number))
    return None


def _on_curve(found: "_Document", field: str, number: Fraction) -> CheckedProblem:
    """Return the problem on the curve that a number of this field chooses."""
    like, planar = found.problem, found.planar
    # With nu, the sign of g1 is its own.
    by_nu = field == "nu"
    sign: Sign = planar.g1_sign if not by_nu else 1 if number > 0 else -1
    problem = Problem(
        like.body,
        # What is kept beside a formula while it is evaluated is for one problem.
        found.potential.alone(),
        PlanarMotion(
            None if by_nu else number,
            number if by_nu else None,
            sign,
            planar.g3_sign,
            planar.window,
            planar.start,
        ),
        like.time,
        like.accuracy,
        like.method,
        like.outputs,
        like.accept,
    )

    def canonical() -> dict[str, object]:
        motion = found.motion.model_copy(update={CURVE_FIELDS[field]: number})
        checked = Reading({**found.parts, MOTION: motion}, like.body, like.potential, []).problem()
        assert checked is not None
        return checked.canonical

    return CheckedProblem(problem, canonical)


@dataclass(frozen=True, slots=True)
class _Setting:
    parts: Mapping[str, object]
    body: RigidBody
    potential: FormulaPotential


@dataclass(frozen=True, slots=True)
class _Document:
    parts: Mapping[str, object]
    motion: PlanarMotionIn
    problem: Problem
    potential: FormulaPotential
    planar: PlanarMotion
    """The last two are the problem's. It is on some curve, and so is the motion among the parts."""


def _bytes(part: Mapping[str, object]) -> bytes:
    """Return what tells all of a part; raises ValueError where it is long, or not of Python's own kinds."""
    found = marshal.dumps(cast("Any", part), _FORM)
    if len(found) > LONGEST:
        raise ValueError("too long to be remembered")
    return found


def _part(known: bytes) -> dict[str, object]:
    # Bytes that this module has made.
    part: dict[str, object] = marshal.loads(known)
    return part


@lru_cache(maxsize=KEPT)
def _document(known: bytes) -> _Document | None:
    document = _part(known)
    if not document.keys() <= _FIELDS:
        return None
    stated = _setting(_bytes({name: document.get(name) for name in SETTING}))
    if stated is None or any(
        ProblemIn.model_fields[name].is_required() for name in _OTHERS if name not in document
    ):
        return None
    motion = read_part(ProblemIn, MOTION, document)
    if not isinstance(motion, PlanarMotionIn):
        return None
    chosen = {name: read_part(ProblemIn, name, document) for name in _OTHERS}
    parts: dict[str, object] = {**stated.parts, MOTION: motion, **chosen}
    # None of the rules between the parts knows which number chooses the curve.
    if any((*combination_faults(document, parts), *motion_faults(stated.body, document, parts))):
        return None
    checked = Reading(parts, stated.body, stated.potential, []).problem()
    if checked is None or not isinstance(checked.problem.motion, PlanarMotion):
        return None
    return _Document(parts, motion, checked.problem, stated.potential, checked.problem.motion)


@lru_cache(maxsize=KEPT)
def _setting(known: bytes) -> _Setting | None:
    document = _part(known)
    parts = {name: read_part(ProblemIn, name, document) for name in SETTING}
    faults: list[Fault] = []
    body, potential = read_setting({**document, MOTION: {"type": "planar"}}, parts, faults)
    if faults or body is None or not isinstance(potential, FormulaPotential):
        return None
    return _Setting(parts, body, potential)
