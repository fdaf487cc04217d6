"""Writes and reads cursors: the place of a row in an order, for one query only.

A cursor is opaque to clients. It holds the values that the order compares, and a digest of
the query it belongs to, so that it cannot be used with other conditions by mistake.
"""

import base64
import binascii
import hashlib
import json
import math
import re
from collections.abc import Sequence
from typing import Protocol

from service.schemas.query.conditions import Condition, Kind, OrderKey, Value
from service.storage.database.rows import is_id


class Ordered(Protocol):
    """A query whose rows have places."""

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """The conditions that choose the rows."""
        ...

    @property
    def keys(self) -> tuple[OrderKey, ...]:
        """The order; its last column is different for each row."""
        ...


class InvalidCursorError(Exception):
    """A text that is no cursor of this query."""

    def __init__(self) -> None:
        super().__init__(
            "not a cursor of this list with these conditions and this order; accepted is the one in `next` of"
            " the page before"
        )


def cursor_of(name: str, query: Ordered, place: Sequence[Value | None]) -> str:
    """Return the cursor of a row in the list ``name``; ``place`` has the values of the order's columns."""
    content = json.dumps([_digest(name, query), *place], separators=(",", ":"), allow_nan=False)
    return base64.urlsafe_b64encode(content.encode()).decode().rstrip("=")


def place_of(name: str, query: Ordered, cursor: str) -> tuple[Value | None, ...]:
    """Return the place that a cursor tells; raises :class:`InvalidCursorError`."""
    try:
        content = json.loads(base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)))
    except (ValueError, binascii.Error, RecursionError):
        raise InvalidCursorError from None
    keys = query.keys
    if not isinstance(content, list) or len(content) != 1 + len(keys) or content[0] != _digest(name, query):
        raise InvalidCursorError
    kinds = [key.subject.kind for key in keys]
    if (
        not all(_fits(kind, value) for kind, value in zip(kinds, content[1:], strict=True))
        or content[-1] is None
    ):
        raise InvalidCursorError
    return tuple(content[1:])


def _digest(name: str, query: Ordered) -> str:
    said = repr((name, query.conditions, query.keys))
    return hashlib.sha256(said.encode("utf-8", "backslashreplace")).hexdigest()[:12]


def _fits(kind: Kind, value: object) -> bool:
    """Tell whether a database can compare a column with a value."""
    if value is None:
        return True
    match kind:
        case Kind.NUMBER | Kind.INSTANT:
            return isinstance(value, int | float) and not isinstance(value, bool) and _is_double(value)
        case Kind.TRUTH:
            return isinstance(value, bool)
        case Kind.IDENTIFIER:
            return isinstance(value, str) and is_id(value)
    # Any text that a database stores.
    return isinstance(value, str) and not re.search(r"[\x00\ud800-\udfff]", value)


def _is_double(value: float) -> bool:
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False
