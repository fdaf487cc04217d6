"""What is found out about a potential before any job is made. Runs in a child that can be killed.

A verdict may take unforeseeably long, or crash inside a compiled library, for
some formulas; hence documents go in and come out as JSON text, and the caller
puts the limits.
"""

import json
import time
from collections.abc import Callable

from flint import ctx

from service.answers import (
    NAMELESS,
    Document,
    Points,
    decomposition_document,
    decomposition_of,
    energy_document,
    existence_document,
    nearest_document,
    plan_document,
    verdict_document,
    window_document,
)
from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.inverse.curve_function import NoDecompositionError
from service.dynamics.inverse.named import Named
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion, Problem, StateMotion, TimePeriods
from service.dynamics.reduction.ends import require_known_ends
from service.dynamics.reduction.existence import find_existence
from service.dynamics.reduction.start import starting_point
from service.dynamics.reduction.window import Window
from service.dynamics.reduction.windows import (
    PRECISION,
    NoMotionError,
    NoSuchWindowError,
    SeveralWindowsError,
    choose_window,
    find_windows,
)
from service.dynamics.sampling import PeriodNeededError
from service.dynamics.verdict.verdict import Verdict, decide
from service.schemas.existence_text import existence_sentence
from service.schemas.faults import InvalidProblemError
from service.schemas.problem import Question, read_problem, read_question
from service.schemas.verdict import ExistenceOut

Answer = Document

PROCESSOR_SECONDS, SECONDS = 1.0, 3.0
"""After either of which a search for the λ that have motions leaves undecided what it has not found."""
MOST_SEARCHES = 4
"""In the problems of one list: a search for the λ that have motions takes some tenths of a second."""
_POTENTIAL = "/potential"


def examine_question(document_json: str) -> str:
    """Answer a validation: ``{"verdict": …}`` or ``{"error": {code, detail, pointer, …}}``, as JSON.

    A whole problem is judged by what judges jobs: its error is that of :func:`examine_problem`.
    """
    return _answer(document_json, _judge_question)


def examine_problem(document_json: str, *, explains: bool = True) -> str:
    """Answer whether a problem can be solved as asked: ``{"verdict": …}`` or ``{"error": …}``, as JSON.

    The error is what its job would end with. A state has no verdict: null. Where there is no motion,
    an answer that ``explains`` says for which λ there are.
    """
    searches = _Searches(1 if explains else 0)
    return _answer(document_json, lambda document: _judge_problem(document, {}, searches))


def examine_problems(documents_json: str) -> str:
    """Answer for each problem of a list as :func:`examine_problem`; equal potentials are judged once."""
    verdicts: dict[str, Verdict] = {}
    searches = _Searches(MOST_SEARCHES)

    def judge(document: object) -> Answer:
        return _judge_problem(document, verdicts, searches)

    answers = [_answer_to(document, judge) for document in json.loads(documents_json)]
    return json.dumps(answers, allow_nan=False)


def refusal_of_reading(document: object, read: Callable[[object], object]) -> Document | None:
    """Return the error of a document that ``read`` refuses, None if it does not.

    Whoever hands a document to a child as text asks this first: JSON numbers
    that no double is near are not numbers any more when they are written again.
    """
    try:
        read(document)
    except InvalidProblemError as error:
        return _invalid(error)
    return None


def answer_ping() -> str:
    """Answer that the child lives."""
    return "alive"


def _answer(document_json: str, judge: Callable[[object], Answer]) -> str:
    return json.dumps(_answer_to(json.loads(document_json), judge), allow_nan=False)


def _answer_to(document: object, judge: Callable[[object], Answer]) -> Answer:
    try:
        return judge(document)
    except InvalidProblemError as error:
        return {"error": _invalid(error)}
    except (SeveralWindowsError, NoSuchWindowError) as error:
        windows = [window_document(window) for window in error.windows]
        return _error(error.code, error.message, error.pointer, windows=windows)
    except DynamicsError as error:
        return _error(error.code, error.message, error.pointer)


def _judge_question(document: object) -> Answer:
    question = read_question(document)
    if question.problem is not None and isinstance(question.motion, StateMotion):
        return {"verdict": None}
    verdict = decide(question.body, question.potential)
    answer = verdict_document(question.body, verdict, question.potential)
    refusal = _refusal(verdict, answer) if question.problem is not None else None
    if refusal is not None:
        return refusal
    if verdict.verdict == "inadmissible":
        named, degree = _named(question), question.nearest_degree
        nearest = nearest_document(question.body, question.potential, named, degree)
        return {"verdict": {**answer, "nearest": nearest}}
    if isinstance(question.motion, PlanarMotion):
        with ctx.workprec(PRECISION):
            found = find_windows(question.body, question.potential, question.motion)
            existence = None
            if not found:
                existence = _Searches(1).document(question.body, question.potential, question.motion)
            try:
                chosen = _require_asked(question, question.motion, found)
            except NoMotionError as error:
                return _no_motion(error, existence)
        answer |= {"motions": [window_document(window) for window in found], "existence": existence}
        if question.problem is not None and chosen is not None:
            answer["plan"] = plan_document(question.problem.problem, window_document(chosen))
    if verdict.verdict == "admissible":
        answer |= _formulas(question, verdict)
    return {"verdict": answer}


