"""The problem that the parts of a document state, and its canonical document."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import ClassicalMotion, PlanarMotion, Problem, StateMotion
from service.schemas.problem.classical_motion import ClassicalMotionIn
from service.schemas.problem.motions import PlanarMotionIn, StateMotionIn
from service.schemas.problem.potential_model import PotentialModel
from service.schemas.problem.potentials import GravityIn
from service.schemas.problem.sections import (
    OUTPUTS,
    BodyIn,
    TimeListIn,
    TimePeriodsIn,
    TimeSpanIn,
)
from service.schemas.problem.tiers import BudgetIn, RelativeIn, TierIn, ToleranceIn
from service.schemas.reading.faults import Fault


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
class Reading:
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
                    "accuracy": (ToleranceIn() | RelativeIn() | TierIn() | BudgetIn()) as accuracy_in,
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
