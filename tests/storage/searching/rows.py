"""Random rows, queries about them, and what plain Python says they mean."""

import json
from dataclasses import replace
from fractions import Fraction
from functools import cmp_to_key
from itertools import count

from hypothesis import strategies as st
from sqlalchemy import delete, insert

from service.schemas.query.terms import OF_SOLUTIONS, Condition, Kind, ListQuery, OrderKey, Subject, facts_of
from service.schemas.reading.documents import Annotation
from service.storage.annotations import insert_labels
from service.storage.codecs.summary import summary_columns
from service.storage.database.rows import new_id
from service.storage.searching.pages import find
from service.storage.searching.sources import OF_SOLUTION_ROWS
from service.storage.tables.base import table_of
from service.storage.tables.solutions import SolutionRow

CREATED = count(1)
# Few values, so that rows tie and conditions hit; and some that differ by one digit of many, or are extreme.
DOUBLES = [None, -1.5, 0.0, -0.0, 0.1, 1.7, 0.1 + 0.2, 0.3, 2.0, 1e300, 5e-300, -123456789.123456789]
EXACT = [None, 1, 2, 1.7, "17/10", "1.7", "1/3", 0.3333333333333333, "-0", 10**30, "1e-12", True, "g1"]
ODD_NAME = 'β "/%\\'
ODD = '/potential/parameters/β "~1%\\'
POINTERS = [
    "/body/A",
    "/body/B",
    "/motion/lambda",
    "/potential/parameters/a",
    "/potential/b/0",
    "/no/where",
    ODD,
]
LABELS, VALUES = ["project", "a.b"], ["thesis", "Thesis", "Ärger", "a, 'b' \"%\\"]
WORDS = {name: [None, *fact.words] for name, fact in OF_SOLUTIONS.items() if fact.kind is Kind.WORD}

numbers = st.one_of(
    st.sampled_from(DOUBLES),
    st.floats(allow_nan=False, allow_infinity=False, min_value=-1e299, max_value=1e299),
)
exact = st.one_of(st.sampled_from(EXACT), numbers)


@st.composite
def documents(draw):
    """A problem as it is sent, and the summary of its solution."""
    problem = {
        "body": {"A": draw(exact), "B": draw(exact)},
        "motion": {"lambda": draw(exact)},
        "potential": {
            "type": draw(st.sampled_from(WORDS["family"])),
            "parameters": {"a": draw(exact), ODD_NAME: draw(exact)},
            "b": [draw(exact)],
        },
    }
    summary = {
        "method": draw(st.sampled_from(WORDS["method"])),
        "tier": draw(st.sampled_from(WORDS["tier"])),
        "period": {"value": draw(numbers)},
        "energy": {"value": draw(numbers)},
        "error": draw(numbers),
        "invariants": {"energy": {"drift": draw(numbers)}, "areas": {"drift": draw(numbers)}},
        "stability": {"trace": draw(numbers), "verdict": draw(st.sampled_from(WORDS["stability.verdict"]))},
        "aperiodic": draw(st.sampled_from(WORDS["aperiodic"])),
        "cost": {"compute_seconds": draw(numbers)},
    }
    return problem, summary, draw(st.dictionaries(st.sampled_from(LABELS), st.sampled_from(VALUES)))


rows = st.lists(documents(), max_size=10)


def store(database, found):
    """Store solutions with these documents instead of all others; return them with their ids."""
    with database.write() as session:
        session.execute(delete(SolutionRow))
    return add(database, found)


def add(database, found):
    """Store further solutions with these documents."""
    made = [row_of(*each[:2]) for each in found]
    if made:
        with database.write() as session:
            session.execute(insert(table_of(SolutionRow)), made)
            labels = [Annotation(dict(*each[2:])) for each in found]
            places = [(row["id"], row["created_at"]) for row in made]
            given = [(*place, annotation) for place, annotation in zip(places, labels, strict=True)]
            insert_labels(session, SolutionRow, given)
    return [row | {"labels": dict(*each[2:])} for row, each in zip(made, found, strict=True)]


