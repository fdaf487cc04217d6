"""Answers questions about integrals and potentials as documents. Runs in a child that can be killed."""

import json
from collections.abc import Callable, Mapping
from functools import partial

from service.dynamics.discovery.integral_search import search_integrals
from service.dynamics.discovery.judgement import judge_integral, judge_relation
from service.dynamics.discovery.potential_search import search_potentials
from service.dynamics.discovery.setting import LetteredSetting, Tell, read_setting, untold
from service.dynamics.exact import exact_number
from service.schemas.reading.documents import Document, Part
from service.schemas.study.lettered import moment_of
from service.schemas.study.reading import What
from service.verdicts.refusals import Deadline, answer_or_refusal, deadline, refusal

PROCESSOR_SECONDS, SECONDS = 6.0, 8.0
"""After either limit what is not proved is reported as such; a job then goes on."""
JOB_PROCESSOR_SECONDS, JOB_SECONDS = 180.0, 240.0
"""The same limits of a job, for which nobody waits."""


def examine_study(document_json: str) -> str:
    """Answer a document with ``what``, for a client that waits, as JSON.

    ``{"verdict": answer, "is_late": …}``, where ``is_late`` tells that something is open since the time was
    over, or ``{"error": …}``.
    """
    return _answer(document_json, PROCESSOR_SECONDS, SECONDS)


def examine_study_of_job(document_json: str, tell: Tell) -> str:
    """Answer the same with the time of a job; ``tell`` is told how far it is."""
    return _answer(document_json, JOB_PROCESSOR_SECONDS, JOB_SECONDS, tell)


def _answer(document_json: str, processor: float, clock: float, tell: Tell = untold) -> str:
    document: Part = json.loads(document_json)
    is_late = Deadline(deadline(processor, clock))
    judge = QUESTIONS[document["what"]]

    def examine(asked: Part) -> Document:
        try:
            found = judge(asked, is_late, tell)
        except TimeoutError:
            detail = f"no answer within {processor:g} s of processor time; a smaller degree may have one"
            return {"is_late": True, **refusal("time_limit", detail, "/degree")}
        return {"verdict": found, "is_late": is_late.was_reached}

    return json.dumps(answer_or_refusal(document, examine), allow_nan=False)


def _judged(document: Part, is_late: Callable[[], bool], _: Tell) -> Document:
    setting, areas_zero = _setting(document), document.get("areas") is not None
    judge = judge_relation
    if not document.get("relation"):
        judge = partial(judge_integral, relations=document.get("relations") or ())
    return judge(setting, document["function"], areas_zero=areas_zero, is_late=is_late).to_document()


def _integrals(document: Part, is_late: Callable[[], bool], tell: Tell) -> Document:
    degree: Part = document["degree"]
    omega, gamma = (int(exact_number(degree[name])) for name in ("omega", "gamma"))
    areas_zero = document.get("areas") is not None
    return search_integrals(
        _setting(document), omega, gamma, areas_zero=areas_zero, is_late=is_late, tell=tell
    ).to_document()


def _potentials(document: Part, is_late: Callable[[], bool], tell: Tell) -> Document:
    body: Part = document.get("body") or {}
    ratio = exact_number(body["A"]) / exact_number(body["C"]) if body else None
    return search_potentials(ratio, int(exact_number(document["degree"])), is_late, tell).to_document()


def _setting(document: Part) -> LetteredSetting:
    body, potential = document.get("body") or {}, document["potential"]
    moments = {name: moment_of(value) for name, value in body.items() if value is not None}
    parameters = {
        name: None if value is None else exact_number(value)
        for name, value in (potential.get("parameters") or {}).items()
    }
    return read_setting(moments, potential["expression"], parameters)


Judge = Callable[[Part, Callable[[], bool], Tell], Document]
QUESTIONS: Mapping[What, Judge] = {"integral": _judged, "integrals": _integrals, "potentials": _potentials}
"""The kinds of question that are answered here."""
