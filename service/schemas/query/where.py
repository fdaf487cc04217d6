"""Reads ``where=period<5,/motion/lambda>=1,tier in (draft,high),label.project=thesis``.

::

    where      = condition *("," condition)
    condition  = subject operator value / subject "in" "(" value *("," value) ")"
               / subject "is null" / subject "is not null"
    subject    = fact / JSON pointer / "label." key      ; may stand in quotation marks
    operator   = "=" / "!=" / "<" / "<=" / ">" / ">="

Nothing is evaluated: a text becomes :class:`~service.schemas.query.conditions.Condition`, or faults.
"""

import re
from collections.abc import Iterator, Sequence

from service.schemas.query.conditions import Condition, Operator, Subject
from service.schemas.query.splitting import QUOTE, Excerpt, QueryError, split, unquoted
from service.schemas.query.subjects import Vocabulary
from service.schemas.query.values import read_value
from service.schemas.reading.faults import Fault

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
