"""Conditions are read, or refused with every fault at once, its place, and what would have been accepted."""

import re
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.schemas.query.reading import (
    LONGEST_QUERY,
    MOST_CONDITIONS,
    MOST_VALUES,
    read_columns,
    read_order,
    read_where,
)
from service.schemas.query.terms import (
    LONGEST_LIST,
    MOST_NUMBERS,
    OF_JOBS,
    OF_SOLUTIONS,
    OF_SWEEPS,
    Condition,
    Excerpt,
    Kind,
    Subject,
    Vocabulary,
    facts_of,
    split,
    stored_name,
)

ALL = Vocabulary({**OF_SWEEPS, **OF_JOBS, **OF_SOLUTIONS}, has_pointers=True, has_labels=True)


def read(*texts):
    conditions, faults = read_where(texts, ALL)
    assert faults == []
    return [(each.subject.text, each.operator, *each.values) for each in conditions]


def faults(*texts):
    return read_where(texts, ALL)[1]


def test_every_operator_is_read():
    assert read("period<5,period<=5,period>5 , period >= 5", "energy=-1e-3,energy!=17/10") == [
        ("period", "<", 5.0),
        ("period", "<=", 5.0),
        ("period", ">", 5.0),
        ("period", ">=", 5.0),
        ("energy", "=", -1e-3),
        ("energy", "!=", 1.7),
    ]
    assert read("tier in (draft, high),trace is null,trace IS NOT NULL,attempt in(1,2)") == [
        ("tier", "in", "draft", "high"),
        ("trace", "is null"),
        ("trace", "is not null"),
        ("attempt", "in", 1.0, 2.0),
    ]


def test_the_example_of_the_contract_is_read():
    text = (
        "period<5,/motion/lambda>=1,family=rational,label.project=thesis,tier in (draft,high),"
        "stability.verdict!=stable,created_at>=2026-01-01"
    )
    assert read(text) == [
        ("period", "<", 5.0),
        ("/motion/lambda", ">=", 1.0),
        ("family", "=", "rational"),
        ("label.project", "=", "thesis"),
        ("tier", "in", "draft", "high"),
        ("stability.verdict", "!=", "stable"),
        ("created_at", ">=", datetime(2026, 1, 1, tzinfo=UTC).timestamp()),
    ]


def test_texts_may_be_quoted_and_instants_have_offsets():
    assert read('label.a="b, (c) ""d""",label.a in ("x,y", z),"/a b"=1,label.b=two words') == [
        ("label.a", "=", 'b, (c) "d"'),
        ("label.a", "in", "x,y", "z"),
        ("/a b", "=", 1.0),
        ("label.b", "=", "two words"),
    ]
    eight = datetime(2026, 1, 2, 8, tzinfo=UTC).timestamp()
    for text in ("2026-01-02T08:00:00Z", "2026-01-02T10:00:00+02:00", "2026-01-02t08:00z"):
        assert read(f"created_at={text}") == [("created_at", "=", eight)]
    assert read("reused=true") == [("reused", "=", True)]


@pytest.mark.parametrize(
    ("text", "position", "code", "accepted"),
    [
        ("", 0, "invalid_condition", "period<5"),
        ("perid<5", 0, "unknown_column", "period, energy"),
        ("period<5,perid<5", 9, "unknown_column", "label.KEY"),
        ("period", 6, "invalid_condition", "is null"),
        ("period<", 7, "invalid_value", "a number such as"),
        ("period<<5", 0, "invalid_condition", "period<5"),
        ("period=(5)", 0, "invalid_condition", "period<5"),
        ("period<nan", 7, "invalid_number", "number"),
        ("period<1e350", 7, "invalid_number", "1e-300 to 1e300"),
        ("period in ()", 11, "invalid_value", "a number such as"),
        ("period in (1,x)", 13, "invalid_number", "number"),
        ("period in (1", 7, "invalid_condition", "in (...)"),
        ("tier=best", 5, "invalid_value", "draft, standard, high, certified"),
        ("tier<draft", 4, "invalid_condition", "tier=draft"),
        ("label.a>b", 7, "invalid_condition", "label.a=value"),
        ("label.-=b", 0, "invalid_label", "letters, digits"),
        ('label.a="b', 8, "invalid_condition", "doubled"),
        ("created_at>yesterday", 11, "invalid_value", "2026-01-31"),
        ("created_at>2026-02-30", 11, "invalid_value", "2026-01-31"),
        ("id=7", 3, "invalid_value", "UUID"),
        ("reused=yes", 7, "invalid_value", "true and false"),
        (f"/{'a' * 200}=1", 0, "invalid_pointer", "/motion/lambda"),
        (f"label.a={'a' * 300}", 8, "too_long", "256"),
    ],
)
def test_a_fault_tells_its_place_and_what_is_accepted(text, position, code, accepted):
    (fault,) = faults(text)
    assert (fault.pointer, fault.position, fault.code) == ("?where", position, code)
    assert fault.message.startswith(f"at character {position + 1}: ")
    assert accepted in fault.message


