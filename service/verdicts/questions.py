"""Draws atlases, and answers questions about integrals and potentials, as documents.

All of it runs in a child that can be killed.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import isfinite

from flint import arb

from service.dynamics.atlas.atlas import make_atlas
from service.dynamics.atlas.parts import Atlas, AtlasPart, Band, Change, Measured, Proof, WindowSeries
from service.dynamics.discovery.integral_search import search_integrals
from service.dynamics.discovery.judgement import judge_integral, judge_relation
from service.dynamics.discovery.potential_search import search_potentials
from service.dynamics.discovery.setting import LetteredSetting, Tell, read_setting, untold
from service.dynamics.exact import exact_number
from service.dynamics.numerics import printed_error
from service.dynamics.verdict.simple_form import simplified
from service.dynamics.verdict.verdict import Verdict, decide
from service.schemas.atlas.documents import AtlasRequest, trusted_atlas
from service.schemas.reading.documents import Document, Part
from service.schemas.study.lettered import moment_of
from service.schemas.study.reading import What
from service.verdicts.cached import verdict_deadline
from service.verdicts.documents import verdict_document
from service.verdicts.refusals import Deadline, answer_or_refusal, deadline, refusal, refusal_of_verdict

PROCESSOR_SECONDS, SECONDS = 6.0, 8.0
"""After either limit what is not proved is reported as such; a job then goes on."""
JOB_PROCESSOR_SECONDS, JOB_SECONDS = 180.0, 240.0
"""The same limits of a job, for which nobody waits."""


def examine_study(document_json: str) -> str:
    """Answer a document with ``what``, for a client that waits, as JSON.

    ``{"verdict": answer, "is_late": …}``, where ``is_late`` tells that something is open since the time was
    over, or ``{"error": …}``.
    """
    return _answer(document_json, PROCESSOR_SECONDS, SECONDS)


def examine_study_of_job(document_json: str, tell: Tell) -> str:
    """Answer the same with the time of a job; ``tell`` is told how far it is."""
    return _answer(document_json, JOB_PROCESSOR_SECONDS, JOB_SECONDS, tell)


def _answer(document_json: str, processor: float, clock: float, tell: Tell = untold) -> str:
    document: Part = json.loads(document_json)
    is_late = Deadline(deadline(processor, clock))
    judge = QUESTIONS[document["what"]]

    def examine(asked: Part) -> Document:
        try:
            found = judge(asked, is_late, tell)
        except TimeoutError:
            detail = f"no answer within {processor:g} s of processor time; a smaller degree may have one"
            return {"is_late": True, **refusal("time_limit", detail, "/degree")}
        return {"verdict": found, "is_late": is_late.was_reached}

    return json.dumps(answer_or_refusal(document, examine), allow_nan=False)


def _judged(document: Part, is_late: Callable[[], bool], _: Tell) -> Document:
    setting, areas_zero = _setting(document), document.get("areas") is not None
    judge = judge_relation
    if not document.get("relation"):
        judge = partial(judge_integral, relations=document.get("relations") or ())
    return judge(setting, document["function"], areas_zero=areas_zero, is_late=is_late).to_document()


def _integrals(document: Part, is_late: Callable[[], bool], tell: Tell) -> Document:
    degree: Part = document["degree"]
    omega, gamma = (int(exact_number(degree[name])) for name in ("omega", "gamma"))
    areas_zero = document.get("areas") is not None
    return search_integrals(
        _setting(document), omega, gamma, areas_zero=areas_zero, is_late=is_late, tell=tell
    ).to_document()


def _potentials(document: Part, is_late: Callable[[], bool], tell: Tell) -> Document:
    body: Part = document.get("body") or {}
    ratio = exact_number(body["A"]) / exact_number(body["C"]) if body else None
    return search_potentials(ratio, int(exact_number(document["degree"])), is_late, tell).to_document()


def _setting(document: Part) -> LetteredSetting:
    body, potential = document.get("body") or {}, document["potential"]
    moments = {name: moment_of(value) for name, value in body.items() if value is not None}
    parameters = {
        name: None if value is None else exact_number(value)
        for name, value in (potential.get("parameters") or {}).items()
    }
    return read_setting(moments, potential["expression"], parameters)


Judge = Callable[[Part, Callable[[], bool], Tell], Document]
QUESTIONS: Mapping[What, Judge] = {"integral": _judged, "integrals": _integrals, "potentials": _potentials}
"""The kinds of question that are answered here."""


ATLAS_PROCESSOR_SECONDS, ATLAS_SECONDS = 4.0, 6.0
"""After either limit what is not proved is reported as undecided; following the windows takes time too."""
ATLAS_JOB_PROCESSOR_SECONDS, ATLAS_JOB_SECONDS = 60.0, 120.0
"""The same limits of a job, for which nobody waits."""


def examine_atlas(document_json: str) -> str:
    """Answer what a document asks of an atlas, for a client that waits, as JSON.

    ``{"verdict": atlas, "is_late": …}``, where ``is_late`` tells that something is undecided since the time
    was over, or ``{"error": …}``.
    """
    return _answer_atlas(
        document_json, partial(_draw, processor=ATLAS_PROCESSOR_SECONDS, clock=ATLAS_SECONDS)
    )


def examine_atlas_of_job(document_json: str) -> str:
    """Answer the same with the time of a job."""
    return _answer_atlas(
        document_json, partial(_draw, processor=ATLAS_JOB_PROCESSOR_SECONDS, clock=ATLAS_JOB_SECONDS)
    )


def examine_setting(document_json: str) -> str:
    """Answer whether an atlas can be drawn: ``{"verdict": null}`` or ``{"error": …}``, as JSON."""
    return _answer_atlas(
        document_json, lambda document: {"verdict": None, **_judge(trusted_atlas(document))[1]}
    )


def _answer_atlas(document_json: str, judge: Callable[[Part], Document]) -> str:
    return json.dumps(answer_or_refusal(json.loads(document_json), judge), allow_nan=False)


def _draw(document: Part, *, processor: float, clock: float) -> Document:
    request = trusted_atlas(document)
    verdict, refused = _judge(request)
    if refused:
        return refused
    is_late = Deadline(deadline(processor, clock))
    potential = simplified(request.potential)
    atlas = make_atlas(
        request.body, potential, request.range, request.samples, is_late, has_periods=request.wants_period
    )
    found = {"verdict": verdict.verdict, **atlas_document(atlas, request)}
    return {"verdict": found, "is_late": bool(atlas.undecided) and is_late.was_reached}


def _judge(request: AtlasRequest) -> tuple[Verdict, Document]:
    """Return the verdict on the potential, and the refusal if it has no atlas, else an empty document."""
    verdict = decide(request.body, request.potential, verdict_deadline())
    answer = verdict_document(request.body, verdict, request.potential)
    return verdict, refusal_of_verdict(verdict, answer, request.accepts_undecided) or {}


def atlas_document(atlas: Atlas, request: AtlasRequest) -> Document:
    """Return the atlas as JSON members."""
    return {
        "lambda": [float(request.range.lower), float(request.range.upper)],
        "parts": [_part(part, atlas.proof, wants_period=request.wants_period) for part in atlas.parts],
        "changes": [_change(change, atlas.proof) for change in atlas.changes],
        "undecided": [[float(end.mid()) for end in ends] for ends in atlas.undecided],
    }


def _part(part: AtlasPart, proof: Proof, *, wants_period: bool) -> Document:
    reason = None
    if part.reason is not None:
        reason = {"code": part.reason.code, "detail": part.reason.message}
    series = part.series
    return {
        "lambda": [float(part.lower.mid()), float(part.upper.mid())],
        "samples": None if series is None else _samples(series, wants_period=wants_period),
        "reason": reason,
        "proof": proof,
    }


def _samples(series: WindowSeries, *, wants_period: bool) -> Document:
    return {
        "lambda": series.lambda_.tolist(),
        "energy": _finite(series.energy.value.tolist()),
        "energy_error": _finite(series.energy.error.tolist()),
        "windows": [_window(band, wants_period=wants_period) for band in series.bands],
    }


def _window(band: Band, *, wants_period: bool) -> Document:
    has_period = wants_period and band.window.kind == "periodic"
    return {
        "window": band.window.index,
        "kind": band.window.kind,
        "ends": list(band.window.ends),
        "has_mirror_image": len(band.window.arcs) > 1,
        **_pair("g1", band.g1),
        **_pair("g2", band.g2),
        "period": _finite(band.period.value.tolist()) if has_period else None,
        "period_error": _finite(band.period.error.tolist()) if has_period else None,
        "stability": None,
    }


def _pair(name: str, pair: tuple[Measured, Measured]) -> Document:
    return {
        name: [_finite(each.value.tolist()) for each in pair],
        f"{name}_error": [_finite(each.error.tolist()) for each in pair],
    }


def _finite(values: Sequence[float]) -> list[float | None]:
    return [value if isfinite(value) else None for value in values]


def _change(change: Change, proof: Proof) -> Document:
    return {
        "lambda": _enclosed(change.lower, change.upper),
        "kind": change.kind,
        "g1": _measured(change.g1),
        "g2": _measured(change.g2),
        "proof": proof,
    }


def _enclosed(lower: arb, upper: arb) -> Document:
    both = lower.union(upper)
    middle = float(both.mid())
    # The distance from the double that is written to either end.
    error = max(abs(float((end - arb(middle)).abs_upper())) for end in (lower, upper))
    return {"value": middle, "error": printed_error(middle, error * (1.0 + 2.0**-50))}


def _measured(value: Measured | None) -> Document | None:
    if value is None or not isfinite(float(value.value)) or not isfinite(float(value.error)):
        return None
    return {"value": float(value.value), "error": printed_error(float(value.value), float(value.error))}
