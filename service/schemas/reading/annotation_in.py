"""Labels and notes in documents: given with a job or a sweep, or changed by a merge patch (RFC 7396)."""

import re
from collections.abc import Mapping
from typing import Annotated

from pydantic import AfterValidator, Field, WithJsonSchema

from service.schemas.reading.annotation import LABEL_KEY, LABEL_KEYS, LONGEST_NOTE, LONGEST_VALUE, MOST_LABELS
from service.schemas.reading.numbers import refuse
from service.schemas.reading.parts import WireModel

_NOT_IN_VALUES = re.compile(r"[\x00-\x1f\x7f-\x9f]")
"""Control characters."""
_NOT_IN_NOTES = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
"""The same, but tabs and ends of lines."""


def _key(text: str) -> str:
    if not LABEL_KEY.match(text):
        raise refuse("invalid_label", f"{text[:60]!r} is no key of a label; accepted are {LABEL_KEYS}")
    return text


def _value(text: str) -> str:
    if not 1 <= len(text) <= LONGEST_VALUE or _NOT_IN_VALUES.search(text):
        accepted = f"accepted are 1 to {LONGEST_VALUE} characters without control characters"
        raise refuse("invalid_label", f"{text[:60]!r} is no value of a label; {accepted}")
    return text


def _note(text: str) -> str:
    if len(text) > LONGEST_NOTE or _NOT_IN_NOTES.search(text):
        accepted = f"accepted are at most {LONGEST_NOTE}; of control characters only tabs and newlines"
        raise refuse("invalid_note", f"a note of {len(text)} characters; {accepted}")
    return text


def _labels_of(value: Mapping[str, object], **further: object) -> WithJsonSchema:
    return WithJsonSchema(
        {
            "type": "object",
            "propertyNames": {"pattern": "^[A-Za-z0-9]([A-Za-z0-9_.-]{0,61}[A-Za-z0-9])?$"},
            "additionalProperties": value,
            "examples": [{"project": "thesis"}],
            **further,
        }
    )


_VALUE_SCHEMA = {
    "type": "string",
    "minLength": 1,
    "maxLength": LONGEST_VALUE,
    "pattern": r"^[^\u0000-\u001f\u007f-\u009f]+$",
}
_NOTE_SCHEMA = {
    "type": "string",
    "maxLength": LONGEST_NOTE,
    "pattern": r"^[^\u0000-\u0008\u000b-\u001f\u007f-\u009f]*$",
}

_Key = Annotated[str, AfterValidator(_key)]
_Value = Annotated[str, AfterValidator(_value)]
Labels = Annotated[
    dict[_Key, _Value], Field(max_length=MOST_LABELS), _labels_of(_VALUE_SCHEMA, maxProperties=MOST_LABELS)
]
Note = Annotated[str, AfterValidator(_note), WithJsonSchema(_NOTE_SCHEMA)]
_LabelChanges = Annotated[dict[_Key, _Value | None], _labels_of({"anyOf": [_VALUE_SCHEMA, {"type": "null"}]})]

LABELS_HELP = (
    f"Up to {MOST_LABELS} words to find it by, such as project: thesis. Keys: {LABEL_KEYS}; values: 1 to"
    f" {LONGEST_VALUE} characters without control characters. No part of what is computed."
)
NOTE_HELP = f"A text of at most {LONGEST_NOTE} characters. No part of what is computed."


class MarksPatchIn(WireModel):
    """A merge patch (RFC 7396) of labels and note: what is left out stays, what is null goes."""

    labels: _LabelChanges | None = Field(
        default=None,
        description="Values by their keys; null removes a label, and in place of the object all labels.",
    )
    note: Note | None = Field(default=None, description=f"{NOTE_HELP} null removes it.")
