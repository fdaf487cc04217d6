"""Chooses the one index in which the rows of a query are found; its other conditions test these rows.

A database that reads an index in the order of a page, and finds hardly any row that meets the conditions,
reads all of it; one that finds what meets a condition, and sorts it, may sort nearly all rows. SQLite has
no statistics to know that before, and Postgres none of labels and of numbers without a column. So the rows
that meet a condition are counted first in its index, up to a bound.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from sqlalchemy import ColumnElement, func, select
from sqlalchemy.orm import Session

from service.schemas.query.conditions import Condition, OrderKey, Subject
from service.storage.database.database import is_postgres
from service.storage.searching.conditions import conditions_of, found_in_index, untouched
from service.storage.searching.sources import Source

MANY = 10_000
"""Entries of an index that are read in some milliseconds."""
MOST = 10_000_000
"""Entries that are read, in a second or two, before an index is without a bound."""
ROW = 40
"""Entries that are read in the time in which a row is looked up; more if the system has forgotten it."""

_IN_AN_INDEX = ("=", "<", "<=", ">", ">=", "in", "is not null")
_IN_LABELS = ("id", "created_at")
"""Columns that the index of labels has, too."""


@dataclass(frozen=True, slots=True)
class Narrowed:
    """How the rows of a query are found."""

    source: Source
    """Where they are read."""
    given: list[ColumnElement[bool]]
    """The SQL of the conditions there."""
    cost: int | None
    """How many entries of indexes can be read in that time, at most; None if it is not known."""


def met_by_few(
    session: Session, source: Source, conditions: Sequence[Condition], asked: Sequence[Subject], bound: int
) -> Narrowed | None:
    """Return how to find the rows that meet the conditions by what an index tells of one of them.

    Parameters
    ----------
    asked
        What is read of the rows, beside the conditions.
    bound
        The largest cost; None is returned if there is no such way.
    """
    about = _by_subject(source, conditions)
    counted = {subject: entries(session, source, each, bound) for subject, each in about.items()}
    counts = {subject: n for subject, n in counted.items() if n <= bound}
    best: tuple[int, Subject, Source, list[Subject]] | None = None
    for subject, count in counts.items():
        is_attached = source.attached(subject) is not None
        view = source.through(subject) if is_attached else source
        has_all = is_attached or subject.name in source.covering
        # What meets another condition is collected from its own table, if that is less than to look up rows.
        others = [
            each
            for each, n in counts.items()
            if each != subject and source.attached(each) and not view.is_covered(each) and n <= ROW * count
        ]
        settled = [condition for each in (subject, *others) for condition in about[each]]
        read = {*asked, *(each.subject for each in conditions if each not in settled)}
        is_whole = has_all and all(map(view.is_covered, read))
        looked_up = [
            n for each, n in counts.items() if each == subject or (has_all and view.is_covered(each))
        ]
        cost = count + sum(counts[each] for each in others) + (0 if is_whole else ROW * min(looked_up))
        if cost <= bound and (best is None or cost < best[0]):
            best = cost, subject, view if is_whole else source, others
    if best is None:
        return None
    cost, subject, view, others = best
    found = conditions_of(view, about[subject])
    if view is source and source.attached(subject) is not None:
        # With a limit, since Postgres knows nothing of how many these are; they may become more meanwhile.
        few = found_in_index(source, about[subject]).limit(2 * counts[subject] + MANY)
        found = [source.id.in_(few)]
    rest = tests(session, view, conditions, about[subject], [about[each] for each in others])
    return Narrowed(view, [*view.always, *found, *rest], cost)


def met(
    session: Session, source: Source, conditions: Sequence[Condition], asked: Sequence[Subject] = ()
) -> Narrowed:
    """Return how to find all rows that meet the conditions."""
    # Of columns the database has a good index, if not the best one, by itself.
    for bound in (MANY, MOST) if members(source, conditions) else (MANY,):
        found = met_by_few(session, source, conditions, asked, bound)
        if found is not None:
            return found
    return Narrowed(source, [*source.always, *conditions_of(source, conditions)], None)


def tests(
    session: Session,
    source: Source,
    conditions: Sequence[Condition],
    given: Sequence[Condition],
    others: Sequence[Sequence[Condition]],
) -> list[ColumnElement[bool]]:
    """Return the SQL that tests rows by conditions other than those that they were found by.

    For each of ``others``, which have a table of their own, what meets it is collected from there once.
    """
    is_test = not is_postgres(session.connection())
    known = [*given, *(each for about in others for each in about)]
    rest = [each for each in conditions if each not in known]
    row = untouched(source.id) if is_test else source.id
    return [
        *conditions_of(source, rest, is_test=is_test),
        *(row.in_(found_in_index(source, about)) for about in others),
    ]


def members(source: Source, conditions: Sequence[Condition]) -> list[list[Condition]]:
    """Return the conditions that rows can be tested by in another table, those on one subject together."""
    found = _by_subject(source, conditions).values()
    return [about for about in found if source.attached(about[0].subject) is not None]


def label_of_order(conditions: Sequence[Condition], keys: Sequence[OrderKey]) -> list[Condition]:
    """Return the condition on a label, if there is one, whose index has the rows in the order of the keys.

    So a page in the order of ids or instants costs the same however many have the label.
    """
    if any(key.subject.name not in _IN_LABELS for key in keys):
        return []
    return [each for each in conditions if each.subject.place == "label" and each.operator == "="][:1]


def slow_parts(
    source: Source,
    conditions: Sequence[Condition],
    keys: Sequence[OrderKey] = (),
    read: Mapping[str, Sequence[Subject]] = {},
) -> Iterator[tuple[str, str]]:
    """Yield the parts of a query that take long over many rows, each by its parameter with the reason.

    ``read`` are the subjects that all rows that match are read for, by parameter.
    """
    for condition in conditions:
        subject = condition.subject
        has_index = source.attached(subject) is not None or subject.name in source.indexed
        if not has_index or condition.operator not in _IN_AN_INDEX:
            why = "no index finds what meets" if has_index else "no index has"
            yield "?where", f"{why} {subject.text} {condition.operator}: rows are tried one by one"
    asked = {each.subject.text for each in conditions if source.has_number(each.subject)}
    read_too = [*(key.subject for key in keys), *read.get("?of", ())]
    both = asked.union(each.text for each in read_too if source.has_number(each))
    if asked and len(both) > 1:
        yield (
            "?where",
            f"no index has {' and '.join(sorted(both))} together: rows are looked up if many have each",
        )
    for key in keys[:1]:
        if not (source.has_index_of(key.subject) or key.subject.name in _IN_LABELS):
            yield "?order", f"no index has {key.subject.text}: all rows that match are sorted"
    for parameter, subjects in read.items():
        for subject in subjects:
            has_table = parameter == "?of" and source.has_number(subject)
            if not source.is_covered(subject) and not has_table:
                yield parameter, f"no index has {subject.text}: it is read from all rows that match"


def entries(session: Session, source: Source, about: Sequence[Condition], bound: int) -> int:
    """Return how many entries of an index meet conditions on one subject, at most one more than a bound."""
    found = found_in_index(source, about).limit(bound + 1).subquery()
    return session.scalar(select(func.count()).select_from(found)) or 0


def _by_subject(source: Source, conditions: Sequence[Condition]) -> dict[Subject, list[Condition]]:
    """Return the conditions that an index can find, those on the same subject together."""
    found: dict[Subject, list[Condition]] = {}
    for condition in conditions:
        subject = condition.subject
        is_indexed = source.attached(subject) is not None or subject.name in source.indexed
        if is_indexed and condition.operator in _IN_AN_INDEX:
            found.setdefault(subject, []).append(condition)
    return found
