"""Reads problem documents, and writes the canonical document of a problem."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from service.dynamics.body import RigidBody
from service.dynamics.numerics import NUMERICS
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import ClassicalMotion, PlanarMotion, Problem, StateMotion
from service.schemas.problem.classical_motion import ClassicalMotionIn
from service.schemas.problem.known import read_known
from service.schemas.problem.members import MEMBERS
from service.schemas.problem.motions import PlanarMotionIn, StateMotionIn
from service.schemas.problem.potential_model import PotentialModel
from service.schemas.problem.potentials import GravityIn
from service.schemas.problem.rules import combination_faults, read_setting
from service.schemas.problem.sections import (
    OUTPUTS,
    BodyIn,
    NearestIn,
    PointsIn,
    ProblemIn,
    TimeListIn,
    TimePeriodsIn,
    TimeSpanIn,
    ValidationIn,
)
from service.schemas.problem.tiers import BudgetIn, TierIn, ToleranceIn
from service.schemas.reading.faults import Fault, InvalidProblemError, first_of
from service.schemas.reading.parts import read_parts

ACCURACY_POINTER = "/accuracy"
ACCURACY_FIELDS = ("tolerance", "tier", "budget_seconds")


@dataclass(frozen=True)
class CheckedProblem:
    """A problem and its canonical document."""

    problem: Problem
    write: Callable[[], dict[str, object]]
    """Makes the canonical document, which takes as long as reading a formula; workers need none."""

    @cached_property
    def canonical(self) -> dict[str, object]:
        """The canonical document: documents that state the same problem have the same.

        In it numbers are exact, as strings; formulas are printed by our printer; defaults are filled in.
        """
        return self.write()


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


@dataclass(frozen=True, slots=True)
class _Reading:
    """The readable parts of a document, and all its faults."""

    parts: dict[str, object]
    body: RigidBody | None
    potential: Potential | None
    faults: list[Fault]

    def problem(self) -> CheckedProblem | None:
        """Return the problem, None if a part is missing."""
        match (self.body, self.potential, self.parts):
            case (
                RigidBody() as body,
                Potential() as potential,
                {
                    "body": BodyIn() as body_in,
                    "potential": PotentialModel() as potential_in,
                    "motion": (PlanarMotionIn() | StateMotionIn() | ClassicalMotionIn()) as motion_in,
                    "time": (TimeSpanIn() | TimePeriodsIn() | TimeListIn()) as time_in,
                    "accuracy": (ToleranceIn() | TierIn() | BudgetIn()) as accuracy_in,
                    "method": ("auto" | "quadrature" | "integration" | "both") as method,
                    "outputs": list(wanted),
                    "accept": ("proved" | "undecided") as accept,
                },
            ):
                outputs = tuple(name for name in OUTPUTS if name in wanted)
                motion = motion_of(motion_in, potential_in)
                if motion is None:
                    return None
                problem = Problem(
                    body,
                    potential,
                    motion,
                    time_in.to_domain(),
                    accuracy_in.to_domain(),
                    method,
                    outputs,
                    accept,
                )

                def canonical() -> dict[str, object]:
                    document: dict[str, object] = {
                        "body": body_in.canonical(),
                        "potential": potential_in.canonical(),
                        "motion": motion_in.canonical(),
                        "time": time_in.canonical(),
                        "accuracy": accuracy_in.canonical(),
                        "method": method,
                        "outputs": list(outputs),
                    }
                    # Left out at its default, so that older documents keep their digests.
                    if accept != "proved" and isinstance(motion_in, PlanarMotionIn):
                        document["accept"] = accept
                    return document

                return CheckedProblem(problem, canonical)
        return None


def motion_of(motion: object, potential: object) -> PlanarMotion | StateMotion | ClassicalMotion | None:
    """Return the motion; that of a classical case knows the centre of its potential."""
    if isinstance(motion, ClassicalMotionIn) and isinstance(potential, GravityIn):
        return motion.to_domain((potential.a, potential.b, potential.c))
    return motion.to_domain() if isinstance(motion, PlanarMotionIn | StateMotionIn) else None


def _read(document: object, model: type[ProblemIn | ValidationIn]) -> _Reading:
    known = read_known(document) if model is ProblemIn else None
    if known is not None:
        return _Reading(known.parts, known.body, known.potential, [])
    parts, faults = read_parts(document, model, MEMBERS)
    faults += combination_faults(document, parts)
    body, potential = read_setting(document, parts, faults)
    return _Reading(parts, body, potential, faults)


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
