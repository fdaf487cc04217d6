"""Documents of problems and sweeps, made from arguments, from files, or from other documents."""

import copy
import difflib
import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from polhode.documents.quantities import Exact, axis_section, items, written
from polhode.errors import WrongArgumentError

Document = dict[str, object]
Given = Mapping[str, object] | str | os.PathLike[str]
"""A document, or the file that holds one."""
Body = Sequence[Exact] | Mapping[str, object]

DEFAULT_TIME: Mapping[str, object] = {"stop": 10, "samples": 101}
_OPTIONS = (
    *("body", "potential", "motion", "lam", "nu", "time", "start", "stop", "samples", "periods", "times"),
    *("accuracy", "tolerance", "relative", "tier", "method", "outputs", "parameters", "labels", "note"),
)
_NAME = re.compile(r"[A-Za-z_]\w*")
_SHORT = {"lam": "/motion/lambda", "nu": "/motion/nu", "A": "/body/A", "B": "/body/B", "C": "/body/C"}
_SHORT |= {"stop": "/time/stop", "periods": "/time/periods"}
_SHORT |= {"tolerance": "/accuracy/tolerance", "relative": "/accuracy/relative"}


def problem(
    base: Given | None = None,
    *,
    body: Body | None = None,
    potential: str | Mapping[str, object] | None = None,
    parameters: Mapping[str, object] | None = None,
    motion: Mapping[str, object] | None = None,
    lam: Exact | None = None,
    nu: Exact | None = None,
    time: Mapping[str, object] | None = None,
    stop: Exact | None = None,
    samples: int | None = None,
    periods: Exact | None = None,
    times: Sequence[Exact] | None = None,
    accuracy: Mapping[str, object] | None = None,
    tolerance: Exact | None = None,
    relative: Exact | None = None,
    tier: str | None = None,
    method: str | None = None,
    outputs: Sequence[str] | None = None,
    labels: Mapping[str, str] | None = None,
    note: str | None = None,
    **numbers: Exact,
) -> Document:
    """Return a problem document.

    Parameters
    ----------
    base
        A document or the file of one; what else is given replaces its parts.
    body
        Moments of inertia (A, C) or (A, B, C), or the section of the document.
    potential
        A formula in g1, g2, g3 and parameters, or the section of the document.
    parameters, numbers
        Values of the formula's parameters; ``a=-1`` is short for ``parameters={"a": -1}``.
    lam, nu, motion
        The curve of a planar motion, by λ or ν; or the section of the document.
    stop, samples, periods, times, time
        Which samples are stored; without them and without ``base`` 101 up to t = 10. Any others can be
        asked for later.
    tolerance, relative, tier, accuracy
        Largest error of any of the six variables, the same relative to the size of the variable's group, or a
        tier; or the section of the document.
    method, outputs
        As in the document.
    labels, note
        What the solution can be found by, and text beside it; no part of the problem.

    Raises
    ------
    WrongArgumentError
        Arguments exclude each other, or a name is that of no parameter; the message has the nearest.
    """
    found = read(base)
    if body is not None:
        found["body"] = _body(body)
    if potential is not None:
        found["potential"] = _potential(potential, {**(parameters or {}), **numbers})
    else:
        put_numbers(found, {**(parameters or {}), **numbers})
    _one_of("motion", motion=motion, lam=lam, nu=nu)
    if motion is not None:
        found["motion"] = written(motion)
    for name, value in (("lambda", lam), ("nu", nu)):
        if value is not None:
            found["motion"] = _curve(found.get("motion"), name, value)
    _one_of("time", time=time, stop=stop, periods=periods, times=times)
    times_given = (time, samples, stop, periods, times)
    # A whole document says itself what it asks for.
    if base is None or any(each is not None for each in times_given):
        found["time"] = _time(found.get("time"), time, samples, stop=stop, periods=periods, times=times)
    found |= _how(accuracy, tolerance, relative, tier, method, outputs)
    for section, given in (("labels", labels), ("note", note)):
        if given is not None:
            found[section] = written(given)
    return found


def audit_of(
    tier: str | None, tolerance: Exact | None, relative: Exact | None, method: str | None
) -> Document:
    """Return the document that asks for an audit; what is None is left out."""
    return _how(None, tolerance, relative, tier, method, None)


