"""The formulas of a verdict as LaTeX and MathML, in two steps, both in children that can be killed.

First :func:`examine_question_with_formulas` writes each formula down as it stands, which takes
milliseconds. Then :func:`simplify_formula` is called for one formula after the other, as long as there is
time. A formula that SymPy does not simplify in time stays as it was written down.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any  # Any: documents that were read from JSON

from service.dynamics.errors import FormulaError
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tree import VARIABLES, Tree, format_tree
from service.dynamics.inverse.named import NamedSum
from service.dynamics.potentials.families.general_solution import QUADRANTS, SIGNS
from service.dynamics.potentials.potential import NoClosedFormError
from service.dynamics.potentials.recognition import is_even_in_g2, recognise
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.formulas import elliptic_motion, reduced_motion
from service.dynamics.reduction.windows import find_windows
from service.dynamics.verdict.proofs.energy_terms import sum_text
from service.dynamics.verdict.simple_form import simplified
from service.schemas.problem.problem import Question, trusted_question
from service.schemas.reading.documents import Document
from service.typesetting.equations import TIME, typeset
from service.verdicts.examination import examine_question

Signs = Mapping[str, int]
REAL: Signs = dict.fromkeys(VARIABLES, 0)
_OF_ELLIPTIC: Mapping[str, Signs] = {"x1": {}, "x2": {}, "k": {"x": 1, "x1": 1}}
"""Formulas of an elliptic motion to simplify, numbers and the polynomial k, with the signs of variables."""
_MOST_PRODUCTS = 20_000


@dataclass(frozen=True, slots=True)
class Equation:
    """One equation of the answer, before it is written down."""

    name: str
    """One of :data:`service.typesetting.equations.NAMES`."""
    formula: Tree
    signs: Signs | None
    """Signs of its variables; None where there is nothing to simplify."""
    quadrants: tuple[str, ...] = QUADRANTS
    at: tuple[str, ...] = ()
    """JSON pointers into the verdict to the texts that it is."""
    is_named: bool = False
    g2_sign: int | None = None
    window: int | None = None


def examine_question_with_formulas(text: str) -> str:
    """Answer ``{"document", "formats"}`` as :func:`examine_question` answers the document, with formulas.

    In the verdict, ``formulas`` are the equations as they stand, and ``works`` what :func:`simplify_formula`
    takes, to be removed before anybody sees it.
    """
    request = json.loads(text)
    answer = json.loads(examine_question(json.dumps(request["document"])))
    verdict = answer.get("verdict")
    if verdict is not None:
        equations = list(equations_of(trusted_question(request["document"]), verdict))
        verdict["formulas"] = [_row(equation, request["formats"]) for equation in equations]
        verdict["works"] = _works(equations, request["formats"])
    return json.dumps(answer, allow_nan=False)


def simplify_formula(text: str) -> str:
    """Return a formula simplified: the formats of each equation with it, by its place; {} if it cannot be.

    ``text`` is one of the works that :func:`examine_question_with_formulas` made.
    """
    # SymPy takes a third of a second to import: only a child does, and only when it is needed.
    from service.typesetting.simplification import simplified  # noqa: PLC0415

    work = json.loads(text)
    found = simplified(parse(work["formula"]), work["signs"])
    if found is None:
        return "{}"
    rows = {place: typeset(name, found, work["formats"]) for place, name in work["rows"].items()}
    return json.dumps(rows)


def with_simplified(verdict: Mapping[str, Any], answers: Sequence[str]) -> dict[str, Any]:
    """Return the verdict with what :func:`simplify_formula` answered in its formulas, and without works."""
    rows = [dict(row) for row in verdict["formulas"]]
    for answer in answers:
        for place, formats in json.loads(answer).items():
            rows[int(place)] |= {"formats": formats, "simplified": True}
    return {**{name: part for name, part in verdict.items() if name != "works"}, "formulas": rows}


def _row(equation: Equation, formats: Sequence[Any]) -> Document:
    return {
        "name": equation.name.partition("(")[0],
        "formats": typeset(equation.name, equation.formula, formats),
        "simplified": False,
        "named": equation.is_named,
        "at": list(equation.at),
        "quadrants": list(equation.quadrants),
        "g2_sign": equation.g2_sign,
        "window": equation.window,
    }


def _works(equations: Sequence[Equation], formats: Sequence[Any]) -> list[str]:
    """Return what has to be simplified: equal formulas once, those with the client's names first."""
    rows: dict[tuple[str, tuple[tuple[str, int], ...]], dict[str, str]] = {}
    for place, equation in sorted(enumerate(equations), key=lambda item: not item[1].is_named):
        if equation.signs is not None:
            key = format_tree(equation.formula), tuple(sorted(equation.signs.items()))
            rows.setdefault(key, {})[str(place)] = equation.name
    return [
        json.dumps({"formula": formula, "signs": dict(signs), "rows": places, "formats": formats})
        for (formula, signs), places in rows.items()
    ]


def equations_of(question: Question, verdict: Mapping[str, Any]) -> Iterator[Equation]:
    """Yield what is known of a potential as equations: h, F, G, the reduced motion, the nearest one, V."""
    named = question.named()
    V, V_named = _potential(question, named)
    yield from _functions(verdict)
    if V is not None and verdict["verdict"] == "admissible":
        yield from _reduced(question, verdict, V, V_named)
        yield from _elliptic(question)
    if verdict["nearest"] is not None:
        for key, is_named in (("expression_named", True), ("expression", False)):
            if verdict["nearest"][key] is not None:
                at = (f"/nearest/{key}",)
                yield Equation("nearest", parse(verdict["nearest"][key]), REAL, at=at, is_named=is_named)
    if V_named is not None:
        yield Equation("V", V_named, REAL, is_named=True)
    if V is not None:
        yield Equation("V", V, REAL)


