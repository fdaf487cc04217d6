"""From documents to problems, and the one document of every problem."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass

from service.dynamics.body import RigidBody
from service.dynamics.numerics import NUMERICS
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion, Problem, StateMotion
from service.schemas.faults import Fault, InvalidProblemError
from service.schemas.motions import PlanarMotionIn, StateMotionIn
from service.schemas.parts import read_parts
from service.schemas.potential_model import PotentialModel
from service.schemas.rules import combination_faults, read_setting
from service.schemas.sections import (
    OUTPUTS,
    BodyIn,
    PointsIn,
    ProblemIn,
    TimeListIn,
    TimePeriodsIn,
    TimeSpanIn,
    ValidationIn,
)
from service.schemas.tiers import BudgetIn, TierIn, ToleranceIn

MAX_FAULTS = 200
"""Listed at once: a list of 100 000 wrong numbers is told from its beginning."""


@dataclass(frozen=True, slots=True)
class CheckedProblem:
    """A problem and its canonical document."""

    problem: Problem
    canonical: dict[str, object]


@dataclass(frozen=True, slots=True)
class Question:
    """What a verdict is asked on; the motion may be missing."""

    body: RigidBody
    potential: Potential
    motion: PlanarMotion | StateMotion | None
    w: tuple[float, ...] = ()
    """Where F is wanted by its values."""
    g2: tuple[float, ...] = ()
    """Where G is."""


def read_problem(document: object) -> Problem:
    """Return the problem that ``document`` states.

    Raises
    ------
    InvalidProblemError
        Holds every fault that was found.
    """
    return check_problem(document).problem


def canonical_document(document: object) -> dict[str, object]:
    """Return the canonical form of a problem document; raises as :func:`read_problem`.

    Numbers are exact, as strings; formulas are printed anew; defaults are
    filled in. Documents that state the same problem have the same form.
    """
    return check_problem(document).canonical


def problem_digest(canonical: Mapping[str, object]) -> str:
    """Return the SHA-256, in hexadecimal, of a canonical document and the version of the numerics."""
    content = json.dumps({"numerics": NUMERICS, "problem": canonical}, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(content.encode()).hexdigest()


def check_problem(document: object) -> CheckedProblem:
    """Return the problem and its canonical document; raises as :func:`read_problem`."""
    parts, faults = read_parts(document, ProblemIn)
    faults += combination_faults(document, parts)
    body, potential = read_setting(document, parts, faults)
    match (body, potential, parts):
        case (
            RigidBody(),
            Potential(),
            {
                "body": BodyIn() as body_in,
                "potential": PotentialModel() as potential_in,
                "motion": (PlanarMotionIn() | StateMotionIn()) as motion_in,
                "time": (TimeSpanIn() | TimePeriodsIn() | TimeListIn()) as time_in,
                "accuracy": (ToleranceIn() | TierIn() | BudgetIn()) as accuracy_in,
                "method": ("auto" | "quadrature" | "integration" | "both") as method,
                "outputs": list(wanted),
            },
        ) if not faults:
            outputs = tuple(name for name in OUTPUTS if name in wanted)
            return CheckedProblem(
                Problem(
                    body,
                    potential,
                    motion_in.to_domain(),
                    time_in.to_domain(),
                    accuracy_in.to_domain(),
                    method,
                    outputs,
                ),
                {
                    "body": body_in.canonical(),
                    "potential": potential_in.canonical(),
                    "motion": motion_in.canonical(),
                    "time": time_in.canonical(),
                    "accuracy": accuracy_in.canonical(),
                    "method": method,
                    "outputs": list(outputs),
                },
            )
    raise InvalidProblemError(each_once(faults))


def read_question(document: object) -> Question:
    """Return what a verdict is asked on.

    Raises
    ------
    InvalidProblemError
        Holds every fault that was found.
    """
    parts, faults = read_parts(document, ValidationIn)
    faults += combination_faults(document, parts)
    body, potential = read_setting(document, parts, faults)
    motion_in = parts.get("motion")
    if isinstance(body, RigidBody) and isinstance(potential, Potential) and not faults:
        motion = motion_in.to_domain() if isinstance(motion_in, PlanarMotionIn | StateMotionIn) else None
        points = parts.get("points")
        if not isinstance(points, PointsIn):
            return Question(body, potential, motion)
        w, g2 = (tuple(map(float, values)) for values in (points.w, points.g2))
        return Question(body, potential, motion, w, g2)
    raise InvalidProblemError(each_once(faults))


def each_once(faults: list[Fault]) -> list[Fault]:
    """Drop what two checks found alike; of very many faults, keep the first and say how many there are."""
    seen: dict[tuple[str, str], Fault] = {}
    for fault in faults:
        seen.setdefault((fault.pointer, fault.code), fault)
    kept = list(seen.values())
    if len(kept) <= MAX_FAULTS:
        return kept
    rest = Fault("", "more_faults", f"{len(kept) - MAX_FAULTS} more faults are not listed")
    return [*kept[:MAX_FAULTS], rest]
