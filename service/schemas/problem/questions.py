"""The input of a verdict, and the potential in it with the names of its parameters."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction

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
from service.dynamics.potentials.families.general_solution import QUADRANTS, Quadrant
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import Problem
from service.schemas.problem.trusted import (
    Motion,
    body_of,
    centre_of,
    formula_of,
    motion_of,
    parameters_of,
    potential_of,
    problem_of,
)
from service.schemas.reading.documents import Part

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
