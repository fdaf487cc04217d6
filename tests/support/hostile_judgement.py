"""What the service says of a hostile problem, held against the truth. The functions run in children."""

import json
import signal
import time
from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache
from math import isfinite, nan
from typing import Any

import numpy as np
from flint import arb, ctx

from service.dynamics.errors import DynamicsError
from service.dynamics.motion import Motion
from service.schemas.problem.problem import read_problem
from service.verdicts.examination import examine_problems, examine_question
from tests.support.examinations import examination_of
from tests.support.hostile_documents import Document, draw
from tests.support.hostile_motions import BITS, TrueMotion, TrueWindow, motion_of, setting_of
from tests.support.hostile_reference import UnknownError
from workers.computation.compiled_code import keep_compiled_code
from workers.computation.compute import as_solved, certified_samples, solve
from workers.solvers.errors import CertifiedUnavailableError

SAME = 1e-11
"""Ends of windows further apart are different; they are doubles near balls of 160 bits."""
DIGITS = 50

TIME_LIMIT = "time limit"
PATIENCE = 1.0
"""Seconds after which proven steps give up; most that end are proved in less."""
BOTH = " both"
"""After a tier: with a cross-check."""
WAYS = ("draft", "standard", "high", "certified", "standard" + BOTH)

Facts = dict[str, Any]


def facts_of(seed: int, index: int, only: str | None = None) -> str:
    """Return a problem, of a class if that is asked, and what is true of it, as JSON."""
    draws = np.random.default_rng([seed, index])
    hostile = draw(draws, only)
    facts: Facts = {
        "kind": hostile.kind,
        "document": hostile.document,
        "truth": hostile.truth,
        "reason": hostile.reason,
        "windows": None,
        "motion": None,
        "unknown": None,
    }
    if hostile.known is not None:
        with ctx.workprec(BITS):
            try:
                setting = setting_of(hostile.known)
                facts["windows"] = [_window(window) for window in setting.windows]
                motion = motion_of(setting, draws)
                facts["motion"] = None if motion is None else _motion(motion)
            except UnknownError as reason:
                facts["unknown"] = str(reason)
    return json.dumps(facts)


def _window(window: TrueWindow) -> Facts:
    return {
        "kind": window.kind,
        "ends": list(window.ends),
        "g1": list(window.g1),
        "g2": list(window.g2),
    }


def _motion(motion: TrueMotion) -> Facts:
    return {
        "document": motion.document,
        "window": _window(motion.window),
        "period": None if motion.period is None else _text(motion.period),
        "energy": _text(motion.energy),
        "times": list(motion.times),
        "states": [[_text(value) for value in state] for state in motion.states],
        "collisions": [None if time is None else _text(time) for time in motion.collisions],
    }


def _text(value: arb) -> str:
    return str(value.str(DIGITS))


class _TimeLimitError(BaseException):
    """Nothing that catches errors catches this."""


def limited(seconds: float, function: Callable[..., str], *arguments: object) -> str:
    """Return the function's answer with the ``seconds`` it took, or a refusal after so many of them.

    Of the processor's time, not of the clock: on a machine that others use too that would count their work.
    """

    def stop(number: int, frame: object) -> None:
        raise _TimeLimitError

    # Without this every child compiles the kernels anew.
    keep_compiled_code()
    before = signal.signal(signal.SIGPROF, stop)
    began = time.process_time()
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        answer: Facts = json.loads(function(*arguments))
    except _TimeLimitError:
        answer = {"code": TIME_LIMIT, "faults": [], "claims": {}}
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
    return json.dumps({**answer, "seconds": time.process_time() - began})


def judged_verdict(facts_json: str) -> str:
    """Return ``{verdict, code, faults}``: what the verdict and its windows are, and what is wrong of it."""
    facts = json.loads(facts_json)
    answer = json.loads(examine_question(json.dumps(facts["document"])))
    faults: list[str] = []
    if "error" in answer:
        code = answer["error"]["code"]
        if code in ("inadmissible_potential", "undefined_potential") and facts["truth"] == "admissible":
            faults.append(f"verdict: {code}, {facts['reason']}")
        if code == "no_motion" and facts["windows"]:
            faults.append(f"windows: none of {_listed(facts['windows'])}")
        return json.dumps({"verdict": None, "code": code, "faults": faults})
    verdict = answer["verdict"]
    said = verdict["verdict"]
    if said != "undecided" and said != facts["truth"]:
        faults.append(f"verdict: {said} ({verdict['proof']}), {facts['reason']}")
    if said != "inadmissible" and facts["windows"] is not None:
        found = verdict.get("motions") or []
        if not windows_agree(facts["windows"], found):
            faults.append(f"windows: {_listed(found)} for {_listed(facts['windows'])}")
    return json.dumps({"verdict": said, "code": None, "faults": faults})


def _listed(windows: list[Facts]) -> str:
    return "; ".join(
        f"{w['kind']} {w['ends'][0]} to {w['ends'][1]} g1 [{w['g1'][0]:.12g}, {w['g1'][1]:.12g}]"
        f" g2 [{w['g2'][0]:.12g}, {w['g2'][1]:.12g}]"
        for w in windows
    )


def windows_agree(true: list[Facts], found: list[Facts]) -> bool:
    """Say whether every true window was found, and no other."""
    left = list(found)
    for window in true:
        same = [other for other in left if window_agrees(window, other)]
        if not same:
            return False
        left.remove(same[0])
    return not left


