"""Reads the values that conditions compare with, each as its subject needs it."""

import re
from collections.abc import Mapping
from datetime import UTC, datetime

from pydantic_core import PydanticCustomError

from service.schemas.query.conditions import Subject, Value
from service.schemas.query.facts import Fact
from service.schemas.query.kinds import Kind
from service.schemas.query.splitting import Excerpt, QueryError, unquoted
from service.schemas.reading.numbers import read_exact

LONGEST_TEXT = 256
_INSTANT = re.compile(
    r"\d{4}-\d\d-\d\d(?:[Tt]\d\d:\d\d(?::\d\d(?:\.\d{1,6})?)?(?:[Zz]|[+-]\d\d:\d\d))?\Z", re.ASCII
)
_UUID = re.compile(r"[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}\Z", re.ASCII)
_TRUTHS: Mapping[str, bool] = {"true": True, "false": False}


def read_value(subject: Subject, fact: Fact | None, part: Excerpt) -> Value:
    """Return the value in ``part``; raises :class:`QueryError`."""
    try:
        text, is_quoted = unquoted(part)
    except ValueError:
        message = (
            "a quotation mark stands alone; around a text there is one at each end, inside it is doubled"
        )
        raise QueryError("where", "invalid_condition", message, part.start) from None
    if not text and not is_quoted:
        raise _refused("invalid_value", "a value is missing", subject, fact, part)
    if len(text) > LONGEST_TEXT:
        message = f"a text of {len(text)} characters; at most {LONGEST_TEXT} are accepted"
        raise QueryError("where", "too_long", message, part.start)
    match subject.kind:
        case Kind.NUMBER:
            try:
                return float(read_exact(text))
            except PydanticCustomError as error:
                raise QueryError(
                    "where", "invalid_number", f"{text[:60]!r}: {error.message()}", part.start
                ) from None
        case Kind.INSTANT:
            return _instant(text, subject, fact, part)
        case Kind.IDENTIFIER:
            if not _UUID.match(text.lower()):
                raise _refused("invalid_value", f"{text[:60]!r} is no id", subject, fact, part)
            return text.lower()
        case Kind.TRUTH:
            if text not in _TRUTHS:
                raise _refused("invalid_value", f"{text[:60]!r} is neither", subject, fact, part)
            return _TRUTHS[text]
        case Kind.WORD:
            if fact is None or text not in fact.words:
                raise _refused("invalid_value", f"{text[:60]!r} is not accepted", subject, fact, part)
            return text
    # Neither can be stored, nor sent to Postgres.
    if "\x00" in text or any(0xD800 <= ord(character) < 0xE000 for character in text):
        raise _refused("invalid_value", "the text has a character that no text has", subject, fact, part)
    return text


def accepted_values(kind: Kind, fact: Fact | None) -> str:
    """Return the phrase that says which values are accepted."""
    match kind:
        case Kind.NUMBER:
            return "accepted is a number such as 5, 1e-12 or 17/10"
        case Kind.INSTANT:
            return "accepted are dates and instants such as 2026-01-31 and 2026-01-31T08:00:00Z"
        case Kind.IDENTIFIER:
            return "accepted is a UUID such as 019f0000-0000-7000-8000-000000000000"
        case Kind.TRUTH:
            return "accepted are true and false"
        case Kind.WORD if fact is not None:
            return f"accepted are {', '.join(fact.words)}"
    return 'accepted is a text; with commas, parentheses or < > = ! in it, in quotation marks: "a, b"'


def _instant(text: str, subject: Subject, fact: Fact | None, part: Excerpt) -> float:
    if not _INSTANT.match(text):
        raise _refused("invalid_value", f"{text[:60]!r} is no instant", subject, fact, part)
    try:
        moment = datetime.fromisoformat(text.upper())
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    except (ValueError, OverflowError):
        raise _refused("invalid_value", f"{text[:60]!r} is no instant", subject, fact, part) from None


def _refused(code: str, what: str, subject: Subject, fact: Fact | None, part: Excerpt) -> QueryError:
    return QueryError("where", code, f"{what}; {accepted_values(subject.kind, fact)}", part.start)
