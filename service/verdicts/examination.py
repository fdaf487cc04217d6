"""Examines a potential or a problem before a job is queued. Runs in a child that can be killed.

For some formulas a verdict takes unpredictably long, or crashes inside a compiled
library; hence documents go in and come out as JSON text, and the caller sets the
limits.
"""

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any  # what was read from JSON

from flint import ctx

from service.dynamics.classical.classification import Nearness, classify
from service.dynamics.errors import DynamicsError
from service.dynamics.inverse.decomposition import NoDecompositionError
from service.dynamics.problem import PlanarMotion, Problem, StateMotion, TimePeriods
from service.dynamics.reduction.window import Window, require_known_ends, starting_point
from service.dynamics.reduction.windows import REDUCTION_BITS, NoMotionError, choose_window, find_windows
from service.dynamics.sampling import PeriodNeededError
from service.dynamics.verdict.own_curve import require_proof_on_arc
from service.dynamics.verdict.simple_form import simplified
from service.dynamics.verdict.verdict import Verdict, decide
from service.schemas.problem.problem import Question, trusted_question
from service.schemas.problem.trusted import centre_of, trusted_problem
from service.schemas.reading.documents import Document, Part
from service.verdicts.cached import Keys, ResultCache, verdict_deadline
from service.verdicts.documents import (
    NAMELESS,
    Points,
    decomposition_document,
    decomposition_of,
    energy_document,
    nearest_document,
    plan_document,
    ratios_document,
    verdict_document,
    window_document,
)
from service.verdicts.refusals import (
    UNSETTLED,
    Searches,
    answer_or_refusal,
    refusal_of_verdict,
    refusal_of_windows,
    refusal_without_motion,
    with_extras,
)


def classification_of(question: Question) -> Document | None:
    """Return the classification of a state in a potential of the type gravity; None of any other motion.

    It computes in balls: in a process of many threads the caller holds
    :data:`service.schemas.problem.trusted.ONE_AT_A_TIME`.
    """
    motion, stated = question.motion, question.stated
    if not isinstance(motion, StateMotion) or stated["type"] != "gravity" or question.body.B is None:
        return None
    found = classify(question.body, centre_of(stated), motion.omega, motion.gamma)
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


Answer = Document

MOST_SEARCHES = 4
"""Searches for λ with motions in one list of problems; each takes some tenths of a second."""


def examine_question(document_json: str) -> str:
    """Answer a validation: ``{"verdict": …}`` or ``{"error": {code, detail, pointer, …}}``, as JSON.

    A whole problem gets the error of :func:`examine_problem`, as a job would.
    """
    return json.dumps(answer_or_refusal(json.loads(document_json), _judge_question), allow_nan=False)


def examine_problem(document_json: str, *, explains: bool = True) -> str:
    """Answer whether a problem can be solved as asked: ``{"verdict": …}`` or ``{"error": …}``, as JSON.

    The error is what its job would end with. A motion that is not planar has no verdict: null. If there is
    no motion and ``explains`` is true, the answer has the λ for which motions exist.
    """
    return json.dumps(examine_document(json.loads(document_json), explains=explains).answer, allow_nan=False)


@dataclass(frozen=True, slots=True)
class Examined:
    """The answer of :func:`examine_problem`, and results that need not be found again in the same process."""

    answer: Part
    problem: Problem | None
    """The problem that was read; None if the document states none."""


def examine_document(
    document: Part,
    *,
    explains: bool = True,
    cache: ResultCache | None = None,
    read: Callable[[Part], Problem] = trusted_problem,
) -> Examined:
    """Answer as :func:`examine_problem`, and hand on what was read and found on the way.

    Those who examine many problems of one body and potential hand over a ``cache``, which has the verdict.
    A document that nobody has validated is ``read`` by who does.
    """
    searches = Searches(1 if explains else 0)
    problem = None

    def judge(document: Part) -> Answer:
        nonlocal problem
        problem = read(document)
        if cache is None:
            return _judge_problem(problem, ResultCache({}), (None, None), searches)
        what = json.dumps([document["body"], document["potential"]], sort_keys=True)
        return _judge_problem(problem, cache, (what, None), searches)

    answer = answer_or_refusal(document, judge)
    return Examined(answer, problem)


def examine_problems(text: str) -> str:
    """Examine each problem of a list as :func:`examine_problem`; use what is cached; return what is found.

    ``text`` is ``{"problems": [{"document", "verdict", "windows"}, …], "cached": {key: content}}``; in each
    problem are the keys of its verdict and of the windows of its curve, null where it has none. The answer
    is ``{"answers": […], "seconds": […], "found": {key: content}}``.
    """
    request = json.loads(text)
    began = time.perf_counter()
    problems = [_read_or_none(each["document"]) for each in request["problems"]]
    reading = (time.perf_counter() - began) / max(len(problems), 1)
    ahead = (
        (each["verdict"], each["windows"], problem.motion)
        for each, problem in zip(request["problems"], problems, strict=True)
        if problem is not None
        and isinstance(problem.motion, PlanarMotion)
        and None not in (each["verdict"], each["windows"])
    )
    cache, searches = ResultCache(request["cached"], ahead), Searches(MOST_SEARCHES)

    def judge(requested: Mapping[str, Any], problem: Problem | None) -> Answer:
        keys = requested["verdict"], requested["windows"]
        return answer_or_refusal(
            requested["document"],
            lambda document: _judge_problem(problem or trusted_problem(document), cache, keys, searches),
        )

    answers, seconds = [], []
    for each, problem in zip(request["problems"], problems, strict=True):
        began = time.perf_counter()
        answers.append(judge(each, problem))
        seconds.append(reading + cache.share(each["windows"], time.perf_counter() - began))
    return json.dumps({"answers": answers, "seconds": seconds, "found": cache.found}, allow_nan=False)


