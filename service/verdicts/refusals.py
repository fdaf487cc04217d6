"""Refusals of problems, as documents: ``{"error": {code, detail, pointer, …}}``.

Whoever asks for a λ without motions is given those that have some, by a search of bounded time.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.arcs_of_loop import PassageUndecidedError
from service.dynamics.reduction.existence import find_existence
from service.dynamics.reduction.root_finding.gap import SeparatrixUndecidedError
from service.dynamics.reduction.structure import SignsUnsettledError
from service.dynamics.reduction.windows import NoMotionError, NoSuchWindowError, SeveralWindowsError
from service.dynamics.verdict.own_curve import InadmissibleMotionError
from service.dynamics.verdict.verdict import Verdict
from service.schemas.reading.documents import Document, InvalidProblemError, Part
from service.schemas.replies.text import existence_sentence
from service.schemas.replies.verdict import ExistenceOut
from service.verdicts.documents import existence_document, motion_counterexample, window_document

_POTENTIAL = "/potential"
UNSETTLED = (SignsUnsettledError, SeparatrixUndecidedError, PassageUndecidedError)
"""Errors by which windows are refused that may exist all the same, whatever the verdict."""


def answer_or_refusal(document: Part, judge: Callable[[Part], Document]) -> Document:
    """Return what ``judge`` answers to a document, or the refusal that it raises."""
    try:
        return judge(document)
    except InvalidProblemError as error:
        return {"error": _invalid(error)}
    except (SeveralWindowsError, NoSuchWindowError) as error:
        windows = [window_document(window) for window in error.windows]
        return refusal(error.code, error.message, error.pointer, windows=windows)
    except InadmissibleMotionError as error:
        example = motion_counterexample(error)
        return refusal(error.code, error.message, error.pointer, counterexample=example)
    except DynamicsError as error:
        return refusal(error.code, error.message, error.pointer)


def refusal_of_reading(document: object, read: Callable[[object], object]) -> Document | None:
    """Return the error of a document that ``read`` refuses, None if it does not.

    Call it before passing a document to a child as text: JSON numbers outside the
    range of doubles cannot be written as JSON again.
    """
    try:
        read(document)
    except InvalidProblemError as error:
        return _invalid(error)
    return None


def refusal_of_verdict(verdict: Verdict, answer: Document, accepts: bool) -> Document | None:
    """Return the refusal of a planar motion whose potential is not proved admissible.

    A motion that ``accepts`` an undecided potential is judged on its own curve.
    """
    if verdict.verdict == "inadmissible":
        detail = (
            "the potential does not satisfy the compatibility equation, hence there is no family of motions "
            f"with q = 0 and zero areas integral; {_what_fails(verdict)}"
        )
        return refusal("inadmissible_potential", detail, _POTENTIAL, counterexample=answer["counterexample"])
    if verdict.verdict == "undecided" and not accepts:
        doubt = "" if verdict.evidence is None else f"; not proved: {verdict.evidence.doubt}"
        detail = f"neither a proof nor a counterexample was found{doubt}"
        return refusal("undecided_potential", detail, _POTENTIAL, evidence=answer["evidence"])
    return None


def refusal_of_windows(error: DynamicsError, verdict: Verdict) -> Document:
    """Return the refusal of a motion whose windows are not settled, with the verdict, which is."""
    return refusal(error.code, error.message, error.pointer, verdict=verdict.verdict)


def refusal(code: str, detail: str, pointer: str = "", **extras: object) -> Document:
    """Return a refusal for the reason ``code``, by the part of the problem at ``pointer``."""
    return {"error": {"code": code, "detail": detail, "pointer": pointer, **extras}}


def with_extras(answer: Part, **extras: object) -> Document:
    """Return a refusal with further fields."""
    return {"error": {**answer["error"], **extras}}


def _what_fails(verdict: Verdict) -> str:
    if verdict.jump is None:
        return "the residual at the point given is certainly not 0"
    name = "potential" if verdict.jump.of == "potential" else "energy of the motion"
    return f"the {name} certainly jumps where the curves cross a line through the point given"


def _invalid(error: InvalidProblemError) -> Document:
    faults = [{"pointer": f.pointer, "code": f.code, "message": f.message} for f in error.faults]
    return {"code": "invalid_problem", "detail": str(error), "pointer": "", "faults": faults}


PROCESSOR_SECONDS, SECONDS = 1.0, 3.0
"""After either limit the search for λ with motions leaves the rest undecided."""


def deadline(processor: float, clock: float) -> Callable[[], bool]:
    """Return a function that tells whether so many seconds of the processor or of the clock are over."""
    processor, clock = time.process_time() + processor, time.monotonic() + clock
    return lambda: time.process_time() > processor or time.monotonic() > clock


@dataclass(slots=True)
class Deadline:
    """Tells whether the time is over; once it has said so, it always does."""

    is_over: Callable[[], bool]
    was_reached: bool = False

    def __call__(self) -> bool:
        """Tell it."""
        self.was_reached = self.was_reached or self.is_over()
        return self.was_reached


class Searches:
    """Cached searches for λ with motions: one for all problems that differ in λ only."""

    def __init__(self, left: int) -> None:
        self._left = left
        self._found: dict[tuple[object, ...], Document | None] = {}

    def document(self, body: RigidBody, potential: Potential, motion: PlanarMotion) -> Document | None:
        """Return the answer; None if there is none, or no search is left."""
        key = (body.A, body.C, potential, motion.nu is None, motion.sign_of_g1, motion.g3_sign)
        if key not in self._found:
            if not self._left:
                return None
            self._left -= 1
            found = find_existence(body, potential, motion, deadline(PROCESSOR_SECONDS, SECONDS))
            self._found[key] = None if found is None else existence_document(found)
        return self._found[key]


def refusal_without_motion(error: NoMotionError, existence: Document | None) -> Document:
    """Return the refusal of a motion that does not exist, with what a search has found, if anything."""
    if existence is None:
        return refusal(error.code, error.message, error.pointer)
    where = existence_sentence(ExistenceOut.model_validate(existence))
    return refusal(error.code, f"{error.message}; {where}", error.pointer, existence=existence)
