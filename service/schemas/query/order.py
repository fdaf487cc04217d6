"""Reads ``order=-energy,id`` and ``columns=id,period``."""

from collections.abc import Iterable

from service.schemas.query.conditions import OrderKey, Subject
from service.schemas.query.kinds import Kind
from service.schemas.query.splitting import Excerpt, QueryError, split
from service.schemas.query.subjects import Vocabulary
from service.schemas.reading.faults import Fault

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
