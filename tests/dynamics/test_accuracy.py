"""The choice of a tier, by a tolerance or by a budget."""

from dataclasses import replace
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.accuracy import (
    MOTION_KINDS,
    TIER_TOLERANCES,
    TIERS,
    AccuracyTable,
    Expected,
    best_tier,
    cheapest_tier,
    expected,
    family_of,
    motion_kind,
)
from service.dynamics.errors import BudgetTooSmallError, InvalidNumberError
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.windows import find_windows
from tests.support.accuracy import row, table
from tests.support.effort import examples
from tests.support.planar import body, formula

tolerances = st.floats(-20.0, 0.0).map(lambda exponent: 10.0**exponent)
seconds = st.floats(0.0, 10.0)
rows = st.builds(
    row,
    st.sampled_from(TIERS),
    st.sampled_from(MOTION_KINDS),
    st.sampled_from(["three-term", "rational", "function", "integral"]),
    seconds=seconds,
    seconds_per_1000=seconds,
)
tables = st.lists(rows, min_size=1, max_size=12).map(lambda found: table(*found))


def test_better_tiers_promise_more():
    promised = [TIER_TOLERANCES[tier] for tier in TIERS]
    assert promised == sorted(promised, reverse=True)
    assert len(set(promised)) == len(TIERS)


@given(tolerances, tolerances)
@settings(max_examples=examples(8, 50))
def test_a_smaller_tolerance_never_takes_a_cheaper_tier(first, second):
    small, large = sorted((first, second))
    assert TIERS.index(cheapest_tier(small)) >= TIERS.index(cheapest_tier(large))


@given(tolerances)
@settings(max_examples=examples(8, 50))
def test_the_tier_keeps_the_tolerance_and_no_cheaper_one_does(tolerance):
    tier = cheapest_tier(tolerance)
    assert TIER_TOLERANCES[tier] <= tolerance or tier == TIERS[-1]
    assert all(TIER_TOLERANCES[cheaper] > tolerance for cheaper in TIERS[: TIERS.index(tier)])


@pytest.mark.parametrize("tier", TIERS)
def test_what_a_tier_promises_takes_that_tier(tier):
    assert cheapest_tier(TIER_TOLERANCES[tier]) == tier


@pytest.mark.parametrize("tolerance", [0.0, -1e-10, float("nan")])
def test_a_tolerance_that_is_not_positive_is_refused(tolerance):
    with pytest.raises(InvalidNumberError) as refused:
        cheapest_tier(tolerance)
    assert refused.value.pointer == "/accuracy/tolerance"


def slowest(found: AccuracyTable, tier, samples, kind) -> float | None:
    """What a tier takes at worst on motions of a kind, or on any if that kind is not in the table."""
    alike = [r for r in found.rows if r.kind == kind] or found.rows
    return max((r.seconds_for(samples) for r in alike if r.tier == tier), default=None)


@given(tables, seconds, st.integers(1, 5000), st.sampled_from(MOTION_KINDS))
@settings(max_examples=examples(12, 100))
def test_the_budget_is_kept_by_the_best_that_can_keep_it(found, budget, samples, kind):
    choice = best_tier(found, budget, samples, kind)
    expected = {tier: slowest(found, tier, samples, kind) for tier in TIERS}
    times = {tier: time for tier, time in expected.items() if time is not None}
    fitting = [tier for tier, time in times.items() if time <= budget]
    assert choice.seconds == times[choice.tier]
    assert choice.fits == bool(fitting)
    if fitting:
        assert choice.seconds <= budget
        assert choice.tier == fitting[-1]
    else:
        assert choice.seconds == min(times.values())


@given(tables, seconds, seconds, st.integers(1, 5000), st.sampled_from(MOTION_KINDS))
@settings(max_examples=examples(8, 50))
def test_more_time_never_buys_a_worse_tier(found, first, second, samples, kind):
    short, long = sorted((first, second))
    worse, better = (best_tier(found, budget, samples, kind) for budget in (short, long))
    assert better.fits >= worse.fits
    if worse.fits:
        assert TIERS.index(better.tier) >= TIERS.index(worse.tier)


def test_a_family_that_is_known_is_not_judged_by_slower_ones():
    found = table(
        row("draft", seconds=0.1), row("high", seconds=0.2), row("high", family="integral", seconds=9)
    )
    assert best_tier(found, 1.0, 1000, "rest to rest").tier == "draft"
    assert best_tier(found, 1.0, 1000, "rest to rest", "three-term").tier == "high"
    # Nothing was measured of this family: any of the kind may be like it.
    assert best_tier(found, 1.0, 1000, "rest to rest", "rational").tier == "draft"


