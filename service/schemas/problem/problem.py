"""Validates problem documents and the questions of validations, and names a problem by its digest.

A document that differs from one validated before in λ alone is validated by that number: no rule between the
parts knows which number chooses the curve.

The tier of a problem with a time budget is chosen here: the best one that is expected to keep it. A question
is the input of a verdict, and the potential in it with the names of its parameters.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction

from pydantic_core import PydanticCustomError

from service.cache import Cache
from service.dynamics.accuracy import (
    TIERS,
    AccuracyTable,
    Expected,
    MotionKind,
    Tier,
    TierChoice,
    Unavailable,
    best_tier,
    expected,
    family_of,
    motion_kind,
)
from service.dynamics.body import RigidBody
from service.dynamics.exact import exact_number
from service.dynamics.formula.parameters import named_formula
from service.dynamics.formula.tree import VARIABLES, Tree
from service.dynamics.inverse.named import (
    CURVE_NAMES,
    Named,
    NamedSolution,
    NamedSum,
    named_sum,
    sum_of_parts,
)
from service.dynamics.numerics import NUMERICS
from service.dynamics.potentials.families.general_solution import QUADRANTS, Quadrant
from service.dynamics.potentials.potential import FormulaPotential, Potential
from service.dynamics.problem import Problem, StateMotion
from service.schemas.problem.documents import (
    MEMBERS,
    CheckedProblem,
    ProblemIn,
    Reading,
    ValidationIn,
    combination_faults,
    read_setting,
)
from service.schemas.problem.trusted import (
    CACHED,
    CurveNumber,
    Motion,
    body_of,
    centre_of,
    curve_of,
    formula_of,
    motion_of,
    on_curve,
    parameters_of,
    potential_of,
    problem_of,
)
from service.schemas.reading.documents import Document, Fault, InvalidProblemError, Part, first_of
from service.schemas.reading.numbers import read_nonzero, read_positive
from service.schemas.reading.parts import read_parts

_LISTS = {"rational": (("a", "b", "c"), 1), "homogeneous": (("A", "B", "C", "log"), 0)}
"""Lists of coefficients of a family, and the index of the first one."""


@dataclass(frozen=True, slots=True)
class Question:
    """The input of a verdict."""

    body: RigidBody
    potential: Potential
    stated: Part
    """The potential as it was stated, with the names of its parameters."""
    motion: Motion | None = None
    problem: Problem | None = None
    """The whole problem, if motion and times are given."""
    w: tuple[float, ...] = ()
    """Arguments at which values of F are wanted."""
    g2: tuple[float, ...] = ()
    """Arguments at which values of G are wanted."""
    nearest_degree: int | None = None
    """Largest degree in the search for the nearest admissible polynomial; None for the default."""

    def named(self) -> Named | None:
        """Return the terms of the potential with the names of its parameters, None if it has none."""
        return named_of(self.stated, self.body)


def trusted_question(document: Part) -> Question:
    """Return the question of a valid document; raises what its constructors raise."""
    body = body_of(document)
    return question_of(document, body, potential_of(document["potential"], body))


def question_of(document: Part, body: RigidBody, potential: Potential) -> Question:
    """Return the question of a document whose body and potential are made already."""
    stated, motion = document["potential"], document.get("motion")
    points, nearest = document.get("points") or {}, document.get("nearest")
    w, g2 = (tuple(float(exact_number(at)) for at in points.get(name, ())) for name in ("w", "g2"))
    is_whole = motion is not None and document.get("time") is not None
    return Question(
        body,
        potential,
        stated,
        None if motion is None else motion_of(motion, stated),
        problem_of(document, body, potential) if is_whole else None,
        w,
        g2,
        None if nearest is None else int(exact_number(nearest["degree"])),
    )


def named_of(part: Part, body: RigidBody) -> Named | None:
    """Return the terms of a potential with the names of its parameters or coefficients, None if it has none.

    Coefficients in lists are a1, a2, …, b1, … in the rational family, and A0, A1, …, log0, … in the
    homogeneous one.
    """
    parameters = parameters_of(part)
    match part["type"]:
        case "expression":
            return named_sum(named_formula(part["expression"], VARIABLES, parameters, body), parameters)
        case "general":
            return _named_solution(part, parameters, body)
        case "gravity":
            a, b, c = centre_of(part)
            return _sum({"a": a, "b": b, "c": c}, lambda name: {"type": "gravity", name: 1}, body)
    letters, first = _LISTS[part["type"]]
    values = {
        f"{letter}{n}": exact_number(value)
        for letter in letters
        for n, value in enumerate(part.get(letter, ()), start=first)
    }

    def unit(name: str) -> Part:
        letter = name.rstrip("0123456789")
        return {"type": part["type"], letter: [0] * (int(name.removeprefix(letter)) - first) + [1]}

    return _sum(values, unit, body)


def _sum(values: Mapping[str, Fraction], unit: Callable[[str], Part], body: RigidBody) -> NamedSum | None:
    """Return the sum of coefficients times potentials, without zero coefficients."""
    given = {name: value for name, value in values.items() if value}
    return sum_of_parts(given, tuple((name, potential_of(unit(name), body)) for name in given))


def _named_solution(part: Part, parameters: Mapping[str, Fraction], body: RigidBody) -> NamedSolution | None:
    """Return F and G on every quadrant."""
    if not parameters or CURVE_NAMES & set(parameters):
        return None
    trees: list[dict[Quadrant, Tree]] = []
    for function, variable in (("F", "w"), ("G", "g2")):
        given = formula_of(part, function)
        texts = dict.fromkeys(QUADRANTS, given) if isinstance(given, str) else given
        trees.append({q: named_formula(texts[q], (variable,), parameters, body) for q in QUADRANTS})
    return NamedSolution(*trees)


ACCURACY_POINTER = "/accuracy"
ACCURACY_FIELDS = ("tolerance", "relative", "tier", "budget_seconds")

_CACHE: Cache[tuple[type[ProblemIn], str], CheckedProblem] = Cache(CACHED)
_READ: Mapping[str, Callable[[object], Fraction]] = {"lambda": read_positive, "nu": read_nonzero}
"""The fields that choose the curve by a number, and how that is read."""


def read_problem(document: object) -> Problem:
    """Return the problem that ``document`` states.

    Raises
    ------
    InvalidProblemError
        Lists every fault.
    """
    return check_problem(document).problem


def problem_digest(canonical: Mapping[str, object]) -> str:
    """Return the SHA-256, in hexadecimal, of a canonical document and the numerics version."""
    content = json.dumps({"numerics": NUMERICS, "problem": canonical}, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(content.encode()).hexdigest()


def check_problem(document: object, model: type[ProblemIn] = ProblemIn) -> CheckedProblem:
    """Return the problem and its canonical document; raises as :func:`read_problem`.

    ``model`` may have further fields, which are no part of the problem.
    """
    curve = curve_of(document)
    if curve is None:
        return _validated(document, model)
    like = _CACHE.get((model, curve.rest))
    if like is None:
        like = _validated(document, model)
        if not isinstance(like.problem.potential, FormulaPotential):
            return like
        _CACHE.put((model, curve.rest), like)
    with suppress(PydanticCustomError):
        return _on_curve(like, curve, _READ[curve.field](curve.number))
    # Its faults are listed with the others.
    return _validated(document, model)


def _validated(document: object, model: type[ProblemIn]) -> CheckedProblem:
    reading = _read(document, model)
    checked = None if reading.faults else reading.problem()
    if checked is None:
        raise InvalidProblemError(each_once(reading.faults))
    return checked


def _on_curve(like: CheckedProblem, curve: CurveNumber, number: Fraction) -> CheckedProblem:
    def canonical() -> Document:
        document: Part = like.canonical
        return {**document, "motion": {**document["motion"], curve.field: str(number)}}

    return CheckedProblem(on_curve(like.problem, curve.field, number), canonical)


def read_question(document: object) -> Question:
    """Read the input of a verdict; with a motion and times it is a whole problem.

    Every part is checked by the rules of :func:`check_problem`.

    Raises
    ------
    InvalidProblemError
        Lists every fault.
    """
    return check_question(document)[0]


def check_question(document: object) -> tuple[Question, CheckedProblem | None]:
    """Return the question, and the whole problem in it if there is one; raises as :func:`read_question`."""
    reading = _read(document, ValidationIn)
    if reading.body is None or reading.potential is None or reading.faults:
        raise InvalidProblemError(each_once(reading.faults))
    return question_of(reading.document(), reading.body, reading.potential), reading.problem()


def _read(document: object, model: type[ProblemIn | ValidationIn]) -> Reading:
    parts, faults = read_parts(document, model, MEMBERS)
    faults += combination_faults(document, parts)
    body, potential = read_setting(document, parts, faults)
    return Reading(parts, body, potential, faults)


def place_sent(document: object, pointer: str) -> str:
    """Return the pointer for a solver's accuracy error: the field that set the accuracy.

    Solvers know the required accuracy, not the field it came from. Empty (the whole
    document) if the accuracy was left out.
    """
    if pointer != ACCURACY_POINTER:
        return pointer
    match document:
        case {"accuracy": dict(accuracy)}:
            return next((f"{pointer}/{name}" for name in ACCURACY_FIELDS if name in accuracy), pointer)
    return ""


def each_once(faults: list[Fault]) -> list[Fault]:
    """Drop duplicate faults; of very many faults, keep the first."""
    seen: dict[tuple[str, str], Fault] = {}
    for fault in faults:
        seen.setdefault((fault.pointer, fault.code), fault)
    return first_of(list(seen.values()))


def window_of(verdict: Part | None) -> Part | None:
    """Return the window of the single motion in the verdict on a problem, None without a verdict."""
    motions = None if verdict is None else verdict["motions"]
    return motions[0] if isinstance(motions, list) else None


def choose_tier(problem: Problem, window: Part | None, table: AccuracyTable) -> TierChoice:
    """Return the best tier that is expected to keep the budget of ``problem``.

    ``window`` is that of its motion as a verdict lists it; None for a motion
    from any state. A tier that failed on motions of this kind is not chosen.

    Raises
    ------
    BudgetTooSmallError
        Not even the cheapest tier is expected to keep it.
    """
    budget = problem.accuracy.budget_seconds
    if budget is None:
        raise ValueError("the problem has no budget")
    kind, family = kind_of(problem, window), family_of(problem.body, problem.potential)
    return best_tier(table, budget, problem.time.samples, kind, family).require_fit(budget)


def expected_of_tiers(
    problem: Problem, window: Part | None, table: AccuracyTable
) -> dict[Tier, Expected | Unavailable | None]:
    """Return what is expected of ``problem`` at each tier, by the table alone."""
    kind, family = kind_of(problem, window), family_of(problem.body, problem.potential)
    return {tier: expected(table, tier, problem.time.samples, kind, family) for tier in TIERS}


def with_tier(document: Part, choice: TierChoice) -> Part:
    """Return a problem document with the tier in place of its budget."""
    return {**document, "accuracy": {"tier": choice.tier}}


def kind_of(problem: Problem, window: Part | None) -> MotionKind:
    """Return the kind of a problem's motion, of a planar one by its window."""
    is_integrated = isinstance(problem.motion, StateMotion) or problem.method == "integration"
    return "any state" if is_integrated else _kind(window)


def _kind(window: Part | None) -> MotionKind:
    if window is None:
        return "any state"
    return motion_kind(window["kind"], window["ends"])
