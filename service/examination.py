"""What is found out about a potential before any job is made. Runs in a child that can be killed.

A verdict may take unforeseeably long, or crash inside a compiled library, for
some formulas; hence documents go in and come out as JSON text, and the caller
puts the limits.
"""

import json
from collections.abc import Callable

from flint import ctx

from service.answers import (
    Document,
    Points,
    decomposition_document,
    nearest_document,
    verdict_document,
    window_document,
)
from service.dynamics.errors import DynamicsError
from service.dynamics.problem import PlanarMotion, Problem, StateMotion, TimePeriods
from service.dynamics.reduction.start import starting_point
from service.dynamics.reduction.window import Window
from service.dynamics.reduction.windows import (
    PRECISION,
    SeveralWindowsError,
    choose_window,
    find_windows,
    require_inside_domain,
)
from service.dynamics.sampling import PeriodNeededError
from service.dynamics.verdict.verdict import Verdict, decide
from service.schemas.faults import InvalidProblemError
from service.schemas.problem import read_problem, read_question

Answer = Document

_POTENTIAL = "/potential"


def examine_question(document_json: str) -> str:
    """Answer a validation: ``{"verdict": …}`` or ``{"error": {code, detail, pointer, …}}``, as JSON."""
    return _answer(document_json, _judge_question)


def examine_problem(document_json: str) -> str:
    """Answer whether a problem can be solved as asked: ``{"verdict": …}`` or ``{"error": …}``, as JSON.

    The error is what its job would end with. A state has no verdict: null.
    """
    return _answer(document_json, _judge_problem)


def examine_problems(documents_json: str) -> str:
    """Answer for each problem of a list as :func:`examine_problem`; equal potentials are judged once."""
    verdicts: dict[str, Verdict] = {}

    def judge(document: object) -> Answer:
        return _judge_problem(document, verdicts)

    answers = [_answer_to(document, judge) for document in json.loads(documents_json)]
    return json.dumps(answers, allow_nan=False)


def answer_ping() -> str:
    """Answer that the child lives."""
    return "alive"


def _answer(document_json: str, judge: Callable[[object], Answer]) -> str:
    return json.dumps(_answer_to(json.loads(document_json), judge), allow_nan=False)


def _answer_to(document: object, judge: Callable[[object], Answer]) -> Answer:
    try:
        return judge(document)
    except InvalidProblemError as error:
        faults = [{"pointer": f.pointer, "code": f.code, "message": f.message} for f in error.faults]
        return _error("invalid_problem", str(error), faults=faults)
    except SeveralWindowsError as error:
        windows = [window_document(window) for window in error.windows]
        return _error(error.code, error.message, error.pointer, windows=windows)
    except DynamicsError as error:
        return _error(error.code, error.message, error.pointer)


def _judge_question(document: object) -> Answer:
    question = read_question(document)
    verdict = decide(question.body, question.potential)
    answer = verdict_document(verdict, question.potential)
    if verdict.verdict == "inadmissible":
        return {"verdict": {**answer, "nearest": nearest_document(question.body, question.potential)}}
    if verdict.verdict == "admissible":
        points = Points(question.w, question.g2)
        answer["decomposition"] = decomposition_document(question.body, question.potential, points)
    if isinstance(question.motion, PlanarMotion):
        found = find_windows(question.body, question.potential, question.motion)
        answer["motions"] = [window_document(window) for window in found]
    return {"verdict": answer}


def _judge_problem(document: object, known: dict[str, Verdict] | None = None) -> Answer:
    """Judge a problem; ``known`` remembers the verdicts on potentials."""
    problem = read_problem(document)
    if isinstance(problem.motion, StateMotion):
        return {"verdict": None}
    assert isinstance(document, dict)
    known, setting = {} if known is None else known, json.dumps([document["body"], document["potential"]])
    if setting not in known:
        known[setting] = decide(problem.body, problem.potential)
    verdict = known[setting]
    answer = verdict_document(verdict, problem.potential)
    if verdict.verdict == "inadmissible":
        detail = (
            "the potential does not satisfy the compatibility equation, hence there is no family of motions "
            "with q = 0 and zero areas integral; the residual at the point given is certainly not 0"
        )
        return _error("inadmissible_potential", detail, _POTENTIAL, counterexample=answer["counterexample"])
    if verdict.verdict == "undecided":
        detail = "neither a proof nor a counterexample was found within the precision that was tried"
        return _error("undecided_potential", detail, _POTENTIAL, evidence=answer["evidence"])
    window = _require_motion(problem, problem.motion)
    return {"verdict": {**answer, "motions": [window_document(window)]}}


def _require_motion(problem: Problem, motion: PlanarMotion) -> Window:
    """Return the window of the motion, or raise what its job would end with."""
    with ctx.workprec(PRECISION):
        windows = find_windows(problem.body, problem.potential, motion)
        window = choose_window(windows, motion)
        if problem.method != "integration":
            require_inside_domain(window)
        starting_point(window, motion)
    if window.kind != "periodic" and isinstance(problem.time, TimePeriods):
        raise PeriodNeededError(
            f"the motion in window {window.index} has no period ({window.kind}); "
            'accepted are {"start", "stop", "samples"} and {"times"}',
            pointer="/time/periods",
        )
    return window


def _error(code: str, detail: str, pointer: str = "", **extras: object) -> Answer:
    return {"error": {"code": code, "detail": detail, "pointer": pointer, **extras}}