def row_of(problem, summary):
    return {
        "id": new_id(), "job_id": new_id(), "digest": "d", "created_at": float(next(CREATED) // 2),
        "problem": problem, "summary": summary, **summary_columns(problem, summary),
        "facts": facts_of(problem),
    }  # fmt: skip


def subject_of(name):
    if name.startswith("/"):
        return Subject("pointer", name, Kind.NUMBER)
    if name.startswith("label."):
        return Subject("label", name.removeprefix("label."), Kind.TEXT)
    return Subject("fact", name, OF_SOLUTIONS[name].kind)


NUMBERS = ["period", "energy", "error", "drift", "trace", "A", "B", "seconds"]
NAMES = [f"label.{key}" for key in LABELS]
subjects = st.sampled_from([*NUMBERS, *WORDS, *POINTERS, *NAMES, "created_at"]).map(subject_of)


@st.composite
def conditions(draw):
    subject = draw(subjects)
    if draw(st.integers(0, 5)) == 0:
        return Condition(subject, draw(st.sampled_from(["is null", "is not null"])))
    if subject.kind in (Kind.WORD, Kind.TEXT):
        words = VALUES if subject.place == "label" else WORDS[subject.name][1:]
        value, operators = st.sampled_from(words), ["=", "!=", "in"]
    else:
        value = st.one_of(st.sampled_from([x for x in DOUBLES if x is not None]), numbers.filter(bool))
        operators = ["=", "!=", "<", "<=", ">", ">=", "in"]
    operator = draw(st.sampled_from(operators))
    size = st.lists(value, min_size=1, max_size=3) if operator == "in" else st.tuples(value)
    return Condition(subject, operator, tuple(draw(size)))


orders = st.lists(st.builds(OrderKey, subjects, st.booleans()), min_size=1, max_size=3).map(tuple)
queries = st.builds(
    ListQuery,
    st.lists(conditions(), max_size=2).map(tuple),
    orders,
    limit=st.integers(1, 5),
    offset=st.integers(0, 9),
)


def double(value):
    """Return the nearest double of a number in a document, read as Python reads fractions."""
    if value is None or isinstance(value, bool):
        return None
    try:
        return float(Fraction(value) if isinstance(value, str) else Fraction(json.dumps(value)))
    except ValueError:
        return None


def at(document, *path):
    for part in path:
        if isinstance(document, list):
            document = document[int(part)] if int(part) < len(document) else None
        else:
            document = (document or {}).get(part.replace("~1", "/"))
    return document


def value_of(row, subject):
    """Return what the documents of a row say, without the columns that were made of them."""
    problem, summary = row["problem"], row["summary"]
    if subject.place == "label":
        return row["labels"].get(subject.name)
    if subject.place == "pointer":
        return double(at(problem, *subject.name[1:].split("/")))
    match subject.name:
        case "created_at" | "id":
            return row[subject.name]
        case "family":
            return at(problem, "potential", "type")
        case "A" | "B":
            return double(at(problem, "body", subject.name))
        case "period" | "energy":
            return double(at(summary, subject.name, "value"))
        case "drift":
            drifts = [each["drift"] for each in summary["invariants"].values() if each["drift"] is not None]
            return max(drifts) if drifts else None
        case "trace":
            return at(summary, "stability", "trace")
        case "stability.verdict":
            return at(summary, "stability", "verdict")
        case "seconds":
            return at(summary, "cost", "compute_seconds")
    return at(summary, subject.name)


def meets(row, condition):
    value = value_of(row, condition.subject)
    match condition.operator:
        case "is null":
            return value is None
        case "is not null":
            return value is not None
    if value is None:
        return False
    first = condition.values[0]
    match condition.operator:
        case "=":
            return value == first
        case "!=":
            return value != first
        case "<":
            return value < first
        case "<=":
            return value <= first
        case ">":
            return value > first
        case ">=":
            return value >= first
    return value in condition.values


def compare(keys, left, right):
    """Compare two rows as documented: column by column, without a value last either way."""
    for key in keys:
        mine, theirs = value_of(left, key.subject), value_of(right, key.subject)
        if mine == theirs:
            continue
        if mine is None or theirs is None:
            return 1 if mine is None else -1
        return (1 if mine > theirs else -1) * (-1 if key.descending else 1)
    return 0


def expected(made, query):
    """Return the ids of all rows that match, in the order that is asked for."""
    matching = [row for row in made if all(meets(row, each) for each in query.conditions)]
    matching.sort(key=cmp_to_key(lambda left, right: compare(query.keys, left, right)))
    return [row["id"] for row in matching]


def ask(database, query):
    """Return a page of solutions."""
    with database.read() as session:
        return find(session, OF_SOLUTION_ROWS, query)


def ids_by_cursor(database, query, total):
    """Return the ids of all pages, one after the other; each but the last is full, and all tell the total."""
    seen, after = [], None
    while len(seen) <= total:
        page = ask(database, replace(query, after=after))
        assert page.total == total
        seen += page.ids
        after = page.next
        if after is None:
            break
        assert len(page.ids) == query.limit
    return seen