def question(
    potential: str | Given,
    *,
    body: Body | None,
    motion: Mapping[str, object] | None = None,
    lam: Exact | None = None,
    numbers: Mapping[str, Exact],
) -> Document:
    """Return the document that asks for a verdict: a formula and a body, or a whole document."""
    _one_of("motion", motion=motion, lam=lam)
    if body is None:
        asked = read(potential)
        put_numbers(asked, numbers)
    else:
        asked = {"body": _body(body)}
        asked["potential"] = _potential(potential if isinstance(potential, str) else read(potential), numbers)
    if motion is not None:
        asked["motion"] = written(motion)
    if lam is not None:
        asked["motion"] = _curve(asked.get("motion"), "lambda", lam)
    return asked


def read(given: Given | None) -> Document:
    """Return a copy of a document, or that of a file.

    Raises
    ------
    WrongArgumentError
        There is no such file, or it has no JSON object.
    """
    if given is None:
        return {}
    if isinstance(given, Mapping):
        document = written(given)
    else:
        try:
            document = json.loads(Path(given).read_text(encoding="utf-8"))
        except OSError as fault:
            raise WrongArgumentError(
                f"{os.fspath(given)}: {fault.strerror}; a dict, or a file of JSON is accepted"
            ) from fault
        except ValueError as fault:
            raise WrongArgumentError(f"{os.fspath(given)}: not JSON: {fault}") from fault
    if not isinstance(document, dict):
        raise WrongArgumentError(f"{type(document).__name__}; a JSON object is accepted")
    return document


def put_numbers(document: Document, numbers: Mapping[str, object]) -> None:
    """Put numbers into a document, each at the pointer that it has or that its name stands for."""
    for name, value in numbers.items():
        put(document, pointer_of(document, name), value)


def pointer_of(document: Mapping[str, object], name: str) -> str:
    """Return the JSON pointer of a number: of a parameter, of a field of the potential, λ, ν, A, B or C.

    Raises
    ------
    WrongArgumentError
        There is no such number; the message has the nearest name.
    """
    if name.startswith("/"):
        return name
    known: dict[str, str] = {}
    potential = document.get("potential")
    if isinstance(potential, Mapping):
        fields = (each for each in potential if each not in ("type", "expression", "parameters", "F", "G"))
        known |= {str(each): f"/potential/{each}" for each in fields}
        parameters = potential.get("parameters")
        if isinstance(parameters, Mapping):
            known |= {str(each): f"/potential/parameters/{each}" for each in parameters}
        formula = potential.get("expression")
        if isinstance(formula, str) and name in _NAME.findall(formula):
            # A parameter that has no value yet.
            known.setdefault(name, f"/potential/parameters/{name}")
    known = {**_SHORT, **known}
    if name in known:
        return known[name]
    raise WrongArgumentError(
        f"there is no number {name!r} in this problem{nearest(name, [*known, *_OPTIONS])}; accepted are"
        f" {', '.join(sorted(known))} and JSON pointers"
    )


def put(document: Document, pointer: str, value: object) -> None:
    """Replace the number at a JSON pointer.

    Raises
    ------
    WrongArgumentError
        There is no object or list on the way.
    """
    *way, last = [part.replace("~1", "/").replace("~0", "~") for part in pointer.split("/")[1:]]
    target: object = document
    try:
        for part in way:
            if part == "parameters" and isinstance(target, dict):
                target.setdefault(part, {})
            target = target[int(part)] if isinstance(target, list) else target[part]  # type: ignore[index]  # reported below
        if isinstance(target, list):
            target[int(last)] = written(value)
        else:
            target[last] = written(value)  # type: ignore[index]  # reported below
    except (KeyError, IndexError, TypeError, ValueError) as fault:
        raise WrongArgumentError(f"{pointer} is nowhere in the problem") from fault


def changed(document: Mapping[str, object], numbers: Mapping[str, object]) -> Document:
    """Return a copy of a document with other numbers at these JSON pointers."""
    other = copy.deepcopy(dict(document))
    put_numbers(other, numbers)
    return other


def nearest(word: str, known: Sequence[str]) -> str:
    """Return ``; did you mean '…'?`` with the nearest of the known words, or nothing."""
    # Short for one of them, such as tol; else a slip of the pen.
    found = [each for each in known if each.startswith(word)] if len(word) > 2 else []
    found = found or difflib.get_close_matches(word, known, n=1)
    return f"; did you mean {found[0]!r}?" if found else ""


