"""No tier claims less than its error: random problems against certified motions, or series of many digits."""

import pytest

from tests.benchmarks.honesty_counts import SUBJECTS, TIERS, Record, measured
from tests.support.effort import examples, seldom

COUNT = {
    "smooth": examples(15, 60),
    "states": examples(15, 60),
    "motions": examples(9, 54),
    "passages": examples(6, 60),
}
SEED = 20
"""Seed of problems that python -m tests.benchmarks.honesty, with its own seed, does not ask."""

pytestmark = pytest.mark.random_law


@pytest.fixture(scope="module", params=["smooth", "states", "motions", *seldom("passages")])
def record(request) -> Record:
    return measured(request.param, SEED, 0, COUNT[request.param])


@pytest.mark.parametrize("tier", TIERS)
def test_no_claim_is_exceeded(record, tier):
    tallies = [record.tallies[f"{tier} {family}"] for family in SUBJECTS[record.subject]]
    assert not record.documents, "\n\n".join(record.documents)
    assert not any(tally.exceeded for tally in tallies)
    # The tier high may refuse what doubles cannot hold, and every tier what errors grow too far in; enough is
    # left to say something about.
    least = {"smooth": 0.5 if tier == "high" else 0.9, "states": 0.05 if tier == "high" else 0.4}
    least |= {"passages": least["smooth"], "motions": least["states"]}
    count = COUNT[record.subject]
    assert sum(tally.solved for tally in tallies) >= least[record.subject] * count
    if record.subject == "smooth":
        asked = ("samples", "stored", "period", "energy")
        assert all(sum(tally.ratios[claim].total() for tally in tallies) > count // 3 for claim in asked)
    if record.subject == "motions":
        asked = ("samples", "stored", "attitude", "trace", "multipliers")
        assert all(sum(tally.ratios[claim].total() for tally in tallies) > 0 for claim in asked)


@pytest.mark.parametrize("tier", TIERS)
def test_claims_are_of_use(record, tier):
    """A bound a million times too wide would be true and say nothing: half of them are within 1e4."""
    powers = [
        int(power)
        for family in SUBJECTS[record.subject]
        for power, number in record.tallies[f"{tier} {family}"].ratios["samples"].items()
        for _ in range(number)
    ]
    assert sorted(powers)[len(powers) // 2] < 4