def test_all_faults_are_told_at_once():
    assert [fault.position for fault in faults("a=1,period<5,b=2,tier=x")] == [0, 13, 22]


def test_sizes_are_limited():
    assert [fault.code for fault in faults("period<5," * 2000)] == ["too_long"]
    assert len("period<5," * 2000) > LONGEST_QUERY
    assert [fault.code for fault in faults(*["period<5"] * (MOST_CONDITIONS + 1))] == ["too_many_conditions"]
    values = ",".join("1" for _ in range(MOST_VALUES + 1))
    assert [fault.code for fault in faults(f"period in ({values})")] == ["too_many_values"]


@given(st.text(max_size=60))
def test_any_text_is_read_or_refused(text):
    conditions, found = read_where([text], ALL)
    assert conditions or found
    for fault in found:
        assert fault.position is None or 0 <= fault.position <= len(text)


plain = st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=20)


@given(st.lists(st.tuples(st.from_regex(r"[A-Za-z0-9]{1,9}", fullmatch=True), plain), min_size=1, max_size=5))
def test_what_is_quoted_is_read_as_it_is(labels):
    text = ",".join('label.{}="{}"'.format(key, value.replace('"', '""')) for key, value in labels)
    conditions, found = read_where([text], ALL)
    assert found == []
    assert conditions == tuple(
        Condition(Subject("label", key, Kind.TEXT), "=", (value,)) for key, value in labels
    )


@given(st.text('ab,()"', max_size=30))
def test_parts_between_commas_are_the_whole(text):
    parts = list(split(Excerpt(text, 0)))
    assert all(text[part.start :].startswith(part.text) for part in parts)
    assert ",".join(part.text for part in parts) == text


def test_orders_and_columns_are_read():
    keys, found = read_order("-energy,/motion/lambda,id", ALL)
    assert found == []
    assert [(key.subject.text, key.descending) for key in keys] == [
        ("energy", True), ("/motion/lambda", False), ("id", False),
    ]  # fmt: skip
    columns, found = read_columns("id,period,label.project", ALL)
    assert [column.text for column in columns] == ["id", "period", "label.project"]
    assert found == []


@pytest.mark.parametrize(
    "text", ["perid", "energy,energy", "reused", "a,b", "id,period,energy,error,trace", ""]
)
def test_faults_of_an_order_are_told(text):
    _, found = read_order(text, ALL)
    assert found
    assert {fault.pointer for fault in found} == {"?order"}


def test_numbers_of_a_problem_are_the_doubles_of_their_exact_values():
    problem = {
        "body": {"A": "17/10", "B": None, "C": 1, "allow_unphysical": True},
        "potential": {"type": "rational", "a": ["-1/3", 2e-3], "expression": "g1", "x~/y": "0.1"},
        "motion": {"lambda": "1e-12", "type": "planar"},
        "time": {"times": [0.5] * (LONGEST_LIST + 1)},
    }
    assert facts_of(problem) == {
        "family": "rational",
        "/body/A": 1.7,
        "/body/C": 1.0,
        "/potential/a/0": -1 / 3,
        "/potential/a/1": 0.002,
        "/potential/x~0~1y": 0.1,
        "/motion/lambda": 1e-12,
    }
    many = {"potential": {"parameters": {f"a{n}": n for n in range(1000)}}}
    assert len(facts_of(many)) == MOST_NUMBERS + 1


@given(st.text(max_size=20), st.text(max_size=20))
def test_names_are_stored_as_plain_text_and_stay_different(left, right):
    try:
        names = stored_name(left), stored_name(right)
    except UnicodeEncodeError:
        return  # half of a surrogate pair, which no pointer has
    assert (names[0] == names[1]) == (left == right)
    assert re.fullmatch(r"[A-Za-z0-9_.~/%-]*", names[0])
