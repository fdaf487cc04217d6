"""Writes verdicts, refusals, problems, solutions, jobs and sweeps as text for people.

What is written goes as far as the documents go.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any  # JSON values: their shapes are those of the resources

from pydantic import BaseModel, ConfigDict, Field

from service.dynamics.numerics import NO_CROSS_CHECK
from service.schemas.reading.documents import Fault
from service.schemas.replies.response_model import QUADRANTS_OUT, STABILITY_IN_WORDS, range_in_words
from service.schemas.replies.verdict import (
    BallOut,
    ClassificationOut,
    ExistenceOut,
    FunctionOut,
    MotionWindowOut,
    NearCaseOut,
    StretchOut,
    VerdictOut,
)


def describe_classification(found: ClassificationOut) -> Iterator[str]:
    """Yield the cases that the state lies on, the nearest classical one with its residuals, and the rest."""
    yield f"lies on     {', '.join(found.on) if found.on else 'no classical or integrable case'}"
    if found.nearest is not None:
        yield f"nearest     {_near(found.nearest)}"
        for name, left in found.nearest.relations.items():
            yield f"            {name}: {'no value here' if left is None else f'{left:.3g}'}"
    for case in found.cases:
        if found.nearest is None or case.case != found.nearest.case:
            yield f"also        {_near(case)}"
    for integrable in found.integrable:
        verb = "holds" if integrable.holds else "does not hold"
        residuals = ", ".join(f"{name} {left:.3g}" for name, left in integrable.residuals.items())
        yield f"integrable  {integrable.case} {verb}: {residuals}"


def _near(case: NearCaseOut) -> str:
    if case.is_on:
        return f"{case.case}: the state lies on it"
    return f"{case.case}: " + (
        "Newton's steps from the state lead nowhere"
        if case.distance is None
        else f"at most {case.distance:.3g} away"
    )


DIGITS = 6
"""Most significant digits of an end."""


def existence_sentence(existence: ExistenceOut) -> str:
    """Return it, as ``motions exist for lambda in (0.5795, ∞)``."""
    name, found = ("lambda", existence.lambda_) if existence.nu is None else ("nu", existence.nu)
    open_ones = existence.undecided
    if found:
        said = f"motions exist for {name} in {_listed(found)}"
    else:
        said = f"none was found for any {name}" if open_ones else f"there is none for any {name}"
    return f"{said}; not decided for {name} in {_listed(open_ones)}" if open_ones else said


def _listed(stretches: Sequence[StretchOut]) -> str:
    return " and ".join(f"({_end(each.from_, each, 0)}, {_end(each.to, each, 1)})" for each in stretches)


def _end(ball: BallOut | None, stretch: StretchOut, side: int) -> str:
    """Return the known digits of an end, or the infinite end."""
    if ball is None:
        other = stretch.from_ or stretch.to
        is_negative = other is not None and other.mid.startswith("-")
        return ("-∞", "0")[side] if is_negative else ("0", "∞")[side]
    middle, radius = float(ball.mid), float(ball.rad)
    known = DIGITS
    if radius and middle:
        known = max(1, min(DIGITS, math.floor(math.log10(abs(middle) / radius))))
    return f"{middle:.{known}g}"


_PROOFS = {
    "symbolic": "proved: the compatibility equation holds identically",
    "counterexample": "proved by a point where the compatibility equation, or its solution, breaks",
    "numeric": "not proved",
}


_FAILURES = {
    "residual": "residual    ",
    "jump_of_potential": "V jumps by  ",
    "jump_of_energy": "h jumps by  ",
}


def _ratios(ratios: Sequence[str], others: Sequence[str]) -> str:
    """Return for which moments a refused polynomial would be admissible."""
    found = [f"A/C = {ratio}" for ratio in ratios] + [f"the roots A of {each}" for each in others]
    return f"admissible  for {' and '.join(found) or 'no A/C'}"


class Refusal(BaseModel):
    """The error of an examination, as the API would send it."""

    model_config = ConfigDict(extra="allow")

    code: str
    detail: str
    pointer: str
    faults: list[Fault] = Field(default_factory=list)

    def reason(self) -> str:
        """Return each fault with its place, or the message with its evidence."""
        if self.faults:
            return "\n".join(f"{f.pointer or '/'}: {f.message} ({f.code})" for f in self.faults)
        extras = dict(self.model_extra or {})
        nearest, ratios = extras.pop("nearest", None), extras.pop("ratios", None)
        evidence = [f"  {name}: {json.dumps(value)}" for name, value in extras.items()]
        if isinstance(nearest, dict):
            evidence.append(f"  {_nearest(nearest['expression'], nearest['relative_squared_distance'])}")
        if isinstance(ratios, dict):
            evidence.append(f"  {_ratios(ratios['ratios'], ratios['others'])}")
        return "\n".join([f"{self.code}: {self.detail}", *evidence])


class Answer(BaseModel):
    """The result of an examination: a verdict (null for a motion from any state), or an error."""

    verdict: VerdictOut | None = None
    error: Refusal | None = None


def describe_verdict(verdict: VerdictOut, formats: Sequence[str] = ()) -> str:
    """Return the verdict and its proof in a few lines, and then its formulas in these ``formats``."""
    return "\n".join([*_lines(verdict), *_formulas(verdict, formats)])


def _formulas(verdict: VerdictOut, formats: Sequence[str]) -> Iterator[str]:
    for formula in verdict.formulas or []:
        for name in formats:
            signs = ", ".join(quadrant.replace("p", "+").replace("m", "-") for quadrant in formula.quadrants)
            where = "" if len(formula.quadrants) == len(QUADRANTS_OUT) else f"  % signs of g1, g3: {signs}"
            yield f"{name:<11} {getattr(formula.formats, name)}{where}"


def _lines(verdict: VerdictOut) -> Iterator[str]:
    if verdict.verdict is not None and verdict.proof is not None:
        yield f"verdict     {verdict.verdict}"
        yield f"proof       {_PROOFS[verdict.proof]}"
    if verdict.energy is not None:
        yield from _by_quadrant("energy      h", dict(verdict.energy.quadrants))
    if verdict.decomposition is not None:
        parts = [(q, part) for q, part in verdict.decomposition.quadrants if part is not None]
        yield from _by_quadrant("V1[F], F(w)", {quadrant: part.F for quadrant, part in parts})
        yield from _by_quadrant("Q G,  G(g2)", {quadrant: part.G for quadrant, part in parts})
    if verdict.counterexample is not None:
        example = verdict.counterexample
        within = "" if example.radius is None else f", each ± {example.radius}"
        yield f"at          (g1, g2, g3) = ({', '.join(example.g)}){within}"
        yield f"{_FAILURES[example.kind]}{example.residual.mid} ± {example.residual.rad}"
    if verdict.nearest is not None:
        found = verdict.nearest
        text = _nearest(found.expression, found.relative_squared_distance)
        yield f"{text}, least up to degree {found.degree}"
    for warning in verdict.warnings:
        yield f"warning     {warning.message} ({warning.code})"
    if verdict.evidence is not None:
        evidence = verdict.evidence
        yield (
            f"evidence    the residual at {evidence.points} points, enclosed with {evidence.bits} bits: "
            f"none excludes 0, the largest is {evidence.largest_enclosure}"
        )
        yield f"not proved  {evidence.doubt}"
    if verdict.motions is not None:
        if not verdict.motions:
            yield "motions     none with this lambda and these signs of g1 and g3"
            if verdict.existence is not None:
                yield f"            {existence_sentence(verdict.existence)}"
        for window in verdict.motions:
            yield f"window {window.window:<4} {_window(window)}"
    if verdict.ratios is not None:
        yield _ratios(verdict.ratios.ratios, verdict.ratios.others)
    for known in verdict.known_cases:
        yield f"known case  {known.name} ({known.source})"
    if verdict.classical is not None:
        yield from describe_classification(verdict.classical)


def _nearest(expression: str, distance: str) -> str:
    """Return the admissible polynomial that is nearest, with its distance."""
    return f"nearest     {expression}, at the relative squared distance {float(Fraction(distance)):.6g}"


def _by_quadrant(what: str, functions: Mapping[str, FunctionOut | None]) -> Iterator[str]:
    """Yield a function, or those of the quadrants, each once with the signs that it holds for."""
    texts = {
        quadrant: _function(function) for quadrant, function in functions.items() if function is not None
    }
    if len(set(texts.values())) == 1:
        yield f"{what} = {next(iter(texts.values()))}"
        return
    for text in dict.fromkeys(texts.values()):
        alike = [quadrant for quadrant, other in texts.items() if other == text]
        signs = ", ".join(quadrant.replace("p", "+").replace("m", "-") for quadrant in alike)
        yield f"{what} = {text} (signs of g1, g3: {signs})"


def _function(function: FunctionOut) -> str:
    if function.formula is None:
        return "no formula; its values are in the JSON"
    return function.formula if function.named is None else f"{function.formula} = {function.named}"


def _window(window: MotionWindowOut) -> str:
    (first, last), (lowest, highest) = window.g1, window.g2
    return (
        f" {window.kind}, {range_in_words(window.ends)}; g1 from {first:.12g} to {last:.12g}, "
        f"g2 from {lowest:.12g} to {highest:.12g}"
    )


Part = Mapping[str, Any]
_SIGNIFICANT = 6


def rounded(number: object) -> str:
    """Return a number with six digits, other values as they are; the exact one is in the JSON."""
    return (
        f"{number:.{_SIGNIFICANT}g}" if isinstance(number, float) else "-" if number is None else str(number)
    )


def potential_text(potential: Part) -> str:
    """Return a potential in one line: its formula or its numbers."""
    numbers = {**potential, **potential.get("parameters", {})}
    fields = ("type", "parameters", "expression")
    given = [f"{name} = {_value(value)}" for name, value in numbers.items() if name not in fields]
    named = ", ".join(given)
    what = potential.get("expression") or potential.get("type", "")
    return f"{what}; {named}" if named else str(what)


def curve_text(motion: Part) -> str:
    """Return the number that chooses the curve of a motion, or its kind."""
    for name in ("lambda", "nu"):
        if name in motion:
            return f"{'ν = ' if name == 'nu' else ''}{motion[name]}"
    return str(motion.get("case") or motion.get("type", "-"))


def describe_problem(problem: Part) -> Iterator[str]:
    """Yield the lines of a problem."""
    body = ", ".join(f"{name} = {value}" for name, value in problem["body"].items())
    yield f"body        {body}"
    yield f"potential   {potential_text(problem['potential'])}"
    if (motion := problem.get("motion")) is not None:
        given = ", ".join(f"{name} = {_value(value)}" for name, value in motion.items() if name != "type")
        yield f"motion      {motion.get('type', '')}{', ' if given else ''}{given}"
    if (times := problem.get("time")) is not None:
        if "times" in times:
            yield f"times       {len(times['times'])}, listed"
        elif "periods" in times:
            yield f"times       {times['periods']} periods, {times.get('samples', '?')} samples"
        else:
            first, last = times.get("start", 0), times["stop"]
            yield f"times       {first} to {last}, {times.get('samples', '?')} samples"
    accuracy = ", ".join(f"{name} {value}" for name, value in problem.get("accuracy", {}).items())
    if accuracy:
        yield f"accuracy    {accuracy}"


def describe_solution(summary: Part) -> Iterator[str]:
    """Yield the lines of a solution: its numbers with their error bounds."""
    yield f"method      {summary['method']}"
    kinds = summary.get("error_kind") or {}
    period = summary["period"]
    if period is not None:
        yield f"period      {_estimate(period)}{_kind(kinds, 'period')}"
    if summary["aperiodic"] is not None:
        yield f"aperiodic   {summary['aperiodic']}"
        for when, end in (summary.get("asymptotes") or {}).items():
            yield f"{when:<12}{_asymptote(end)}{_kind(kinds, f'asymptotes.{when}.time')}"
    energy = summary["energy"]
    yield f"energy      {_estimate(energy)}{_kind(kinds, 'energy')}"
    window = summary["window"]
    if window is not None:
        first, last = window["g1"]
        yield f"range       {range_in_words(window['ends'])}; g1 from {first:.12g} to {last:.12g}"
    everywhere = "in every variable at the stored samples"
    yield f"error       claimed: ≤ {summary['error']:.1e} {everywhere}{_kind(kinds, 'samples')}"
    groups = {name: error["relative"] for name, error in (summary.get("errors") or {}).items()}
    if groups:
        parts = (f"{name} {error:.1e}" for name, error in groups.items() if error is not None)
        yield f"relative    ≤ {', '.join(parts)}"
    for name, integral in (summary["invariants"] or {}).items():
        value = f" of {integral['value']!r} ({integral['kind']})" if "kind" in integral else ""
        value = f" of {_estimate(integral['value'])}" if isinstance(integral.get("value"), Mapping) else value
        yield f"{name + ' drift':<18}{integral['drift']:.1e}{value}"
    stability = summary["stability"]
    if stability is not None:
        found = stability["trace"]
        trace = _estimate(
            found if isinstance(found, Mapping) else {"value": found, "error": stability["error"]}
        )
        words = STABILITY_IN_WORDS[stability["verdict"]]
        is_classical = summary.get("problem", {}).get("motion", {}).get("type") == "classical"
        against = "" if is_classical else "against leaving its plane: "
        yield f"stability   {against}{words}, trace {trace}{_kind(kinds, 'stability')}"
    for name, angle in (summary.get("precession") or {}).items():
        yield f"precession  {name} {_estimate(angle)} a period{_kind(kinds, f'precession.{name}')}"
    check, warnings = summary["cross_check"], summary.get("warnings") or []
    if check is not None and not any(warning["code"] == NO_CROSS_CHECK for warning in warnings):
        verdict = "agrees" if check["agrees"] else "DISAGREES"
        extent = f"within {check['disagreement']:.1e} up to t = {check['horizon']:.6g}"
        yield f"cross-check {verdict} with {check['method']} {extent}"
    for case in summary.get("known_cases", ()):
        yield f"known case  {case['name']} ({case['source']})"
    for convention in summary["conventions"]:
        yield f"convention  {convention}"
    for warning in warnings:
        yield f"warning     {warning['message']} ({warning['code']})"


def describe_sweep(state: Part) -> Iterator[str]:
    """Yield the lines of a sweep: how far it is, its axes, and its problem."""
    done = f"{state['done']} done, {state['refused']} of them without a solution"
    yield f"points      {state['points']}, {done}"
    if (left := state.get("remaining_seconds")) is not None:
        yield f"remaining   {left:.3g} s"
    if (document := state.get("document")) is None:
        return
    for axis in document["axes"]:
        kind = next(name for name in ("values", "linspace", "logspace", "uniform") if name in axis)
        given = axis[kind]
        shown = f"{len(given)} values" if kind == "values" else f"{kind} {given}"
        yield f"axis        {axis['pointer']}: {shown}"
    yield from describe_problem(document["base"])


def describe_record(document: Part) -> Iterator[str]:
    """Yield the lines of anything stored: a solution, a job or a sweep, with its id, labels and instants."""
    yield f"id          {document['id']}"
    if "state" in document:
        yield f"state       {document['state']}"
    if "points" in document:
        yield from describe_sweep(document)
    else:
        yield from describe_problem(document["problem"])
    if "method" in document:
        yield from describe_solution(document)
    for name in ("solution", "job", "tier"):
        if document.get(name) is not None:
            yield f"{name:<12}{document[name]}"
    if (error := document.get("error")) is not None and isinstance(error, Mapping):
        yield f"error       {error.get('code')}: {error.get('detail')}"
    labels = ", ".join(f"{name}={value}" for name, value in document.get("labels", {}).items())
    for name, value in (("labels", labels), ("note", document.get("note"))):
        if value:
            yield f"{name:<12}{value}"
    for name in ("created_at", "started_at", "finished_at"):
        if document.get(name) is not None:
            yield f"{name.removesuffix('_at'):<12}{document[name]}"


def _value(value: object) -> str:
    if isinstance(value, Mapping):
        return f"({', '.join(f'{name} {_value(each)}' for name, each in value.items())})"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"({', '.join(map(_value, value))})"
    return str(value)


def _estimate(estimate: Part) -> str:
    if "radius" in estimate:
        return f"{estimate['value']} ± {estimate['radius']}"
    return f"{estimate['value']!r} ± {estimate['error']:.1e}"


def _kind(kinds: Part, path: str) -> str:
    """Return how the error of a number is known; nothing of solutions of earlier versions."""
    return f" ({kinds[path]})" if path in kinds else ""


def _asymptote(end: Part) -> str:
    where = "{} at g = ({:.12g}, {:.12g}, {:.12g})".format(end["kind"], *end["gamma"])
    if end["time"] is not None:
        return f"{where}, t = {end['time']['value']!r} ± {end['time']['error']:.1e}"
    if end["rate"] is not None:
        return f"{where}, approached like exp(-{end['rate']['value']:.12g} |t|)"
    return where