def test_what_is_expected_of_a_tier_is_that_of_its_slowest_comparable_row():
    coarse = replace(row("draft", seconds=0.1), claimed_error=1e-7)
    functions = row("draft", "rest to equator", "function", seconds=2)
    found = table(coarse, row("draft", seconds=0.3), functions)
    known = expected(found, "draft", 1000, "rest to rest", "three-term")
    assert known == Expected(0.3, 1e-7)
    # What formulas with functions cost depends on these more than on the window.
    known = expected(found, "draft", 1000, "rest to rest", "function")
    assert known == Expected(2, functions.claimed_error)
    assert expected(found, "draft", 1000, "rest to rest", "rational") == Expected(0.3, 1e-7)
    assert expected(found, "certified", 1000, "aperiodic", "rational") is found.unavailable[0]
    assert expected(found, "high", 1000, "rest to rest", "three-term") is None


def test_seconds_grow_with_the_samples_beyond_the_measured_thousand():
    measured = row(seconds=0.1, seconds_per_1000=0.01)
    assert measured.seconds_for(1000) == 0.1
    assert measured.seconds_for(11_000) == pytest.approx(0.2)  # a few roundings
    # Fewer samples are not had for nothing: the line through both measurements would be below 0 here.
    assert row(seconds=0.1, seconds_per_1000=0.5).seconds_for(1) == 0.1


def test_a_budget_that_nothing_fits_is_refused_with_what_is_expected():
    found = table(row("draft", seconds=0.00641), row("standard", seconds=0.02))
    assert best_tier(found, 0.007, 1000, "rest to rest").require_fit(0.007).tier == "draft"
    with pytest.raises(BudgetTooSmallError) as refused:
        best_tier(found, 0.001, 1000, "rest to rest").require_fit(0.001)
    assert refused.value.pointer == "/accuracy/budget_seconds"
    # Rounded up, so that what is said to be accepted is.
    assert "draft, is expected to take 0.0065 s" in refused.value.message
    assert best_tier(found, 0.0065, 1000, "rest to rest").fits


@given(st.floats(1e-6, 3600.0))
@settings(max_examples=examples(8, 50))
def test_the_budget_that_a_refusal_names_is_accepted(cost):
    found = table(row(seconds=cost, seconds_per_1000=0.0))
    with pytest.raises(BudgetTooSmallError) as refused:
        best_tier(found, cost / 2, 1000, "rest to rest").require_fit(cost / 2)
    named = float(refused.value.message.partition("budgets from ")[2].split()[0])
    assert cost <= named <= 1.1 * cost
    assert best_tier(found, named, 1000, "rest to rest").fits


@pytest.mark.parametrize(
    ("text", "moment", "family"),
    [
        ("-g1 + 1/(20*g3^2)", 2, "three-term"),
        # The same potential, written otherwise.
        ("-(g1*g3 - 1/(20*g3))/g3 + 7", 2, "three-term"),
        ("-2*g1 + 1/(20*g3^2) + 1/(200*g3^4)", 2, "rational"),
        ("-g1", 3, "general alpha"),
        ("-g1 + (2*g1^2 + g3^2)*exp(g2)", 2, "function"),
        ("-g1 + 2^g2", 3, "function"),
        # Too dear to expand just for an expectation: it is taken for the dearer family.
        ("((g1+g2+g3)^30 - (g1+g2+g3)^30) - g1", 2, "rational"),
    ],
)
def test_the_family_is_read_off_the_exact_potential(text, moment, family):
    found = body(moment, 1)
    assert family_of(found, formula(text, found)) == family


def test_a_table_without_rows_is_none():
    with pytest.raises(ValueError, match="at least one row"):
        AccuracyTable("measured", "", "1", 1, table().machine, 1, (), ())


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("-g1", "pole to equator"),
        ("-g1 + 1/(20*g3^2)", "rest to equator"),
        ("-g1 + 2*(g1^2 - g2^2)", "pole to rest"),
        ("-g1 + 1/(50*g3^2) + 6/5*(g1^2 - g2^2)", "rest to rest"),
        ("-(g1^2 - g2^2)", "aperiodic"),
    ],
)
def test_the_kind_of_a_motion_is_read_off_its_window(text, kind):
    double = body(2, 1)
    (window,) = find_windows(double, formula(text, double), PlanarMotion(None, Fraction(1)))
    assert motion_kind(window.kind, window.ends) == kind