def _potential(question: Question, named: object) -> tuple[Tree | None, Tree | None]:
    """Return V with all numbers put in, and with the names of parameters; None where it has no formula."""
    try:
        V = question.potential.tree
    except NoClosedFormError:
        return None, None
    if not isinstance(named, NamedSum):
        return V, None
    parts = [(factor, part.formula()) for factor, part in named.parts]
    text = sum_text(f"{factor}*({part})" if factor else f"({part})" for factor, part in parts)
    try:
        return V, parse(text)
    except FormulaError:
        return V, None


@dataclass(slots=True)
class _Texts:
    """The texts of one function, equal ones once."""

    found: dict[tuple[str, bool], tuple[list[str], list[str]]] = field(default_factory=dict)

    def add(self, text: str | None, at: str, quadrant: str | None, *, is_named: bool) -> None:
        if text is not None:
            places, quadrants = self.found.setdefault((text, is_named), ([], []))
            places.append(at)
            if quadrant is not None:
                quadrants.append(quadrant)


def _functions(verdict: Mapping[str, Any]) -> Iterator[Equation]:
    """Yield h, F and G, with names first."""
    energy, parts = verdict["energy"], verdict["decomposition"]
    if energy is not None:
        variable, texts = energy["variable"], _Texts()
        for key, is_named in (("h_named", True), ("h", False)):
            texts.add(energy[key], f"/energy/{key}", None, is_named=is_named)
        _add_quadrants(texts, energy["quadrants"], "/energy/quadrants", "")
        yield from _equations(texts, f"h({variable})", variable)
    if parts is None:
        return
    for name, variable in (("F", "w"), ("G", "g2")):
        texts = _Texts()
        for key, is_named in ((f"{name}_named", True), (name, False)):
            texts.add(parts[key], f"/decomposition/{key}", None, is_named=is_named)
        _add_quadrants(texts, parts["quadrants"], "/decomposition/quadrants", name)
        yield from _equations(texts, name, variable)


def _add_quadrants(texts: _Texts, quadrants: Mapping[str, Any], at: str, name: str) -> None:
    for key, is_named in (("named", True), ("formula", False)):
        for quadrant, found in quadrants.items():
            function = found[name] if found is not None and name else found
            if function is not None:
                place = "/".join(part for part in (at, quadrant, name, key) if part)
                texts.add(function[key], place, quadrant, is_named=is_named)


def _equations(texts: _Texts, name: str, variable: str) -> Iterator[Equation]:
    for (text, is_named), (places, quadrants) in texts.found.items():
        known = tuple(quadrants) or QUADRANTS
        sign = {"w": 1, "lambda": 1, "g2": 0}.get(variable)
        if sign is None:
            # The sign of nu is that of g1.
            of_g1 = {SIGNS[quadrant][0] for quadrant in QUADRANTS if quadrant in known}
            sign = of_g1.pop() if len(of_g1) == 1 else 0
        yield Equation(name, parse(text), {variable: sign}, known, tuple(places), is_named=is_named)


def _reduced(
    question: Question, verdict: Mapping[str, Any], V: Tree, V_named: Tree | None
) -> Iterator[Equation]:
    """Yield the curve, p², the speed of g1 and the time.

    For the signs of g1 and g3 of the motion; without one, for the first for which there is an energy.
    """
    energies = {} if verdict["energy"] is None else verdict["energy"]["quadrants"]
    known = [quadrant for quadrant in QUADRANTS if (energies.get(quadrant) or {}).get("formula") is not None]
    motion = question.motion
    if isinstance(motion, PlanarMotion):
        known = [quadrant for quadrant in known if SIGNS[quadrant] == (motion.sign_of_g1, motion.g3_sign)]
    if not known:
        return
    quadrant, body = known[0], question.body
    h = energies[quadrant]
    is_named = V_named is not None and h["named"] is not None
    g1_sign, g3_sign = SIGNS[quadrant]
    curve_sign = {"nu": g1_sign} if body.A == 2 * body.C else {"lambda": 1}
    signs = {"g1": g1_sign, **curve_sign}
    for g2_sign in (None,) if is_even_in_g2(question.potential) else (1, -1):
        try:
            found = reduced_motion(
                body,
                V_named if V_named is not None and is_named else V,
                parse(h["named"] if is_named else h["formula"]),
                g1_sign=g1_sign,
                g3_sign=g3_sign,
                g2_sign=g2_sign or 1,
            )
        except FormulaError:
            return
        if g2_sign != -1:
            yield Equation("curve", found.curve, signs, (quadrant,))
        for name, tree in (
            ("p_squared", found.p_squared),
            ("speed_squared", found.speed_squared),
            (TIME, found.speed_squared),
        ):
            yield Equation(name, tree, signs, (quadrant,), is_named=is_named, g2_sign=g2_sign)


def _elliptic(question: Question) -> Iterator[Equation]:
    """Yield the periodic motions of three terms in elliptic functions of time."""
    body, motion = question.body, question.motion
    if not isinstance(motion, PlanarMotion) or body.A != 2 * body.C:
        return
    sign = motion.sign_of_g1
    terms = recognise(body, question.potential, sign, most_products=_MOST_PRODUCTS)
    if terms is None:
        return
    quadrant = next(quadrant for quadrant in QUADRANTS if SIGNS[quadrant] == (sign, motion.g3_sign))
    for window in find_windows(body, simplified(question.potential), motion):
        found = elliptic_motion(body, terms, motion.lambda_squared, sign, window)
        if found is not None and motion.window in (None, window.index):
            for name, tree in found.items():
                yield Equation(name, tree, _OF_ELLIPTIC.get(name), (quadrant,), window=window.index)
