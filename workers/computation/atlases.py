"""Draws the atlas of a job; the stability at each λ is that which a job of this motion tells."""

import json

from service.jobs.records import JobResult, Refused
from service.schemas.atlas.documents import trusted_atlas
from service.schemas.reading.documents import Document, Part
from service.storage.codecs.packing import encode_document
from service.verdicts.questions import examine_atlas_of_job
from workers.computation.compiled_code import way_for
from workers.computation.compute import solve_document

STABILITY_COLUMNS = {"trace": "trace", "trace_error": "error", "multipliers": "multipliers"}
STABILITY_COLUMNS |= {"multipliers_error": "multipliers_error", "verdict": "verdict"}
"""Names of columns, and of what a solution tells."""
SHARED_MEMBERS = ("body", "potential", "accept")
"""Members that a problem has in common with the document of an atlas."""


def draw_document(document_json: str) -> JobResult | Refused:
    """Draw what a document of :func:`~service.schemas.atlas.documents.read_atlas` asks for."""
    answer = examine_atlas_of_job(document_json)
    if trusted_atlas(json.loads(document_json)).wants_stability:
        answer = with_stability(document_json, answer, waits=True)
    result = json.loads(answer)
    return Refused(result["error"]) if "error" in result else JobResult(encode_document(result["verdict"]))


def with_stability(document_json: str, atlas_json: str, *, waits: bool = False) -> str:
    """Return an atlas as :mod:`service.verdicts.questions` answers it, with the stability of its windows.

    ``document_json`` is what was asked. Windows that are not periodic have none. A plain way that ``waits``
    for kernels raises :class:`~service.jobs.kernels.NeedsKernelsError` in place of refusing.
    """
    document, answer = json.loads(document_json), json.loads(atlas_json)
    atlas = answer.get("verdict", {"parts": []})
    for part in atlas["parts"]:
        samples = part["samples"]
        for window in () if samples is None else samples["windows"]:
            if window["kind"] == "periodic":
                window["stability"] = _along(document, window["window"], samples["lambda"], waits)
    return json.dumps(answer, allow_nan=False)


def _along(document: Document, window: int, lambdas: list[float], waits: bool) -> Document:
    columns: dict[str, list[object]] = {name: [] for name in (*STABILITY_COLUMNS, "reason")}
    for lambda_ in lambdas:
        found, reason = _at(document, window, lambda_, waits)
        for column, name in STABILITY_COLUMNS.items():
            columns[column].append(None if found is None else found[name])
        columns["reason"].append(reason)
    return dict(columns)


def _at(document: Document, window: int, lambda_: float, waits: bool) -> tuple[Part | None, str | None]:
    """Return the stability that a job tells, or the code it is refused with."""
    motion: Document = {"type": "planar", "lambda": lambda_, "window": window}
    motion |= {name: document[name] for name in ("g1_sign", "g3_sign") if name in document}
    problem: Document = {name: document[name] for name in SHARED_MEMBERS if name in document}
    problem["motion"] = motion
    problem["time"] = {"periods": 1, "samples": 2}
    problem["outputs"] = ["stability"]
    outcome = solve_document(json.dumps(problem), way=way_for("planar", "outputs"), waits=waits)
    if isinstance(outcome, Refused):
        return None, str(outcome.error["code"])
    stability = outcome.summary["stability"]
    return stability, None
