"""Chooses the tier that fits a time budget."""

from service.dynamics.accuracy import (
    TIERS,
    AccuracyTable,
    Expected,
    MotionKind,
    Tier,
    TierChoice,
    Unavailable,
    best_tier,
    expected,
    family_of,
    motion_kind,
)
from service.dynamics.problem import Problem, StateMotion, TimeList
from service.schemas.reading.documents import Part


def window_of(verdict: Part | None) -> Part | None:
    """Return the window of the single motion in the verdict on a problem, None without a verdict."""
    motions = None if verdict is None else verdict["motions"]
    return motions[0] if isinstance(motions, list) else None


def choose_tier(problem: Problem, window: Part | None, table: AccuracyTable) -> TierChoice:
    """Return the best tier that is expected to keep the budget of ``problem``.

    ``window`` is that of its motion as a verdict lists it; None for a motion
    from any state. A tier that failed on motions of this kind is not chosen.

    Raises
    ------
    BudgetTooSmallError
        Not even the cheapest tier is expected to keep it.
    """
    budget = problem.accuracy.budget_seconds
    if budget is None:
        raise ValueError("the problem has no budget")
    kind, family = kind_of(problem, window), family_of(problem.body, problem.potential)
    return best_tier(table, budget, samples_of(problem), kind, family).require_fit(budget)


def expected_of_tiers(
    problem: Problem, window: Part | None, table: AccuracyTable
) -> dict[Tier, Expected | Unavailable | None]:
    """Return what is expected of ``problem`` at each tier, by the table alone."""
    kind, family = kind_of(problem, window), family_of(problem.body, problem.potential)
    return {tier: expected(table, tier, samples_of(problem), kind, family) for tier in TIERS}


def with_tier(document: Part, choice: TierChoice) -> Part:
    """Return a problem document with the tier in place of its budget."""
    return {**document, "accuracy": {"tier": choice.tier}}


def samples_of(problem: Problem) -> int:
    """Return how many samples a problem asks for."""
    return len(problem.time.times) if isinstance(problem.time, TimeList) else problem.time.samples


def kind_of(problem: Problem, window: Part | None) -> MotionKind:
    """Return the kind of a problem's motion, of a planar one by its window."""
    is_integrated = isinstance(problem.motion, StateMotion) or problem.method == "integration"
    return "any state" if is_integrated else _kind(window)


def _kind(window: Part | None) -> MotionKind:
    if window is None:
        return "any state"
    return motion_kind(window["kind"], window["ends"])
