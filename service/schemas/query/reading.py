"""Reads the queries of lists, such as ``where=period<5,tier in (draft,high)&order=-energy,id``.

::

    where      = condition *("," condition)
    condition  = subject operator value / subject "in" "(" value *("," value) ")"
               / subject "is null" / subject "is not null"
    subject    = fact / JSON pointer / "label." key      ; may stand in quotation marks
    operator   = "=" / "!=" / "<" / "<=" / ">" / ">="

Nothing is evaluated: a text becomes :class:`~service.schemas.query.terms.Condition`, or faults.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime

from pydantic_core import PydanticCustomError

from service.schemas.query.terms import (
    QUOTE,
    Condition,
    Excerpt,
    Fact,
    Kind,
    Operator,
    OrderKey,
    QueryError,
    Subject,
    Value,
    Vocabulary,
    split,
    unquoted,
)
from service.schemas.reading.documents import Fault
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


LONGEST_QUERY = 8000
"""Characters of all conditions together."""
MOST_CONDITIONS = 32
MOST_VALUES = 200
"""Largest number of values of one ``in``."""

_SIGNS: dict[str, Operator] = {"=": "=", "!=": "!=", "<": "<", "<=": "<=", ">": ">", ">=": ">="}
_SUBJECT = re.compile(r'"(?:[^"]|"")*"|[^\s<>=!(),"]+')
_SIGN = re.compile(r"<=|>=|!=|<|>|=")
_IN = re.compile(r"in\s*\(", re.IGNORECASE)
_IS_NULL = re.compile(r"is\s+(not\s+)?null\Z", re.IGNORECASE)
_EXAMPLE = "accepted is, for example, period<5"


def read_where(texts: Sequence[str], vocabulary: Vocabulary) -> tuple[tuple[Condition, ...], list[Fault]]:
    """Return the conditions of all ``texts`` together, and the faults of those that cannot be read."""
    if (length := sum(map(len, texts))) > LONGEST_QUERY:
        message = f"{length} characters; at most {LONGEST_QUERY} are accepted"
        return (), [Fault("?where", "too_long", message)]
    parts = [part for text in texts for part in split(Excerpt(text, 0))]
    if len(parts) > MOST_CONDITIONS:
        message = f"{len(parts)} conditions; at most {MOST_CONDITIONS} are accepted"
        return (), [Fault("?where", "too_many_conditions", message)]
    conditions, faults = list[Condition](), list[Fault]()
    for part in parts:
        try:
            conditions.append(_condition(part, vocabulary))
        except QueryError as error:
            faults.append(error.fault)
    return tuple(conditions), faults


def _condition(part: Excerpt, vocabulary: Vocabulary) -> Condition:
    found = _SUBJECT.match(part.text)
    if found is None:
        raise _not_a_condition(part)
    subject = vocabulary.subject("where", _name(part, found[0]), part)
    rest = part.after(found.end())
    if sign := _SIGN.match(rest.text):
        operator = _SIGNS[sign[0]]
        _check_order(subject, operator, vocabulary, rest)
        value = rest.after(sign.end())
        if not value.text.startswith(QUOTE) and re.search(r"[<>=!()]", value.text):
            raise _not_a_condition(part)
        return Condition(subject, operator, (_value(subject, vocabulary, value),))
    if null := _IS_NULL.match(rest.text):
        return Condition(subject, "is not null" if null[1] else "is null")
    if (opened := _IN.match(rest.text)) and rest.text.endswith(")"):
        inside = Excerpt(rest.text[opened.end() : -1], rest.start + opened.end())
        return Condition(subject, "in", tuple(_values(subject, vocabulary, inside)))
    accepted = "accepted are = != < <= > >= in (...), is null and is not null"
    raise QueryError(
        "where", "invalid_condition", f"an operator is missing; {accepted}, as in period<5", rest.start
    )


def _name(part: Excerpt, found: str) -> str:
    return unquoted(Excerpt(found, part.start))[0]


def _check_order(subject: Subject, operator: Operator, vocabulary: Vocabulary, rest: Excerpt) -> None:
    if operator in ("=", "!=") or subject.kind.has_order:
        return
    name = "outcomes have" if subject.text == "outcome" else f"{subject.text} has"
    message = (
        f"{name} no order; accepted are =, !=, in (...) and is null, as in {_example(subject, vocabulary)}"
    )
    raise QueryError("where", "invalid_condition", message, rest.start)


def _example(subject: Subject, vocabulary: Vocabulary) -> str:
    fact = vocabulary.facts.get(subject.name) if subject.place == "fact" else None
    if fact is not None and fact.words:
        return f"{subject.text}={fact.words[0]}"
    value = {"outcome": "solved", "reused": "true"}.get(subject.text, "value")
    return f"{subject.text}={value}"


def _values(subject: Subject, vocabulary: Vocabulary, inside: Excerpt) -> Iterator[float | str | bool]:
    parts = list(split(inside))
    if len(parts) > MOST_VALUES:
        message = f"{len(parts)} values; at most {MOST_VALUES} are accepted"
        raise QueryError("where", "too_many_values", message, inside.start)
    for part in parts:
        yield _value(subject, vocabulary, part)


def _value(subject: Subject, vocabulary: Vocabulary, part: Excerpt) -> float | str | bool:
    fact = vocabulary.facts.get(subject.name) if subject.place == "fact" else None
    return read_value(subject, fact, part)


def _not_a_condition(part: Excerpt) -> QueryError:
    message = f"{part.text[:60]!r} is not a condition; {_EXAMPLE}"
    return QueryError("where", "invalid_condition", message, part.start)


MOST_KEYS = 4
MOST_COLUMNS = 64


def read_order(text: str, vocabulary: Vocabulary) -> tuple[tuple[OrderKey, ...], list[Fault]]:
    """Return the columns to sort by, and the faults."""
    parts = list(split(Excerpt(text, 0)))
    if len(parts) > MOST_KEYS:
        message = f"{len(parts)} columns; at most {MOST_KEYS} are accepted"
        return (), [Fault("?order", "too_many_columns", message)]
    keys, faults = list[OrderKey](), list[Fault]()
    for part in parts:
        is_descending = part.text.startswith("-")
        try:
            subject = vocabulary.subject("order", part.text.removeprefix("-"), part)
            if subject.kind is Kind.TRUTH:
                message = f"{subject.text} has no order; {vocabulary.accepted()}"
                raise QueryError("order", "invalid_value", message, part.start)
            keys.append(OrderKey(subject, is_descending))
        except QueryError as error:
            faults.append(error.fault)
    faults += _repeated("order", [key.subject for key in keys])
    return tuple(keys), faults


def read_columns(text: str, vocabulary: Vocabulary) -> tuple[tuple[Subject, ...], list[Fault]]:
    """Return what each item of the answer shall hold, and the faults."""
    parts = list(split(Excerpt(text, 0)))
    if len(parts) > MOST_COLUMNS:
        message = f"{len(parts)} columns; at most {MOST_COLUMNS} are accepted"
        return (), [Fault("?columns", "too_many_columns", message)]
    return read_names("columns", parts, vocabulary)


def read_names(
    parameter: str, parts: Iterable[Excerpt], vocabulary: Vocabulary
) -> tuple[tuple[Subject, ...], list[Fault]]:
    """Return what the names of a parameter stand for, and the faults."""
    subjects, faults = list[Subject](), list[Fault]()
    for part in parts:
        try:
            subjects.append(vocabulary.subject(parameter, part.text, part))
        except QueryError as error:
            faults.append(error.fault)
    return tuple(subjects), [*faults, *_repeated(parameter, subjects)]


def _repeated(parameter: str, subjects: list[Subject]) -> list[Fault]:
    if len(set(subjects)) == len(subjects):
        return []
    return [Fault(f"?{parameter}", "invalid_value", "a column is given twice; once is accepted")]
