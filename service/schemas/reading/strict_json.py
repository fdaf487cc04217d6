"""Parses strict JSON (RFC 8259): no NaN, no infinities, no repeated field, bounded sizes."""

import json
import math
from collections.abc import Sequence

from service.dynamics.exact import NumberBeyondDoubles, is_zero_text

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

    def read(self, pairs: Sequence[tuple[str, object]]) -> dict[str, object]:
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