def _read_or_none(document: Part) -> Problem | None:
    """Return the problem; None where it is refused, which is reported when it is judged."""
    try:
        return trusted_problem(document)
    except DynamicsError:
        return None


def answer_ping() -> str:
    """Answer that the child is alive."""
    return "alive"


def _judge_question(document: Part) -> Answer:
    question = trusted_question(document)
    if question.problem is not None and not isinstance(question.motion, PlanarMotion):
        return {"verdict": None}
    verdict = decide(question.body, question.potential, verdict_deadline())
    refuted = verdict.verdict == "inadmissible"
    potential = question.potential if refuted else simplified(question.potential)
    answer = verdict_document(question.body, verdict, potential)
    answer["classical"] = classification_of(question)
    accepts = question.problem is not None and question.problem.accept == "undecided"
    refusal = None if question.problem is None else refusal_of_verdict(verdict, answer, accepts)
    if refuted:
        named, degree = question.named(), question.nearest_degree
        nearest = nearest_document(question.body, question.potential, named, degree)
        ratios = ratios_document(question.body, question.potential, question.stated)
        if refusal is not None:
            return refusal if nearest is None else with_extras(refusal, nearest=nearest, ratios=ratios)
        return {"verdict": {**answer, "nearest": nearest, "ratios": ratios}}
    if refusal is not None:
        return refusal
    if isinstance(question.motion, PlanarMotion):
        with ctx.workprec(REDUCTION_BITS):
            try:
                found = find_windows(question.body, potential, question.motion)
            except UNSETTLED as error:
                return refusal_of_windows(error, verdict)
            existence = None
            if not found:
                existence = Searches(1).document(question.body, potential, question.motion)
            try:
                chosen = _require_chosen(question, question.motion, found)
            except NoMotionError as error:
                return refusal_without_motion(error, existence)
        answer |= {"motions": [window_document(window) for window in found], "existence": existence}
        if question.problem is not None and chosen is not None:
            answer["plan"] = plan_document(question.problem, chosen)
            if verdict.verdict == "undecided":
                with ctx.workprec(REDUCTION_BITS):
                    _prove_motion(question.problem, question.motion, chosen)
    if verdict.verdict == "admissible":
        answer |= _formulas(question, verdict)
    return {"verdict": answer}


def _formulas(question: Question, verdict: Verdict) -> Document:
    """Return h, F and G of an admissible potential, as far as they are known."""
    body, found = question.body, decomposition_of(question.body, question.potential)
    # Names are used only if the formula is proved for all values, which needs a proof for these values first.
    named = question.named() if verdict.proof == "symbolic" else None
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


def _require_chosen(question: Question, motion: PlanarMotion, windows: tuple[Window, ...]) -> Window | None:
    """Return the requested window, None if no window was chosen; raise the error its job would end with."""
    if question.problem is not None:
        return _require_motion(question.problem, motion, windows)
    if motion.window is None and (motion.start is None or len(windows) != 1):
        return None
    window = choose_window(windows, motion)
    if motion.start is not None:
        starting_point(window, motion)
    return window


def _judge_problem(problem: Problem, cache: ResultCache, keys: Keys, searches: Searches) -> Answer:
    """Judge a problem, with what is cached under the keys of its verdict and of its windows."""
    if not isinstance(problem.motion, PlanarMotion):
        return {"verdict": None}
    of_verdict, of_windows = keys
    verdict = cache.verdict(of_verdict, problem.body, problem.potential)
    answer = verdict_document(problem.body, verdict, problem.potential)
    refusal = refusal_of_verdict(verdict, answer, problem.accept == "undecided")
    if refusal is not None:
        return refusal
    with ctx.workprec(REDUCTION_BITS):
        try:
            windows = cache.windows(of_windows, problem.body, problem.potential, problem.motion)
            window = _require_motion(problem, problem.motion, windows)
        except UNSETTLED as error:
            return refusal_of_windows(error, verdict)
        except NoMotionError as error:
            found = searches.document(problem.body, simplified(problem.potential), problem.motion)
            return refusal_without_motion(error, found)
        if verdict.verdict == "undecided":
            _prove_motion(problem, problem.motion, window)
    return {"verdict": {**answer, "motions": [window_document(window)]}}


def _prove_motion(problem: Problem, motion: PlanarMotion, window: Window) -> None:
    """Raise the refusal of a motion in an undecided potential unless q = 0 is proved on its own curve."""
    arc = starting_point(window, motion).arc
    require_proof_on_arc(problem.body, problem.potential, motion, arc, verdict_deadline())


def _require_motion(problem: Problem, motion: PlanarMotion, windows: tuple[Window, ...]) -> Window:
    """Return the window of the motion, or raise the error its job would end with."""
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
