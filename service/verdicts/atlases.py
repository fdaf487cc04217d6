"""Draws the atlas of a potential as a document. Runs in a child that can be killed."""

import json
from collections.abc import Sequence
from math import isfinite

from flint import arb

from service.dynamics.atlas.atlas import Atlas, AtlasPart, make_atlas
from service.dynamics.atlas.bands import Band, Measured, WindowSeries
from service.dynamics.atlas.changes import Change
from service.dynamics.verdict.verdict import decide
from service.schemas.atlas.reading import AtlasQuestion, read_any_atlas
from service.verdicts.documents import Document, verdict_document
from service.verdicts.kept import verdict_deadline
from service.verdicts.refusals import answer_or_refusal, refusal_of_verdict
from service.verdicts.searches import deadline

PROCESSOR_SECONDS, SECONDS = 4.0, 6.0
"""After either limit what is not proved is told as undecided; following the windows takes time too."""


def examine_atlas(document_json: str) -> str:
    """Answer what a document asks of an atlas: ``{"verdict": atlas}`` or ``{"error": …}``, as JSON."""
    return json.dumps(answer_or_refusal(json.loads(document_json), _judge), allow_nan=False)


def _judge(document: object) -> Document:
    asked = read_any_atlas(document)
    verdict = decide(asked.body, asked.potential, verdict_deadline())
    answer = verdict_document(asked.body, verdict, asked.potential)
    refused = refusal_of_verdict(verdict, answer, asked.accepts_undecided)
    if refused is not None:
        return refused
    is_late = deadline(PROCESSOR_SECONDS, SECONDS)
    atlas = make_atlas(asked.body, asked.potential, asked.range, asked.samples, is_late)
    return {"verdict": {"verdict": verdict.verdict, **atlas_document(atlas, asked)}}


def atlas_document(atlas: Atlas, asked: AtlasQuestion) -> Document:
    """Return the atlas as JSON members."""
    return {
        "lambda": [float(asked.range.lower), float(asked.range.upper)],
        "parts": [_part(part, wants_period=asked.wants_period) for part in atlas.parts],
        "changes": [_change(change) for change in atlas.changes],
        "undecided": [[float(end.mid()) for end in ends] for ends in atlas.undecided],
    }


def _part(part: AtlasPart, *, wants_period: bool) -> Document:
    reason = None
    if part.reason is not None:
        reason = {"code": part.reason.code, "detail": part.reason.message}
    series = part.series
    return {
        "lambda": [float(part.lower.mid()), float(part.upper.mid())],
        "samples": None if series is None else _samples(series, wants_period=wants_period),
        "reason": reason,
    }


def _samples(series: WindowSeries, *, wants_period: bool) -> Document:
    return {
        "lambda": series.lambda_.tolist(),
        "energy": _known(series.energy.value.tolist()),
        "energy_error": _known(series.energy.error.tolist()),
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
        "period": _known(band.period.value.tolist()) if has_period else None,
        "period_error": _known(band.period.error.tolist()) if has_period else None,
        "stability": None,
    }


def _pair(name: str, pair: tuple[Measured, Measured]) -> Document:
    return {
        name: [_known(each.value.tolist()) for each in pair],
        f"{name}_error": [_known(each.error.tolist()) for each in pair],
    }


def _known(values: Sequence[float]) -> list[float | None]:
    return [value if isfinite(value) else None for value in values]


def _change(change: Change) -> Document:
    return {
        "lambda": _enclosed(change.lower, change.upper),
        "kind": change.kind,
        "g1": _measured(change.g1),
        "g2": _measured(change.g2),
    }


def _enclosed(lower: arb, upper: arb) -> Document:
    both = lower.union(upper)
    middle = float(both.mid())
    # The distance from the double that is told to either end.
    error = max(abs(float((end - arb(middle)).abs_upper())) for end in (lower, upper))
    return {"value": middle, "error": error * (1.0 + 2.0**-50)}


def _measured(value: Measured | None) -> Document | None:
    if value is None or not isfinite(float(value.value)) or not isfinite(float(value.error)):
        return None
    return {"value": float(value.value), "error": float(value.error)}