def _formulas(question: Question, verdict: Verdict) -> Document:
    """Return what is known of the functions of an admissible potential: h, F and G."""
    body, found = question.body, decomposition_of(question.body, question.potential)
    # Names are put in where a proof for all their values can be had, which is none without one for these.
    named = _named(question) if verdict.proof == "symbolic" else None
    formulas = NAMELESS if named is None else named.formulas(body, found, question.potential)
    points = Points(question.w, question.g2)
    try:
        return {
            "energy": energy_document(body, verdict, found, formulas),
            "decomposition": None if found is None else decomposition_document(found, formulas, points),
        }
    except NoDecompositionError:
        # Without a proof it shows only when values are computed.
        return {"energy": energy_document(body, verdict, None, formulas)}


def _named(question: Question) -> Named | None:
    return None if question.stated is None else question.stated.named(question.body)


def _require_asked(question: Question, motion: PlanarMotion, windows: tuple[Window, ...]) -> Window | None:
    """Return the window that is asked for, None if all are; raise what a job would end with."""
    if question.problem is not None:
        return _require_motion(question.problem.problem, motion, windows)
    if motion.window is None and (motion.start is None or len(windows) != 1):
        return None
    window = choose_window(windows, motion)
    if motion.start is not None:
        starting_point(window, motion)
    return window


def _deadline() -> Callable[[], bool]:
    """Return what says that the time of a search is over."""
    processor, clock = time.process_time() + PROCESSOR_SECONDS, time.monotonic() + SECONDS
    return lambda: time.process_time() > processor or time.monotonic() > clock


class _Searches:
    """For which λ there are motions: the same for all problems that differ in λ only."""

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
            found = find_existence(body, potential, motion, _deadline())
            self._known[key] = None if found is None else existence_document(found)
        return self._known[key]


def _no_motion(error: NoMotionError, existence: Document | None) -> Answer:
    if existence is None:
        return _error(error.code, error.message, error.pointer)
    where = existence_sentence(ExistenceOut.model_validate(existence))
    return _error(error.code, f"{error.message}; {where}", error.pointer, existence=existence)


def _judge_problem(document: object, known: dict[str, Verdict], searches: _Searches) -> Answer:
    """Judge a problem; ``known`` remembers the verdicts on potentials."""
    problem = read_problem(document)
    if isinstance(problem.motion, StateMotion):
        return {"verdict": None}
    assert isinstance(document, dict)
    setting = json.dumps([document["body"], document["potential"]])
    if setting not in known:
        known[setting] = decide(problem.body, problem.potential)
    verdict = known[setting]
    answer = verdict_document(problem.body, verdict, problem.potential)
    refusal = _refusal(verdict, answer)
    if refusal is not None:
        return refusal
    with ctx.workprec(PRECISION):
        windows = find_windows(problem.body, problem.potential, problem.motion)
        try:
            window = _require_motion(problem, problem.motion, windows)
        except NoMotionError as error:
            return _no_motion(error, searches.document(problem.body, problem.potential, problem.motion))
    return {"verdict": {**answer, "motions": [window_document(window)]}}


def _refusal(verdict: Verdict, answer: Document) -> Answer | None:
    """Return what a planar motion is refused with if its potential is not proved to have any."""
    if verdict.verdict == "inadmissible":
        detail = (
            "the potential does not satisfy the compatibility equation, hence there is no family of motions "
            "with q = 0 and zero areas integral; the residual at the point given is certainly not 0"
        )
        return _error("inadmissible_potential", detail, _POTENTIAL, counterexample=answer["counterexample"])
    if verdict.verdict == "undecided":
        detail = "neither a proof nor a counterexample was found within the precision that was tried"
        return _error("undecided_potential", detail, _POTENTIAL, evidence=answer["evidence"])
    return None


def _require_motion(problem: Problem, motion: PlanarMotion, windows: tuple[Window, ...]) -> Window:
    """Return the window of the motion, or raise what its job would end with."""
    window = choose_window(windows, motion)
    if problem.method != "integration":
        require_known_ends(window)
    starting_point(window, motion)
    if window.kind != "periodic" and isinstance(problem.time, TimePeriods):
        raise PeriodNeededError(
            f"the motion in window {window.index} has no period ({window.kind}); "
            'accepted are {"start", "stop", "samples"} and {"times"}',
            pointer="/time/periods",
        )
    return window


def _invalid(error: InvalidProblemError) -> Document:
    faults = [{"pointer": f.pointer, "code": f.code, "message": f.message} for f in error.faults]
    return {"code": "invalid_problem", "detail": str(error), "pointer": "", "faults": faults}


def _error(code: str, detail: str, pointer: str = "", **extras: object) -> Answer:
    return {"error": {"code": code, "detail": detail, "pointer": pointer, **extras}}
