"""Answers a study in a worker's child: a question of the service's own, or a search of numbers.

Periods, energies and precessions are searched with proofs, where the potential has a formula that is
admissible for all of the numbers. Windows of λ are cut at the atlas' changes first: between them their number
is proved, so that no window is missed; along other unknowns it is not, and the rest stays undecided. What has
no bounds is looked for in doubles.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import pairwise
from math import inf, nan

from flint import arb, ctx

from service.dynamics.atlas.atlas import make_atlas
from service.dynamics.atlas.parts import AtlasPart, LambdaRange
from service.dynamics.discovery.potential_search import ratios_that_admit
from service.dynamics.discovery.setting import Tell, part_of, steps_of, untold
from service.dynamics.errors import DynamicsError
from service.dynamics.exact import exact_number
from service.dynamics.formula.algebras.ball import BallAlgebra, ball
from service.dynamics.formula.parameters import MOMENTS, bind, coefficients_of
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import VARIABLES, Binary, Symbol, Tree, exact_tree, post_order
from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.recognition import is_even_in_g2
from service.dynamics.problem import PlanarMotion, Problem
from service.dynamics.reduction.windows import find_windows
from service.dynamics.solution.dense_output import as_decimals, exact_middle
from service.dynamics.verdict.verdict import Verdict, decide
from service.jobs.records import JobResult, Refused
from service.schemas.reading.documents import Document, Part
from service.schemas.study.reading import Search, trusted_search
from service.storage.codecs.packing import encode_document
from service.verdicts.documents import verdict_document
from service.verdicts.questions import QUESTIONS, examine_study_of_job
from service.verdicts.refusals import answer_or_refusal, deadline, refusal_of_verdict
from workers.computation.compiled_code import way_for
from workers.computation.compute import solve_document
from workers.solvers.searches.family import ProblemFamily, Slot
from workers.solvers.searches.search import (
    SEARCH_BITS,
    FamilySearch,
    FoundNumbers,
    SearchResult,
    Target,
    search,
)
from workers.solvers.searches.structure import Box, share_of, stretches

PROCESSOR_SECONDS, SECONDS = 60.0, 120.0
"""After either limit what is not settled is undecided."""
STRUCTURE_SHARE = 0.3
"""Share of them in which boxes are looked for on which windows stay."""
SAMPLES = 65
"""Places at which what has no bounds is looked at, along one unknown."""
MOST_STEPS = 40
NARROW = 1e-13
"""Relative width of a bracket that is not narrowed any more."""
LARGEST_JUMP = 1e-3
"""A value that differs by more at the two ends of a narrow bracket does not pass 0 there."""
LEAST_WIDER, MOST_WIDER = 2.0, 1024.0
"""An interval in which a passage is to be proved is so many times wider at the next try."""
ATLAS_SAMPLES = 9
_LAMBDA = ("motion", "lambda")
_AFFINE = ("gravity", "rational", "homogeneous")
"""Families of potentials that are sums of terms, each with a coefficient that is a number of the document."""


def study_document(document_json: str, tell: Tell = untold) -> JobResult | Refused:
    """Answer the document of a job: a question with ``what``; ``tell`` is told how far it is."""
    document: Part = json.loads(document_json)
    if document["what"] in QUESTIONS:
        answer: Part = json.loads(examine_study_of_job(document_json, tell))
        base = ""
    else:
        answer, base = answer_or_refusal(document, partial(_numbers, tell=tell)), "/base"
    if "error" in answer:
        return Refused({**answer["error"], "pointer": f"{base}{answer['error']['pointer']}"})
    return JobResult(encode_document(answer["verdict"]))


def _numbers(document: Part, tell: Tell) -> Document:
    """Answer a search of numbers, or refuse it; ``tell`` is told the share of the box that is settled."""
    asked = trusted_search(document)
    problem = asked.problem_at([each.middle for each in asked.unknowns])
    verdict = decide(problem.body, problem.potential)
    answer = verdict_document(problem.body, verdict, problem.potential)
    refused = refusal_of_verdict(verdict, answer, problem.accept == "undecided")
    if refused:
        return refused
    is_late = deadline(PROCESSOR_SECONDS, SECONDS)
    whole: Box = tuple((each.lower, each.upper) for each in asked.unknowns)
    family = family_of(asked, problem)
    if family is None:
        return _answer(asked, _seen_solutions(asked, None, is_late, tell), [whole])
    wanted = [Target(each.of, partial(_number, each.equals)) for each in asked.wanted if each.of != "trace"]
    wanted.sort(key=lambda each: each.of == "period")
    coefficients = _coefficients(asked, problem, verdict)
    has_known_form = coefficients is not None and "A" not in _names(asked).values()
    is_even = has_known_form and all(map(is_even_in_g2, coefficients or ()))
    question = FamilySearch(family, asked.problem_at, wanted, is_late, is_even=is_even, tell=tell)
    if len(wanted) < len(asked.wanted):
        known = None if coefficients is None else question
        return _answer(asked, _seen_solutions(asked, known, is_late, tell), [whole])
    if coefficients is None:
        seen = [replace(each, proof="possible") for each in search(question, whole).solutions]
        return _answer(asked, seen, [whole])
    is_along_lambda = [each.path for each in asked.unknowns] == [_LAMBDA]
    parts = _parts(problem, whole[0], is_late) if is_along_lambda else _stretches(question, whole)
    solutions, undecided = list[FoundNumbers](), list[Box]()
    settled = 0.0
    for part, windows in parts:
        found, share = SearchResult((), (part,)), share_of(part, whole)
        if windows is not None or not is_along_lambda:
            inside = part_of(tell, settled, share)
            found = search(replace(question, windows=windows, tell=inside), part)
        settled += share
        tell(settled)
        undecided += [part] if windows is None else found.undecided
        solutions += [each for each in found.solutions if not any(map(each.is_same, solutions))]
    return _answer(asked, solutions, undecided)


def _stretches(question: FamilySearch, whole: Box) -> list[tuple[Box, int | None]]:
    """Return boxes with the number of their windows, those last for which it is not proved."""
    is_late = deadline(PROCESSOR_SECONDS * STRUCTURE_SHARE, SECONDS * STRUCTURE_SHARE)
    with ctx.workprec(SEARCH_BITS):
        kept, rest = stretches(question.family, whole, is_late)
    counts: list[tuple[Box, int | None]] = [(box, None) for box in rest]
    for box in kept:
        try:
            counts.insert(0, (box, len(question.arcs_at([(low + high) / 2 for low, high in box]))))
        except DynamicsError:
            counts.append((box, None))
    return counts


def _number(tree: Tree) -> arb:
    """Return the value of a formula without variables."""
    return compile_tape(tree, ()).evaluate(BallAlgebra(), ())


def _parts(
    problem: Problem, ends: tuple[Fraction, Fraction], is_late: Callable[[], bool]
) -> list[tuple[Box, int | None]]:
    """Return the parts of a range of λ with the number of their windows; None where that is not proved."""
    motion = problem.motion_as(PlanarMotion)
    over = LambdaRange(*ends, motion.sign_of_g1, motion.g3_sign)
    atlas = make_atlas(problem.body, problem.potential, over, ATLAS_SAMPLES, is_late, has_periods=False)
    found: list[tuple[Box, int | None]] = []
    reached = ends[0]
    for part in atlas.parts:
        lower, upper = _inner(part.lower, ends, up=True), _inner(part.upper, ends, up=False)
        if reached < lower:
            found.append((((reached, lower),), None))
        found.append((((lower, upper),), _windows_of(part) if atlas.proof == "proved" else None))
        reached = upper
    if reached < ends[1]:
        found.append((((reached, ends[1]),), None))
    return found


def _windows_of(part: AtlasPart) -> int | None:
    if part.series is not None:
        return len(part.series.bands)
    return 0 if part.reason is not None and part.reason.code == "no_motion" else None


def _inner(end: arb, ends: tuple[Fraction, Fraction], *, up: bool) -> Fraction:
    """Return a number inside of the enclosure of an end, within the range."""
    for whole in ends:
        if end.overlaps(ball(whole)):
            return whole
    return exact_middle(end.upper() if up else end.lower())


def family_of(asked: Search, problem: Problem) -> ProblemFamily | None:
    """Return the family of problems of a search; None if the potential has no formula in its unknowns."""
    motion, body = problem.motion_as(PlanarMotion), problem.body
    tree = _tree_of(asked, problem)
    if tree is None:
        return None
    names = _names(asked)
    slots: dict[str, Slot] = {"A": body.A, "C": body.C}
    size: Slot = motion.lambda_squared
    is_square = True
    for k, each in enumerate(asked.unknowns):
        if each.path[0] == "body" and each.path[1] in slots:
            slots[each.path[1]] = k
        elif each.path == _LAMBDA:
            size, is_square = k, False
        elif each.path == ("motion", "nu") and each.lower > 0:
            size = k
        elif each.path[0] == "motion":
            return None
    mirrored = body.A < body.C
    sign = motion.g3_sign if mirrored else motion.sign_of_g1
    tape = compile_tape(tree, (*VARIABLES, *names.values()))
    return ProblemFamily(tape, tuple(names), slots["A"], slots["C"], size, is_square, mirrored, sign)


def _names(asked: Search) -> dict[int, str]:
    """Return the names that unknowns of the potential, and moments, have in its formula; B if it has it."""
    whole: Part = asked.base
    document: Part = whole["potential"]
    names = {}
    for k, each in enumerate(asked.unknowns):
        if each.path[0] == "body":
            # The curve and the equation for V have the other two in them.
            if each.path[1] != "B" or _has_B(document):
                names[k] = each.path[1]
        elif each.path[0] == "potential":
            is_named = each.path[1] == "parameters" and len(each.path) == 3
            names[k] = each.path[2] if is_named else f"unknown{k}"
    return names


def _has_B(potential: Part) -> bool:
    """Whether the formula of a potential has B in it."""
    nodes = post_order(parse(potential["expression"])) if potential["type"] == "expression" else ()
    return any(isinstance(node, Symbol) and node.name == "B" for node in nodes)


def _tree_of(asked: Search, problem: Problem) -> Tree | None:
    """Return the potential as a formula in g1, g2, g3 and the names of unknowns; None if it has none."""
    whole: Part = asked.base
    document: Part = whole["potential"]
    names = _names(asked)
    if not names:
        potential = problem.potential
        return potential.tree if potential.has_formula else None
    if document["type"] == "expression":
        body = problem.body
        numbers = {"A": body.A, "C": body.C, **({} if body.B is None else {"B": body.B})}
        numbers |= {name: exact_number(value) for name, value in document.get("parameters", {}).items()}
        known = {name: value for name, value in numbers.items() if name not in names.values()}
        tree = parse(document["expression"])
        return bind(tree, known, variables=(*VARIABLES, *names.values()))
    if document["type"] not in _AFFINE or set(names.values()) & set(MOMENTS):
        return None
    # V is affine in its coefficients: it follows from its values at corners of the box.
    lowest = [each.lower for each in asked.unknowns]
    start = asked.problem_at(lowest).potential.tree
    total = start
    for k, name in names.items():
        each = asked.unknowns[k]
        other = asked.problem_at([*lowest[:k], each.upper, *lowest[k + 1 :]]).potential.tree
        share = Binary(
            "/", Binary("-", Symbol(name), exact_tree(each.lower)), exact_tree(each.upper - each.lower)
        )
        total = Binary("+", total, Binary("*", share, Binary("-", other, start)))
    return total


def _coefficients(asked: Search, problem: Problem, verdict: Verdict) -> Sequence[Potential] | None:
    """Return the potentials whose sums, with factors, are those of the box, if all are proved admissible.

    ``verdict`` is that of the problem in the middle of it.
    """
    tree, names = _tree_of(asked, problem), [*_names(asked).values()]
    if tree is None or "C" in names:
        return None
    if not names:
        return [problem.potential] if verdict.verdict == "admissible" else None
    if "A" in names:
        return [problem.potential] if names == ["A"] and _admits_every_ratio(asked.base) else None
    # The equation is linear in V: it holds for all numbers if it does for each coefficient.
    parts = coefficients_of(tree, names)
    found = [Potential.from_tree(part, "expression") for part in (parts or {}).values()]
    is_admissible = parts is not None and all(
        decide(problem.body, part).verdict == "admissible" for part in found
    )
    return found if is_admissible else None


def _admits_every_ratio(base: Part) -> bool:
    """Tell whether a potential, a formula with moments in it, is admissible for every A."""
    body, potential = base["body"], base["potential"]
    B = None if body.get("B") is None else exact_number(body["B"])
    parameters = {name: exact_number(value) for name, value in (potential.get("parameters") or {}).items()}
    try:
        return ratios_that_admit(potential["expression"], parameters, B=B, C=exact_number(body["C"])).all
    except DynamicsError:
        return False


def _seen_solutions(
    asked: Search, question: FamilySearch | None, is_late: Callable[[], bool], tell: Tell
) -> list[FoundNumbers]:
    """Return the solutions that doubles show along one unknown: where what is wanted passes its value.

    A passage of the trace is proved, if it can be, where the potential is admissible for all numbers: that
    is what a ``question`` says. ``tell`` is told the share of windows and intervals that were looked at.
    """
    if len(asked.unknowns) > 1:
        return []
    (unknown,), (wanted,) = asked.unknowns, asked.wanted
    target = float(_number(wanted.equals))
    span = unknown.upper - unknown.lower
    places = [unknown.lower + span * k / (SAMPLES - 1) for k in range(SAMPLES)]
    found = list[FoundNumbers]()
    windows = max(_count_windows(asked, place) for place in places[:: SAMPLES // 8])
    for window in range(windows):

        def missed(at: Fraction, window: int = window) -> float:
            return nan if is_late() else _value_at(asked, at, window, wanted.of) - target

        values = [missed(place) for place in places]
        spans = list(zip(pairwise(places), pairwise(values), strict=True))
        for (low, high), (one, two) in steps_of(spans, part_of(tell, window / windows, 1 / windows)):
            if one * two <= 0.0:
                ends = _narrowed(missed, (low, one), (high, two))
                if ends is not None:
                    seen = FoundNumbers((ends,), window, "possible")
                    found.append(seen if question is None else _proved(asked, question, seen))
    return sorted(found, key=lambda each: float(each.values[0].mid()))


def _proved(asked: Search, question: FamilySearch, seen: FoundNumbers) -> FoundNumbers:
    """Return a passage of the trace with a proof, if one is found: that it is beyond its value on both sides.

    The trace is enclosed at two exact numbers, between which the motions stay: then it is continuous there,
    and takes every value between those at the ends (Bolzano). There may be more places than one.
    """
    (unknown,), (wanted,) = asked.unknowns, asked.wanted
    span = unknown.upper - unknown.lower
    middle, half = exact_middle(seen.values[0]), max(exact_middle(seen.values[0].rad()), span / 2**48)
    while half < span / SAMPLES and not question.is_late():
        ends = max(middle - half, unknown.lower), min(middle + half, unknown.upper)
        low, high = (_trace_at(asked, end, seen.window) - _number(wanted.equals) for end in ends)
        if low * high < 0 and question.motions_stay((ends,)):
            return replace(seen, values=(ball(ends[0]).union(ball(ends[1])),), proof="proved")
        if low * high < 0 or not (low * high).is_finite():
            break
        rise = abs(float(high.mid()) - float(low.mid()))
        missing = max(float(each.abs_upper()) for each in (low.rad() * 2, high.rad() * 2, (low + high) / 2))
        half *= Fraction(min(max(2.0 * missing / rise if rise else inf, LEAST_WIDER), MOST_WIDER))
    return seen


def _trace_at(asked: Search, at: Fraction, window: int) -> arb:
    """Return the enclosed trace of the motion in a window; not finite if it is not enclosed."""
    told = _told_at(asked, at, window, accuracy={"tier": "certified"})
    if told is None or told["stability"] is None or told["stability"]["proof"] != "theorem":
        return arb.nan()
    value, radius = (ball(exact_number(told["stability"]["trace"][name])) for name in ("value", "radius"))
    return value + arb(0, radius.abs_upper())


def _count_windows(asked: Search, at: Fraction) -> int:
    problem = asked.problem_at([at])
    try:
        return len(find_windows(problem.body, problem.potential, problem.motion_as(PlanarMotion)))
    except DynamicsError:
        return 0


def _value_at(asked: Search, at: Fraction, window: int, of: str) -> float:
    """Return what a job tells of the motion in a window; NaN if there is none."""
    told = _told_at(asked, at, window)
    if told is None:
        return nan
    if of == "trace":
        return nan if told["stability"] is None else float(told["stability"]["trace"])
    for name in of.split("."):
        told = told[name] or {}
    return float(told.get("value", nan))


def _told_at(asked: Search, at: Fraction, window: int, **terms: object) -> Part | None:
    """Return the summary of the motion in a window, asked on further terms; None if it is refused."""
    document: Part = asked.document_at([at])
    asking = {**document, "motion": {**document["motion"], "window": window}, **terms}
    outcome = solve_document(json.dumps(asking), way=way_for("planar", "outputs"), waits=True)
    return None if isinstance(outcome, Refused) else outcome.summary


def _narrowed(
    missed: Callable[[Fraction], float], low: tuple[Fraction, float], high: tuple[Fraction, float]
) -> arb | None:
    """Return where a value changes its sign, as narrow as doubles know; None if it jumps there."""
    for _ in range(MOST_STEPS):
        (a, one), (b, two) = low, high
        share = 0.5 if one == two else min(max(one / (one - two), 0.01), 0.99)
        middle = a + (b - a) * Fraction(share)
        value = missed(middle)
        if not value * value < inf or b - a < NARROW * (abs(a) + abs(b)):
            break
        low, high = ((middle, value), high) if value * one > 0.0 else (low, (middle, value))
    is_jump = abs(low[1] - high[1]) > LARGEST_JUMP
    return None if is_jump else ball(low[0]).union(ball(high[0]))


def _answer(asked: Search, solutions: Sequence[FoundNumbers], undecided: Sequence[Box]) -> Document:
    found: list[Document] = []
    for each in solutions:
        values: Document = {}
        for unknown, value in zip(asked.unknowns, each.values, strict=True):
            decimal, radius = as_decimals(value)
            values[unknown.pointer] = {"value": decimal, "radius": radius}
        found.append({"values": values, "window": each.window, "proof": each.proof})
    boxes = [[[float(low), float(high)] for low, high in box] for box in undecided]
    rest = "undecided" if boxes else "proved_empty"
    return {"verdict": {"solutions": found, "rest": rest, "undecided": boxes}}
