"""Searches for the λ that have motions, told to those who asked for a λ that has none."""

import time
from collections.abc import Callable

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.existence import find_existence
from service.dynamics.reduction.windows import NoMotionError
from service.schemas.replies.existence_text import existence_sentence
from service.schemas.replies.verdict import ExistenceOut
from service.verdicts.documents import Document, existence_document
from service.verdicts.refusals import refusal

PROCESSOR_SECONDS, SECONDS = 1.0, 3.0
"""After either limit the search for λ with motions leaves the rest undecided."""


def deadline(processor: float, clock: float) -> Callable[[], bool]:
    """Return a function that tells whether so many seconds of the processor or of the clock are over."""
    processor, clock = time.process_time() + processor, time.monotonic() + clock
    return lambda: time.process_time() > processor or time.monotonic() > clock


class Searches:
    """Cached searches for λ with motions: one for all problems that differ in λ only."""

    def __init__(self, left: int) -> None:
        self._left = left
        self._known: dict[tuple[object, ...], Document | None] = {}

    def document(self, body: RigidBody, potential: Potential, motion: PlanarMotion) -> Document | None:
        """Return the answer; None if there is none, or no search is left."""
        key = (body.A, body.C, potential, motion.nu is None, motion.sign_of_g1, motion.g3_sign)
        if key not in self._known:
            if not self._left:
                return None
            self._left -= 1
            found = find_existence(body, potential, motion, deadline(PROCESSOR_SECONDS, SECONDS))
            self._known[key] = None if found is None else existence_document(found)
        return self._known[key]


def refusal_without_motion(error: NoMotionError, existence: Document | None) -> Document:
    """Return the refusal of a motion that does not exist, with what a search has found, if anything."""
    if existence is None:
        return refusal(error.code, error.message, error.pointer)
    where = existence_sentence(ExistenceOut.model_validate(existence))
    return refusal(error.code, f"{error.message}; {where}", error.pointer, existence=existence)
