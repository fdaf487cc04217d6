"""The classical or integrable cases on which the state of a question lies, as a document."""

from math import isfinite

from service.dynamics.classical.classification import Nearness, classify
from service.dynamics.problem import StateMotion
from service.schemas.problem.potentials import GravityIn
from service.schemas.problem.problem import Question
from service.verdicts.documents import Document


def classification_of(question: Question) -> Document | None:
    """Return the classification of a state in a potential of the type gravity; None of any other motion.

    It computes in balls: in a process of many threads the caller holds
    :data:`service.schemas.reading.balls.ONE_AT_A_TIME`.
    """
    motion, stated = question.motion, question.stated
    if not isinstance(motion, StateMotion) or not isinstance(stated, GravityIn) or question.body.B is None:
        return None
    centre = (stated.a, stated.b, stated.c)
    found = classify(question.body, centre, motion.omega, motion.gamma)
    on = [each.case for each in found.cases if each.is_on]
    on += [each.case for each in found.integrable if each.holds]
    nearest = next((each for each in found.cases if each.distance is not None), None)
    return {
        "on": on,
        "nearest": None if nearest is None else _nearness(nearest),
        "cases": [_nearness(each) for each in found.cases],
        "integrable": [
            {"case": each.case, "holds": each.holds, "residuals": dict(each.residuals)}
            for each in found.integrable
        ],
    }


def _nearness(near: Nearness) -> Document:
    relations = {name: left if isfinite(left) else None for name, left in near.relations.items()}
    return {"case": near.case, "distance": near.distance, "is_on": near.is_on, "relations": relations}
