"""Writes problems, solutions, jobs and sweeps as text for people, as far as their documents go."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any  # JSON values: their shapes are those of the resources

from service.dynamics.numerics import NO_CROSS_CHECK
from service.schemas.replies.response_model import STABILITY_IN_WORDS, range_in_words

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
