"""Draws the atlas of a potential as a document. Runs in a child that can be killed."""

import json
from collections.abc import Callable, Sequence
from functools import partial
from math import isfinite

from flint import arb

from service.dynamics.atlas.atlas import make_atlas
from service.dynamics.atlas.parts import Atlas, AtlasPart, Band, Change, Measured, Proof, WindowSeries
from service.dynamics.numerics import printed_error
from service.dynamics.verdict.simple_form import simplified
from service.dynamics.verdict.verdict import Verdict, decide
from service.schemas.atlas.reading import AtlasRequest, trusted_atlas
from service.schemas.reading.documents import Document, Part
from service.verdicts.cached import verdict_deadline
from service.verdicts.documents import verdict_document
from service.verdicts.refusals import Deadline, answer_or_refusal, deadline, refusal_of_verdict

PROCESSOR_SECONDS, SECONDS = 4.0, 6.0
"""After either limit what is not proved is reported as undecided; following the windows takes time too."""
JOB_PROCESSOR_SECONDS, JOB_SECONDS = 60.0, 120.0
"""The same limits of a job, for which nobody waits."""


def examine_atlas(document_json: str) -> str:
    """Answer what a document asks of an atlas, for a client that waits, as JSON.

    ``{"verdict": atlas, "is_late": …}``, where ``is_late`` tells that something is undecided since the time
    was over, or ``{"error": …}``.
    """
    return _answer(document_json, partial(_draw, processor=PROCESSOR_SECONDS, clock=SECONDS))


def examine_atlas_of_job(document_json: str) -> str:
    """Answer the same with the time of a job."""
    return _answer(document_json, partial(_draw, processor=JOB_PROCESSOR_SECONDS, clock=JOB_SECONDS))


def examine_setting(document_json: str) -> str:
    """Answer whether an atlas can be drawn: ``{"verdict": null}`` or ``{"error": …}``, as JSON."""
    return _answer(document_json, lambda document: {"verdict": None, **_judge(trusted_atlas(document))[1]})


def _answer(document_json: str, judge: Callable[[Part], Document]) -> str:
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
