"""Counts, quartiles and histograms are on both databases those of plain Python."""

from collections import Counter

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from service.storage.searching.sources import OF_SOLUTION_ROWS
from service.storage.searching.statistics import facets, quartile_rank, statistic_of, statistics
from tests.storage.searching.rows import (
    NAMES,
    NUMBERS,
    WORDS,
    conditions,
    meets,
    rows,
    store,
    subject_of,
    value_of,
)
from tests.support.effort import examples

on_a_database = settings(
    max_examples=examples(8, 200), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
asked = st.lists(conditions(), max_size=1)
numbers = st.sampled_from([*NUMBERS, "/motion/lambda", "/potential/parameters/a"]).map(subject_of)
groups = st.sampled_from([None, *WORDS, *NAMES, "/body/A"]).map(lambda name: name and subject_of(name))


@given(rows, asked, groups.filter(bool), st.integers(1, 4))
@on_a_database
def test_facets_are_counts(database, found, where, by, limit):
    made = [row for row in store(database, found) if all(meets(row, each) for each in where)]
    with database.read() as session:
        (facet,) = facets(session, OF_SOLUTION_ROWS, where, [by], limit)
    counted = Counter(value_of(row, by) for row in made)
    assert len(facet.values) == min(limit, len(counted))
    assert all(counted[value] == count for value, count in facet.values)
    assert [count for _, count in facet.values] == sorted(counted.values(), reverse=True)[:limit]
    assert facet.others == len(made) - sum(count for _, count in facet.values)


@given(rows, asked, numbers, groups, st.integers(0, 5))
@on_a_database
def test_statistics_are_those_of_sorted_numbers(database, found, where, of, by, bins):
    made = [row for row in store(database, found) if all(meets(row, each) for each in where)]
    with database.read() as session:
        answer = list(statistics(session, OF_SOLUTION_ROWS, where, [of], by, bins=bins, groups=100))
    expected = {None: made} if by is None else {}
    for row in made if by is not None else ():
        expected.setdefault(value_of(row, by), []).append(row)
    assert {each.group: each.rows for each in answer} == {key: len(group) for key, group in expected.items()}
    for each in answer:
        known = sorted(n for row in expected[each.group] if (n := value_of(row, of)) is not None)
        assert each.count == len(known)
        if not known:
            assert (each.smallest, each.quartiles, each.largest, each.counts) == (None, None, None, ())
            continue
        assert (each.smallest, each.largest) == (known[0], known[-1])
        for quarter, quartile in enumerate(each.quartiles, 1):
            # The definition: at least so many do not exceed it, and of any smaller one fewer.
            assert sum(n <= quartile for n in known) * 4 >= len(known) * quarter
            assert sum(n < quartile for n in known) * 4 < len(known) * quarter
        assert_counts_are_those_of_the_bins(each, known, bins)
        in_memory = np.array(
            [np.nan if (n := value_of(row, of)) is None else n for row in expected[each.group]]
        )
        assert statistic_of(each.name, each.group, in_memory, bins) == each


def assert_counts_are_those_of_the_bins(found, known, bins):
    edges, counts = found.edges, found.counts
    if not bins:
        assert (edges, counts) == ((), ())
        return
    assert (edges[0], edges[-1], len(counts)) == (known[0], known[-1], len(edges) - 1)
    assert list(edges) == sorted(edges)
    last = len(counts) - 1
    for place, count in enumerate(counts):
        low, high = edges[place], edges[place + 1]
        assert count == sum(low <= n < high or (place == last and n == high) for n in known)
    assert sum(counts) == len(known)


@given(st.integers(1, 1000), st.sampled_from([1, 2, 3]))
def test_a_quartile_has_the_rank_of_its_definition(count, quarter):
    rank = quartile_rank(count, quarter)
    assert (rank + 1) * 4 >= count * quarter > rank * 4