def window_agrees(true: Facts, found: Facts) -> bool:
    numbers = zip([*true["g1"], *true["g2"]], [*found["g1"], *found["g2"]], strict=True)
    return (
        true["kind"] == found["kind"]
        and sorted(true["ends"]) == sorted(found["ends"])
        and all(abs(a - b) <= SAME for a, b in numbers)
    )


def _patience() -> Callable[[Fraction], None]:
    """Return what ends proven steps, as the limit of a job does: beside a narrow wall they are many."""
    began = time.monotonic()

    def watch(t: Fraction) -> None:
        if time.monotonic() - began > PATIENCE:
            raise CertifiedUnavailableError(f"it is proven until t = {float(t):.10g}", pointer="/time")

    return watch


def judged_tier(facts_json: str, tier: str) -> str:
    """Solve the motion in a tier: ``{code, claims: {name: [claimed, actual]}, faults}``."""
    motion = json.loads(facts_json)["motion"]
    document = _asked(motion, tier)
    report = _examined(json.dumps(motion))[WAYS.index(tier)]
    if "error" in report:
        return json.dumps({"code": report["error"]["code"], "claims": {}, "faults": []})
    problem = as_solved(read_problem(document))
    try:
        found, certified = solve(problem), None
        if problem.accuracy.tier == "certified":
            found, certified, _ = certified_samples(problem, watch=_patience())
    except DynamicsError as refusal:
        return json.dumps({"code": refusal.code, "claims": {}, "faults": []})
    with ctx.workprec(2 * BITS):
        claims = _claims(motion, found)
        if certified is not None:
            claims |= _enclosures(motion, certified.period, certified.energy, certified.states)
    faults = [
        f"{name}: claimed {claimed:.3g}, actual {actual:.3g}"
        for name, (claimed, actual) in claims.items()
        if not actual <= claimed
    ]
    if found.window is not None and not _is_window(motion["window"], found):
        faults.append(f"window: {found.window.kind} {found.window.g1} for {_listed([motion['window']])}")
    check = found.cross_check
    # A check that compares no time but the start says that it is none, and contradicts nothing.
    if check is not None and not check.agrees and check.why_none is None and not faults:
        faults.append(f"cross-check: disagrees by {check.disagreement:.3g} with a true motion")
    if check is not None and check.agrees and faults:
        faults.append(f"cross-check: agrees up to {check.horizon:.3g} with a wrong motion")
    return json.dumps({"code": None, "claims": claims, "faults": faults})


def _asked(motion: Facts, way: str) -> Document:
    tier = way.removesuffix(BOTH)
    document = {**motion["document"], "time": {"times": motion["times"]}, "accuracy": {"tier": tier}}
    return document | ({"method": "both"} if tier != way else {})


@lru_cache(maxsize=1)
def _examined(motion_json: str) -> list[Facts]:
    """Return what the service says of a motion asked in each of WAYS, as of a list of problems."""
    motion = json.loads(motion_json)
    asked = examination_of([_asked(motion, way) for way in WAYS])
    reports: list[Facts] = json.loads(examine_problems(json.dumps(asked)))["answers"]
    return reports


def _is_window(true: Facts, motion: Motion) -> bool:
    window = motion.window
    assert window is not None
    found = {"kind": window.kind, "ends": window.ends, "g1": window.g1, "g2": window.g2}
    return window_agrees(true, found)


def _claims(motion: Facts, found: Motion) -> dict[str, tuple[float, float]]:
    stored = found.dense(found.times, found.low_parts)
    claims = {
        "samples": (found.error, _farthest(motion["states"], found.samples.tolist())),
        "stored": (found.dense.error_at(found.times), _farthest(motion["states"], stored.tolist())),
        "energy": (found.energy.error, _apart(motion["energy"], arb(found.energy.value))),
    }
    for name, at, end in zip(
        ("past", "future"), motion["collisions"], (found.past, found.future), strict=True
    ):
        told = None if end is None or end.kind != "collision" else end.time
        if at is not None and told is not None:
            claims[name] = (told.error, _apart(at, arb(told.value)))
        elif at is not None or told is not None:
            claims[name] = (nan, nan)
    period = found.dense.period
    if period is not None and motion["period"] is not None:
        claims["period"] = (period.error, _apart(motion["period"], arb(period.hi) + arb(period.lo)))
    elif period is not None or motion["period"] is not None:
        # One of them does not come back.
        claims["period"] = (nan, nan)
    return claims


def _enclosures(
    motion: Facts, period: arb | None, energy: arb | None, states: tuple[tuple[arb, ...], ...]
) -> dict[str, tuple[float, float]]:
    """Return 0 for claimed, and how far balls are from those that they must overlap."""
    apart = max(
        _apart(text, ball)
        for row, state in zip(motion["states"], states, strict=True)
        for text, ball in zip(row, state, strict=True)
    )
    # Proven steps enclose no period, and the energy with the other integrals.
    known = {name: found for name, found in (("period", period), ("energy", energy)) if found is not None}
    return {"enclosed samples": (0.0, apart)} | {
        f"enclosed {name}": (0.0, _apart(motion[name], found)) for name, found in known.items()
    }


def _farthest(rows: list[list[str]], samples: list[list[float]]) -> float:
    actual = [
        _apart(text, arb(value)) if isfinite(value) else nan
        for row, sample in zip(rows, samples, strict=True)
        for text, value in zip(row, sample, strict=True)
    ]
    return nan if any(value != value for value in actual) else max(actual)


def _apart(text: str, found: arb) -> float:
    """Return how far two balls are proven to be apart."""
    return float(abs(arb(text) - found).abs_lower())
