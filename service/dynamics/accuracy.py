"""The tiers: promised errors, measured cost on a machine, and the choice of a tier by tolerance or budget.

The costs are measured for families of potentials; :func:`family_of` tells which one a potential is of.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType
from typing import Literal, Self, get_args

from service.dynamics.body import RigidBody
from service.dynamics.errors import BudgetTooSmallError, InvalidNumberError
from service.dynamics.numerics import is_within, largest
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.potentials.recognition import recognise
from service.dynamics.problem import Accuracy
from service.dynamics.problem import (
    Tier as Tier,  # defined in service.dynamics.problem; re-exported for users of tiers
)

TIERS: tuple[Tier, ...] = get_args(Tier)
"""All tiers, from the cheapest to the best."""

CERTIFIED_BITS = (64, 128, 333)
"""Precisions of proven digits; the first is the default. Radii are at most 2^(8 − bits)."""

TIER_TOLERANCES: Mapping[Tier, float] = MappingProxyType(
    {"draft": 1e-6, "standard": 1e-10, "high": 1e-13, "certified": 2.0 ** (8 - CERTIFIED_BITS[0])}
)
"""Largest error of any of the six variables, relative to the size of its group where that is above 1."""

SMALLEST_TOLERANCE, LARGEST_TOLERANCE = Fraction(1, 10**15), Fraction(1, 100)
"""Tolerances that can be asked for."""


@dataclass(frozen=True, slots=True)
class GroupError:
    """The error of a group of variables that have one size: ω, γ, the quaternion, or one angle."""

    absolute: float
    """Bound of the error of any of them at the asked times."""
    size: float
    """Largest absolute value of any of them there."""

    @property
    def relative(self) -> float:
        """The error relative to the size: that of numbers which are 0 is 0 or infinite."""
        if self.absolute == 0.0:
            return 0.0
        return self.absolute / self.size if self.size != 0.0 else math.inf


def keeps(accuracy: Accuracy, groups: Iterable[GroupError]) -> bool:
    """Tell whether errors are what was asked for: the one comparison of claims with promises by groups."""
    for group in groups:
        size = group.size
        # A size that is not a number is not below 1.
        if accuracy.measure == "absolute" or (accuracy.measure == "above 1" and size <= 1.0):
            size = 1.0
        if not is_within(group.absolute, accuracy.tolerance * size):
            return False
    return True


MotionKind = Literal[
    "pole to equator", "rest to equator", "pole to rest", "rest to rest", "aperiodic", "any state"
]
"""The kinds of motions; a periodic planar one is named by its ends, where |g1| is smallest and largest."""
MOTION_KINDS: tuple[MotionKind, ...] = get_args(MotionKind)

Family = Literal["three-term", "rational", "general alpha", "function", "integral"]
"""a1 g1 + b1/g3² + c1 (g1² − g2²) with A = 2C; rational with A = 2C; any A/C; a formula with exp, sin, ...;
an integral."""

PERIODIC: tuple[MotionKind, ...] = MOTION_KINDS[:4]
BY_FORMULA: tuple[Family, ...] = ("function", "integral")
"""Families whose formulas cost more than what the window is like."""

Source = Literal["shipped", "measured"]
Reference = Literal["certified", "integration"]


@dataclass(frozen=True, slots=True)
class Machine:
    """The machine on which the seconds were measured."""

    cpus: int
    model: str | None
    system: str


@dataclass(frozen=True, slots=True)
class AccuracyRow:
    """Measured error and time of a tier on one problem."""

    tier: Tier
    kind: MotionKind
    family: Family
    claimed_error: float
    """The error that the solution claims."""
    error: float
    """Largest departure from the reference in any of the six variables."""
    reference: Reference
    reference_error: float
    """Bound of the reference's own error."""
    seconds: float
    """Seconds of a whole job with 1000 samples of the six variables, from submission to stored solution.

    Median, when a problem of the same structure has been solved before.
    """
    seconds_per_1000: float
    """For each 1000 samples more."""

    def seconds_for(self, samples: int) -> float:
        """Return the expected seconds for ``samples`` samples; fewer than 1000 count as 1000.

        The first samples cost more than the further ones: extrapolating the line
        through both measurements would make a few samples free.
        """
        return self.seconds + max(0.0, samples / 1000 - 1.0) * self.seconds_per_1000


@dataclass(frozen=True, slots=True)
class Unavailable:
    """A tier that did not solve one of the problems, and why."""

    tier: Tier
    kind: MotionKind
    family: Family
    code: str
    detail: str


@dataclass(frozen=True, slots=True)
class AccuracyTable:
    """Measured errors and times of the tiers on one installation; has at least one row."""

    source: Source
    date: str
    """RFC 3339, UTC."""
    version: str
    numerics: int
    machine: Machine
    repetitions: int
    """Number of measurements behind each time, which is their median."""
    rows: tuple[AccuracyRow, ...]
    unavailable: tuple[Unavailable, ...]

    def __post_init__(self) -> None:
        if not self.rows:
            raise ValueError("a table needs at least one row")


