"""Random motions from states next to unstable rotations and equilibria, and their claims against references.

Free bodies next to their middle axis, heavy tops next to the upright one, bodies in other fields next to any
equilibrium on an axis: from gaps of 0.1 to 1e-10, over up to three passages, so that what is lost in one is
multiplied by the next. The states are exact: rational numbers with γ on the sphere.
"""

from dataclasses import dataclass
from fractions import Fraction
from math import log, log10, sqrt
from typing import Any, Literal, get_args

import numpy as np

from service.dynamics.problem import Tier
from service.schemas.problem.problem import read_problem
from tests.support import doubled_series
from tests.support.claims import UNSEEN, Claim
from tests.support.doubled_series import Term
from tests.support.random_documents import with_times
from workers.computation.compute import solve

Moments = tuple[Fraction, Fraction, Fraction]
Direction = tuple[int, int, int]
Start = tuple[list[Term], list[Fraction], tuple[Fraction, ...], float]
"""Terms of V, ω, γ, and about how fast errors grow."""
Kind = Literal["free body", "heavy top", "field"]
KINDS: tuple[Kind, ...] = get_args(Kind)
WIDEST, NARROWEST = -1.0, -10.0
"""Logarithms of the gaps."""
PASSAGES = 3.0
DECADES = 9.0
"""Decimal places, about, that errors of a first passage grow by at most in those that follow."""
LAST = 60.0
"""Latest time."""
MOMENTS = [Fraction(n, 8) for n in range(5, 25)]
DIRECTIONS = [(0, 0, 1), (0, 3, 4), (2, 3, 6), (1, 4, 8), (4, 4, 7), (2, 6, 9)]


@dataclass(frozen=True)
class StateCase:
    """A motion, and where it is at some times."""

    kind: Kind
    base: dict[str, Any]
    times: list[float]
    reference: list[list[Fraction]]
    """Multiples of 2^-BITS."""

    @property
    def about(self) -> str:
        """What is said of it in a list."""
        return "backwards" if self.times[-1] < 0.0 else "forwards"

    def document(self, tier: Tier) -> dict[str, Any]:
        """Return the whole document that asks a tier for it."""
        return with_times(self.base, [repr(t) for t in self.times], tier)


def draw_state(kind: Kind, draws: np.random.Generator) -> StateCase:
    """Draw a motion and times, and find where it is."""
    moments = random_moments(draws)
    gap = 10.0 ** draws.uniform(NARROWEST, WIDEST)
    if kind == "free body":
        terms, omega, gamma, rate = _free(moments, gap, draws)
    else:
        terms, omega, gamma, rate = _in_field(kind, moments, gap, draws)
    # The first passage ends after log(1/gap) / rate; from then on errors grow by 1/gap in as much time.
    most = 1.0 + min(2.0 * PASSAGES, DECADES / log10(1.0 / gap))
    last = min(LAST, float(draws.uniform(0.3, most)) * log(1.0 / gap) / rate)
    sign = 1.0 if draws.random() < 0.8 else -1.0
    times = [sign * float(each) for each in sorted([last, *draws.uniform(0.0, last, 3)])]
    motion = doubled_series.Motion(moments, tuple(terms))
    reference = motion.at((*omega, *gamma), [Fraction(repr(t)) for t in times])
    A, B, C = map(str, moments)
    document = {
        "body": {"A": A, "B": B, "C": C, "allow_unphysical": True},
        "potential": {"type": "expression", "expression": written(terms)},
        "motion": {"type": "state", "omega": [*map(str, omega)], "gamma": [*map(str, gamma)]},
    }
    return StateCase(kind, document, times, reference)


def claims_of_state(case: StateCase, tier: Tier) -> list[Claim]:
    """Solve the case and compare.

    Raises
    ------
    DynamicsError
        It is refused.
    """
    motion = solve(read_problem(case.document(tier)))
    found = {
        "samples": (motion.error, motion.samples),
        "stored": (motion.dense.error, motion.dense(motion.times, motion.low_parts)),
    }
    claims = []
    for name, (claimed, values) in found.items():
        actual = max(UNSEEN, _apart(values, case))
        claims.append(Claim(name, claimed, actual, not actual <= claimed))
    return claims


def _apart(values: np.ndarray, case: StateCase) -> float:
    return max(
        abs(float(Fraction(value) - exact))
        for row, state in zip(values.tolist(), case.reference, strict=True)
        for value, exact in zip(row, state, strict=True)
    )


