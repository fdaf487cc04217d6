"""Reads problem documents and the questions of validations, and names a problem by its digest.

Lists, sweeps and clients ask for the same body and potential many times over, at the same times. Documents
that differ from one read before in λ alone are read without reading the rest again: what is cached is found
by all of the document but the number that chooses the curve; a document with any fault is left to those who
list all faults.
"""

import hashlib
import json
import marshal
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from typing import Any, cast  # parts of documents, of which no type is known yet

from pydantic import ValidationError

from service.dynamics.body import RigidBody
from service.dynamics.numerics import NUMERICS
from service.dynamics.potentials.potential import FormulaPotential, Potential
from service.dynamics.problem import ClassicalMotion, PlanarMotion, Problem, Sign, StateMotion
from service.schemas.problem.documents import MEMBERS, NearestIn, PointsIn, ProblemIn, ValidationIn
from service.schemas.problem.motions import CURVE_FIELDS, PlanarMotionIn
from service.schemas.problem.potentials import PotentialModel
from service.schemas.problem.rules import (
    CheckedProblem,
    Reading,
    combination_faults,
    motion_faults,
    motion_of,
    read_setting,
)
from service.schemas.reading.documents import Fault, InvalidProblemError, first_of
from service.schemas.reading.numbers import read_nonzero, read_positive
from service.schemas.reading.parts import read_part, read_parts

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


ACCURACY_POINTER = "/accuracy"
ACCURACY_FIELDS = ("tolerance", "relative", "tier", "budget_seconds")


@dataclass(frozen=True, slots=True)
class Question:
    """The input of a verdict."""

    body: RigidBody
    potential: Potential
    motion: PlanarMotion | StateMotion | ClassicalMotion | None
    problem: CheckedProblem | None = None
    """The whole problem, if motion and times are given."""
    stated: PotentialModel | None = None
    """The potential with the names of its parameters."""
    w: tuple[float, ...] = ()
    """Arguments at which values of F are wanted."""
    g2: tuple[float, ...] = ()
    """Arguments at which values of G are wanted."""
    nearest_degree: int | None = None
    """Largest degree in the search for the nearest admissible polynomial; None for the default."""


def read_problem(document: object) -> Problem:
    """Return the problem that ``document`` states.

    Raises
    ------
    InvalidProblemError
        Lists every fault.
    """
    return check_problem(document).problem


def problem_digest(canonical: Mapping[str, object]) -> str:
    """Return the SHA-256, in hexadecimal, of a canonical document and the numerics version."""
    content = json.dumps({"numerics": NUMERICS, "problem": canonical}, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(content.encode()).hexdigest()


def check_problem(document: object, model: type[ProblemIn] = ProblemIn) -> CheckedProblem:
    """Return the problem and its canonical document; raises as :func:`read_problem`.

    ``model`` may have further fields, which are no part of the problem.
    """
    known = read_known(document) if model is ProblemIn else None
    if known is not None:
        return known
    reading = _read(document, model)
    checked = None if reading.faults else reading.problem()
    if checked is None:
        raise InvalidProblemError(each_once(reading.faults))
    return checked


def read_question(document: object) -> Question:
    """Read the input of a verdict; with a motion and times it is a whole problem.

    Every part is checked by the rules of :func:`check_problem`.

    Raises
    ------
    InvalidProblemError
        Lists every fault.
    """
    reading = _read(document, ValidationIn)
    body, potential = reading.body, reading.potential
    if body is None or potential is None or reading.faults:
        raise InvalidProblemError(each_once(reading.faults))
    motion_in, points = reading.parts.get("motion"), reading.parts.get("points")
    stated = reading.parts.get("potential")
    motion = motion_of(motion_in, stated)
    question = Question(body, potential, motion, reading.problem())
    if isinstance(stated, PotentialModel):
        question = replace(question, stated=stated)
    nearest = reading.parts.get("nearest")
    if isinstance(nearest, NearestIn):
        question = replace(question, nearest_degree=nearest.degree)
    if not isinstance(points, PointsIn):
        return question
    w, g2 = (tuple(map(float, values)) for values in (points.w, points.g2))
    return replace(question, w=w, g2=g2)


def _read(document: object, model: type[ProblemIn | ValidationIn]) -> Reading:
    parts, faults = read_parts(document, model, MEMBERS)
    faults += combination_faults(document, parts)
    body, potential = read_setting(document, parts, faults)
    return Reading(parts, body, potential, faults)


def place_sent(document: object, pointer: str) -> str:
    """Return the pointer for a solver's accuracy error: the field that set the accuracy.

    Solvers know the required accuracy, not the field it came from. Empty (the whole
    document) if the accuracy was left out.
    """
    if pointer != ACCURACY_POINTER:
        return pointer
    match document:
        case {"accuracy": dict(accuracy)}:
            return next((f"{pointer}/{name}" for name in ACCURACY_FIELDS if name in accuracy), pointer)
    return ""


def each_once(faults: list[Fault]) -> list[Fault]:
    """Drop duplicate faults; of very many faults, keep the first."""
    seen: dict[tuple[str, str], Fault] = {}
    for fault in faults:
        seen.setdefault((fault.pointer, fault.code), fault)
    return first_of(list(seen.values()))