def _body(body: Body) -> object:
    if isinstance(body, Mapping):
        return written(body)
    names = (
        None if isinstance(body, str) or not hasattr(body, "__len__") else {2: "AC", 3: "ABC"}.get(len(body))
    )
    if names is None:
        raise WrongArgumentError(f"body={body!r}; (A, C), (A, B, C) or a dict is accepted")
    return dict(zip(names, map(written, body), strict=True))


def _potential(potential: str | Mapping[str, object], numbers: Mapping[str, object]) -> object:
    if not isinstance(potential, str):
        found: Document = {"potential": written(potential)}
        put_numbers(found, numbers)
        return found["potential"]
    names = set(_NAME.findall(potential))
    for name in numbers:
        if name not in names:
            guess = nearest(name, [*names, *_OPTIONS])
            raise WrongArgumentError(f"{name!r} is no option and not in the formula {potential!r}{guess}")
    return {"type": "expression", "expression": potential, "parameters": written(numbers)}


def _curve(motion: object, name: str, value: object) -> Document:
    others = (
        {k: v for k, v in motion.items() if k not in ("lambda", "nu")} if isinstance(motion, Mapping) else {}
    )
    return {"type": "planar", **others, name: written(value)}


def _time(known: object, time: object, samples: int | None, **spans: object) -> object:
    if time is not None:
        return written(time)
    given = {name: written(value) for name, value in spans.items() if value is not None}
    before = known if isinstance(known, Mapping) else DEFAULT_TIME
    if not given:
        return {**before, **({} if samples is None else {"samples": written(samples)})}
    count = written(samples) or before.get("samples", DEFAULT_TIME["samples"])
    return given if "times" in given else {**given, "samples": count}


def _how(
    accuracy: Mapping[str, object] | None,
    tolerance: Exact | None,
    relative: Exact | None,
    tier: str | None,
    method: str | None,
    outputs: Sequence[str] | None,
) -> Document:
    """Return the sections that say how a problem is solved, as far as they are given."""
    _one_of("accuracy", accuracy=accuracy, tolerance=tolerance, relative=relative, tier=tier)
    sections: Sequence[tuple[str, object]] = (
        ("accuracy", accuracy),
        ("accuracy", None if tolerance is None else {"tolerance": tolerance}),
        ("accuracy", None if relative is None else {"relative": relative}),
        ("accuracy", None if tier is None else {"tier": tier}),
        ("method", method),
        ("outputs", outputs),
    )
    return {section: written(given) for section, given in sections if given is not None}


def _one_of(section: str, **given: object) -> None:
    named = [name for name, value in given.items() if value is not None]
    if len(named) > 1:
        raise WrongArgumentError(f"{' and '.join(named)} both set {section}; one of them is accepted")


DEFAULT_KEEP = ("period", "energy", "error")


def sweep_document(
    base: Given, axes: Mapping[str, object], keep: Sequence[str], combine: str, *, series: bool
) -> Document:
    """Return the document of a sweep.

    Raises
    ------
    WrongArgumentError
        An axis is none, or has the name of no number of the base.
    """
    whole = read(base)
    if "base" in whole:
        if axes:
            raise WrongArgumentError("the document is a whole sweep; axes are accepted with a single problem")
        return whole
    start = problem(whole)
    sections = []
    for name, values in axes.items():
        pointer = pointer_of(start, name)
        start = _with_first(start, pointer, axis_section(values))
        sections.append({"pointer": pointer, **axis_section(values)})
    return {
        "base": start,
        "axes": sections,
        "combine": combine,
        "keep": written(keep),
        "series": written(series),
    }


def _with_first(base: Document, pointer: str, section: Mapping[str, object]) -> Document:
    """Return the base with the first value of an axis: it has to be a problem before the axis varies it."""
    listed = items(next(value for name, value in section.items() if name != "seed"))
    if not listed:
        raise WrongArgumentError(f"the axis of {pointer} has no values; one or more are accepted")
    if pointer in ("/motion/lambda", "/motion/nu"):
        return problem(base, **{"lam" if pointer.endswith("lambda") else "nu": listed[0]})
    return changed(base, {pointer: listed[0]})
