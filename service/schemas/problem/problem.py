"""Reads problem documents, and writes the canonical document of a problem."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace

from service.dynamics.body import RigidBody
from service.dynamics.numerics import NUMERICS
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import ClassicalMotion, PlanarMotion, Problem, StateMotion
from service.schemas.problem.known import read_known
from service.schemas.problem.members import MEMBERS
from service.schemas.problem.potential_model import PotentialModel
from service.schemas.problem.rules import combination_faults, read_setting
from service.schemas.problem.sections import (
    NearestIn,
    PointsIn,
    ProblemIn,
    ValidationIn,
)
from service.schemas.problem.stated import CheckedProblem, Reading, motion_of
from service.schemas.reading.faults import Fault, InvalidProblemError, first_of
from service.schemas.reading.parts import read_parts

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