@dataclass(frozen=True, slots=True)
class TierChoice:
    """A tier for a budget."""

    tier: Tier
    seconds: float
    """Expected seconds."""
    fits: bool
    """Whether this is within the budget. If not, no tier is, and this is the cheapest."""

    def require_fit(self, budget_seconds: float) -> Self:
        """Return the choice itself; raise :class:`BudgetTooSmallError` if it does not fit."""
        if self.fits:
            return self
        least = _rounded_up(self.seconds)
        raise BudgetTooSmallError(
            f"a budget of {budget_seconds:.6g} s; the cheapest tier, {self.tier}, is expected to take"
            f" {least} s by the accuracy table; accepted: budgets from {least} s on, a tier, or a tolerance",
            pointer="/accuracy/budget_seconds",
        )


def cheapest_tier(tolerance: float) -> Tier:
    """Return the cheapest tier that keeps ``tolerance``; below all of them the certified one.

    Raises
    ------
    InvalidNumberError
        The tolerance is not positive.
    """
    if not tolerance > 0.0:
        raise InvalidNumberError(
            f"a tolerance of {tolerance:.6g}; it must be positive", pointer="/accuracy/tolerance"
        )
    return next((tier for tier in TIERS if TIER_TOLERANCES[tier] <= tolerance), TIERS[-1])


def best_tier(
    table: AccuracyTable,
    budget_seconds: float,
    samples: int,
    kind: MotionKind,
    family: Family | None = None,
) -> TierChoice:
    """Return the most accurate tier that is expected to end within the budget, else the cheapest.

    The time of a tier is that of its slowest comparable row: of this kind and
    family; if there is none, of this kind; else any. Without a ``family`` every
    row of the kind is comparable.
    """
    rows = _alike(table, kind, family)
    seconds = {
        tier: max(row.seconds_for(samples) for row in rows if row.tier == tier)
        for tier in TIERS
        if any(row.tier == tier for row in rows)
    }
    fitting = [tier for tier in seconds if seconds[tier] <= budget_seconds]
    if fitting:
        return TierChoice(fitting[-1], seconds[fitting[-1]], fits=True)
    cheapest = min(seconds, key=seconds.__getitem__)
    return TierChoice(cheapest, seconds[cheapest], fits=False)


@dataclass(frozen=True, slots=True)
class Expected:
    """The expected cost and error of a tier, by its slowest comparable row."""

    seconds: float
    error: float
    """The largest that a comparable solution claimed."""


def expected(
    table: AccuracyTable, tier: Tier, samples: int, kind: MotionKind, family: Family | None = None
) -> Expected | Unavailable | None:
    """Return what is expected of ``tier``, or why comparable problems failed; None if neither is known."""
    rows = [row for row in _alike(table, kind, family) if row.tier == tier]
    if rows:
        slowest = max(row.seconds_for(samples) for row in rows)
        return Expected(slowest, largest(row.claimed_error for row in rows))
    failed = [row for row in table.unavailable if (row.tier, row.kind) == (tier, kind)]
    return next((row for row in failed if row.family == family), next(iter(failed), None))


def motion_kind(kind: str, ends: Sequence[str]) -> MotionKind:
    """Return the kind of a planar motion by the kind and the ends of its window."""
    if kind != "periodic":
        return "aperiodic"
    name = " to ".join(ends)
    return next((known for known in MOTION_KINDS if known == name), "aperiodic")


def _rounded_up(seconds: float) -> str:
    """Return the number rounded up to two digits."""
    unit = 10.0 ** (math.floor(math.log10(seconds)) - 1) if seconds > 0.0 else 1.0
    return f"{math.ceil(seconds / unit) * unit:.2g}"


def _alike(table: AccuracyTable, kind: MotionKind, family: Family | None) -> tuple[AccuracyRow, ...]:
    """Return comparable rows; a formula with functions costs what such formulas cost, whatever the window."""
    of_kind = tuple(row for row in table.rows if row.kind == kind)
    of_family = tuple(row for row in of_kind if family in (None, row.family))
    functions: tuple[AccuracyRow, ...] = ()
    if family in BY_FORMULA and kind in PERIODIC:
        functions = tuple(row for row in table.rows if row.family == family and row.kind in PERIODIC)
    return of_family or functions or of_kind or table.rows


MAX_PRODUCTS_RECOGNISED = 500
"""Usual three-term formulas need some ten products; the limit protects against costly formulas."""
FUNCTIONS = frozenset({"exp", "log", "sin", "cos", "tan"})
"""Functions that are no powers: their series have no end."""


def family_of(body: RigidBody, potential: Potential) -> Family:
    """Return the family of a potential, however its formula is written."""
    try:
        instructions = potential.tape.instructions
    except NoClosedFormError:
        return "integral"
    if recognise(body, potential, most_products=MAX_PRODUCTS_RECOGNISED) is not None:
        return "three-term"
    if any(each.operation == "general_power" or each.name in FUNCTIONS for each in instructions):
        return "function"
    return "rational" if body.A == 2 * body.C else "general alpha"