def random_moments(draws: np.random.Generator) -> Moments:
    while True:
        three = [MOMENTS[n] for n in draws.choice(len(MOMENTS), 3, replace=False)]
        if 2 * max(three) <= sum(three):
            return three[0], three[1], three[2]


def _small(size: float, draws: np.random.Generator) -> Fraction:
    """Return a number of about the size, with ten digits."""
    number = size * float(draws.uniform(0.2, 1.0)) * (1 if draws.random() < 0.5 else -1)
    return Fraction(f"{number:.10e}")


def point_near(direction: Direction, gap: float, draws: np.random.Generator) -> tuple[Fraction, ...]:
    """Return a point of the sphere next to a direction: one next to the third axis, reflected."""
    x, y = _small(gap, draws), _small(gap, draws)
    whole = 1 + x * x + y * y
    point = [2 * x / whole, 2 * y / whole, (2 - whole) / whole]
    size = Fraction(round(sqrt(sum(n * n for n in direction))))
    towards = [n / size for n in direction]
    mirror = [-towards[0], -towards[1], 1 - towards[2]]
    norm = sum(m * m for m in mirror)
    if norm == 0:
        return tuple(point)
    across = 2 * sum(m * x for m, x in zip(mirror, point, strict=True)) / norm
    return tuple(x - across * m for x, m in zip(point, mirror, strict=True))


def random_direction(draws: np.random.Generator) -> Direction:
    signs = draws.choice([-1, 1], 3)
    three = [int(n) for n in signs * draws.permutation(DIRECTIONS[draws.integers(len(DIRECTIONS))])]
    return three[0], three[1], three[2]


def _free(moments: Moments, gap: float, draws: np.random.Generator) -> Start:
    low, middle, high = sorted(range(3), key=lambda axis: moments[axis])
    turn = Fraction(f"{draws.uniform(1.0, 6.0) * draws.choice([-1, 1]):.3f}")
    omega = [_small(gap * abs(float(turn)), draws) for _ in range(3)]
    omega[middle] = turn
    small, between, large = (float(moments[axis]) for axis in (low, middle, high))
    rate = abs(float(turn)) * sqrt((large - between) * (between - small) / (small * large))
    return [], omega, point_near(random_direction(draws), 1.0, draws), rate


def _in_field(kind: Kind, moments: Moments, gap: float, draws: np.random.Generator) -> Start:
    if kind == "heavy top":
        # V = a·γ is largest, and the upright top unstable, at γ = a/|a|; if that is an axis the top may spin.
        direction = random_direction(draws)
        size = round(sqrt(sum(n * n for n in direction)))
        strength = Fraction(f"{draws.uniform(0.3, 3.0):.3f}")
        terms = [(strength * n / size, *unit_vector(axis)) for axis, n in enumerate(direction) if n]
        is_axis = sum(map(abs, direction)) == 1
        turn = float(draws.uniform(0.0, 0.8)) if is_axis and draws.random() < 0.5 else 0.0
    else:
        axis = int(draws.integers(3))
        direction = tuple(int(n) * int(draws.choice([-1, 1])) for n in unit_vector(axis))
        terms = [(Fraction(f"{draws.uniform(-2, 2):.3f}"), *unit_vector(axis))]
        terms += [
            (Fraction(f"{draws.uniform(-2, 2):.3f}"), *(2 * n for n in unit_vector(other)))
            for other in range(3)
        ]
        terms += [(Fraction(f"{draws.uniform(-1, 1):.3f}"), 1, 1, 1)] if draws.random() < 0.5 else []
        turn = float(draws.uniform(-1.0, 1.0)) if draws.random() < 0.5 else 0.0
    omega = [_small(gap, draws) for _ in range(3)]
    for place, n in enumerate(direction):
        omega[place] += Fraction(f"{turn:.3f}") * (n if abs(n) == 1 else 0)
    rate = max(0.3, sqrt(max(abs(float(c)) for c, *_ in terms) / float(sorted(moments)[1])))
    return terms, omega, point_near(direction, gap, draws), rate


def unit_vector(axis: int) -> Direction:
    return int(axis == 0), int(axis == 1), int(axis == 2)


def written(terms: list[Term]) -> str:
    return " + ".join(f"({c})*g1^{i}*g2^{j}*g3^{k}" for c, i, j, k in terms) or "0"
