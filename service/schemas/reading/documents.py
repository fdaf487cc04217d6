"""Documents as text and as trees: strict JSON (RFC 8259), JSON pointers (RFC 6901), faults at their places.

Strict JSON has no NaN, no infinities, no repeated field, and bounded sizes. Instants are text by RFC 3339.

Labels and a note, by which people find a job again, are here too, apart from their models: stores load no
pydantic.
"""

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any  # documents that were read from JSON

from service.dynamics.errors import DynamicsError
from service.dynamics.exact import NumberBeyondDoubles, is_zero_text

Part = Mapping[str, Any]
"""A document that was read from JSON, or an object in it."""

Document = dict[str, object]
"""A document that is written."""


def instant_text(moment: datetime, timespec: str = "auto") -> str:
    """Return an instant in UTC as documents have it, ending in Z: URLs turn the + of +00:00 into a blank.

    ``timespec`` is that of :meth:`datetime.isoformat`.
    """
    return moment.isoformat(timespec=timespec).replace("+00:00", "Z")


MAX_FAULTS = 200
"""Most faults listed: of 100 000 wrong numbers only the first are."""
_TOLD_IN_SENTENCE = 10


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault of a document."""

    pointer: str
    """JSON pointer (RFC 6901) into the document; empty for the whole."""
    code: str
    """Stable code for programs."""
    message: str
    """Sentence for people; says what would have been accepted."""
    position: int | None = None
    """For a query, the character, from 0, at which the fault was found."""


class InvalidProblemError(Exception):
    """A document that is not a valid problem; ``faults`` lists every fault."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        told = [f"{fault.pointer or '/'}: {fault.message}" for fault in faults[:_TOLD_IN_SENTENCE]]
        if len(faults) > _TOLD_IN_SENTENCE:
            told.append(f"and {len(faults) - _TOLD_IN_SENTENCE} more")
        super().__init__("; ".join(told))
        self.faults = tuple(faults)


def first_of(faults: Sequence[Fault], most: int = MAX_FAULTS) -> list[Fault]:
    """Return the first of very many faults, and a last one that tells of the others."""
    if len(faults) <= most:
        return list(faults)
    return [*faults[:most], Fault("", "more_faults", f"there are more faults; the first {most} are listed")]


def pointer_to(parts: Iterable[str | int]) -> str:
    """Return the JSON pointer of a path."""
    return "".join(f"/{str(part).replace('~', '~0').replace('/', '~1')}" for part in parts)


def fault_of(error: DynamicsError, *, pointer: str = "") -> Fault:
    """Convert a domain error to a fault; ``pointer`` is used if the error has none."""
    return Fault(error.pointer or pointer, error.code, error.message)


class NoSuchPlaceError(LookupError):
    """A pointer to nothing; the message names the longest existing part and its content."""


def split_pointer(pointer: str) -> tuple[str, ...]:
    """Return the parts of a pointer; raises :class:`NoSuchPlaceError` if it is none."""
    if not pointer.startswith("/"):
        raise NoSuchPlaceError("a JSON pointer begins with /, such as /motion/lambda")
    return tuple(part.replace("~1", "/").replace("~0", "~") for part in pointer[1:].split("/"))


def value_at(document: object, path: Sequence[str]) -> object:
    """Return what is at ``path``; raises :class:`NoSuchPlaceError`."""
    for depth, part in enumerate(path):
        match document:
            case dict() if part in document:
                document = document[part]
            case list() if _is_index(part) and int(part) < len(document):
                document = document[int(part)]
            case _:
                where = "/" + "/".join(path[:depth])
                raise NoSuchPlaceError(f"there is no {part[:40]!r} in {where}, {_what_is_in(document)}")
    return document


def with_values(document: Mapping[str, Any], values: Mapping[tuple[str, ...], object]) -> dict[str, Any]:
    """Return a copy of ``document`` with ``values`` at existing places inside it; the rest is shared."""
    found: dict[str, Any] = _replaced(dict(document), values)
    return found


