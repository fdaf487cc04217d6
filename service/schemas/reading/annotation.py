"""Labels and a note, by which people find a job again; apart from their models: stores load no pydantic."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from service.schemas.reading.documents import Document

MOST_LABELS = 16
LONGEST_KEY, LONGEST_VALUE, LONGEST_NOTE = 63, 128, 2000
LABEL_KEY = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9_.-]{0,61}[A-Za-z0-9])?\Z")
LABEL_KEYS = f"1 to {LONGEST_KEY} letters, digits and - _ . between them"
FIELDS = ("labels", "note")
"""Fields of a document that are no part of the problem or the sweep that it states."""


@dataclass(frozen=True, slots=True)
class Annotation:
    """The labels and the note of a job, solution or sweep; part of no problem's identity."""

    labels: Mapping[str, str] = field(default_factory=dict)
    """Values by their keys, in the order of the keys."""
    note: str | None = None


UNANNOTATED = Annotation()


def split_annotation(document: Mapping[str, object]) -> tuple[Document, Annotation]:
    """Return a valid document without its labels and note, and these."""
    rest = {name: value for name, value in document.items() if name not in FIELDS}
    return rest, patched(UNANNOTATED, {name: document[name] for name in FIELDS if name in document})


def patched(annotation: Annotation, patch: Mapping[str, object]) -> Annotation:
    """Return it after a valid merge patch (RFC 7396): what is null goes, what is missing stays."""
    labels, note = dict(annotation.labels), annotation.note
    if "labels" in patch:
        changes = patch["labels"]
        if isinstance(changes, Mapping):
            labels.update(changes)
            labels = {key: value for key, value in labels.items() if value is not None}
        else:
            labels = {}
    if "note" in patch:
        text = patch["note"]
        note = text if isinstance(text, str) else None
    return Annotation(dict(sorted(labels.items())), note)