def _replaced(document: Any, values: Mapping[tuple[str, ...], object]) -> Any:  # noqa: ANN401 (any JSON)
    below: dict[str, dict[tuple[str, ...], object]] = {}
    for path, value in values.items():
        if not path:
            return value
        below.setdefault(path[0], {})[path[1:]] = value
    if isinstance(document, dict):
        return {**document, **{part: _replaced(document[part], rest) for part, rest in below.items()}}
    if isinstance(document, list):
        items = list(document)
        for part, rest in below.items():
            items[int(part)] = _replaced(items[int(part)], rest)
        return items
    return document


def _is_index(part: str) -> bool:
    return part == "0" or (part.isascii() and part.isdigit() and not part.startswith("0") and len(part) < 10)


def _what_is_in(document: object) -> str:
    match document:
        case dict():
            return f"which has {', '.join(map(str, list(document)[:20])) or 'no fields'}"
        case list():
            return f"a list of {len(document)}"
    return "which has no parts"


MAX_INTEGER_CHARACTERS = 1000
"""Longer integers are refused, since parsing takes quadratic time; problems need far fewer digits."""
MAX_FIELDS = 500
"""Most fields of one object. No document of ours has more than 120."""
MAX_ALL_FIELDS = 60_000
"""Most fields of a whole document: 1000 problems have some 30 000."""


class InvalidJsonError(ValueError):
    """Bytes that are not a JSON document."""


def parse_json(content: bytes) -> object:
    """Return the document in ``content``, which must be UTF-8.

    Raises
    ------
    InvalidJsonError
        The message names line and column where they are known.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        raise InvalidJsonError(f"byte {fault.start + 1} is not UTF-8") from fault
    try:
        document: object = json.loads(
            text,
            parse_constant=_refuse_constant,
            parse_int=_integer,
            parse_float=_double,
            object_pairs_hook=_Fields().read,
        )
        if "\\u" in text:
            # Half of a surrogate pair, written as an escape, is no character and cannot be stored or sent.
            json.dumps(document, ensure_ascii=False).encode()
    except json.JSONDecodeError as fault:
        raise InvalidJsonError(f"line {fault.lineno}, column {fault.colno}: {fault.msg}") from fault
    except UnicodeEncodeError as fault:
        raise InvalidJsonError("a \\u escape that is no character") from fault
    except RecursionError as fault:
        raise InvalidJsonError("lists and objects too deep inside each other") from fault
    return document


def _refuse_constant(word: str) -> object:
    raise InvalidJsonError(f"{word} is not JSON; finite numbers are accepted")


def _integer(text: str) -> int:
    if len(text) > MAX_INTEGER_CHARACTERS:
        raise InvalidJsonError(
            f"an integer of {len(text)} characters; at most {MAX_INTEGER_CHARACTERS} are accepted"
        )
    return int(text)


def _double(text: str) -> float:
    """Return the nearest double; if it is 0 or infinite, one that keeps the original text."""
    double = float(text)
    if math.isinf(double) or (double == 0.0 and not is_zero_text(text)):
        return NumberBeyondDoubles(text)
    return double


class _Fields:
    """Builds the objects of one document, and counts their fields."""

    def __init__(self) -> None:
        self._count = 0

    def read(self, pairs: Sequence[tuple[str, object]]) -> Document:
        """Return the object of these fields."""
        self._count += len(pairs)
        if len(pairs) > MAX_FIELDS:
            raise InvalidJsonError(f"an object of {len(pairs)} fields; at most {MAX_FIELDS} are accepted")
        if self._count > MAX_ALL_FIELDS:
            raise InvalidJsonError(f"more than {MAX_ALL_FIELDS} fields in all, which is the most accepted")
        document = dict(pairs)
        if len(document) < len(pairs):
            names = [name for name, _ in pairs]
            twice = next(name for name in names if names.count(name) > 1)
            raise InvalidJsonError(f"the field {twice!r} is given twice in one object")
        return document


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
