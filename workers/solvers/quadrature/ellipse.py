"""Proves that the inverse square of the rate is holomorphic on an ellipse about a panel of phases.

Which one, and for which degree of interpolation, is found by trials: the higher the degree, the closer
to the panel the ellipse may be, and the more nodes it takes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple, Protocol, runtime_checkable

from flint import acb, arb

PANEL_DEGREE = 32
"""Degree of the series of a panel."""
WANTED_RELATIVE_TAIL = 2e-19
"""Tail of F against F in the middle of the panel, by which an ellipse is chosen."""
REGION_RELATIVE_SIZE = 1.0 + 2.0**-20
"""Rectangles are so much larger than needed: the rounding of their corners is inside."""


@runtime_checkable
class PhaseSpeed(Protocol):
    """Bounds of (dθ/dt)², and its limits."""

    def bound(self, chain: Sequence[acb], *, is_close: bool) -> arb:
        """Return an upper bound of its absolute value on rectangles, each touching the one to its left.

        Not finite unless it is proved to be holomorphic there. ``is_close``: dearer and closer.
        """
        ...

    def enclosed(self, theta: arb) -> arb:
        """Return an enclosure of (dθ/dt)² on a stretch of real phases, smooth there or not."""
        ...

    def limit(self, theta: arb) -> arb | None:
        """Return dt/dθ at a turning point, a pole or the equator; not finite if unknown, None elsewhere."""
        ...


class BranchedSpeed(Protocol):
    """Bounds that are not the same function everywhere."""

    @property
    def kinks(self) -> tuple[tuple[float, float], ...]:
        """Return narrow stretches of u = θ/π that hold kinks."""
        ...

    @property
    def edges(self) -> tuple[float, ...]:
        """Return the u at which one function ends and another begins."""
        ...

    def on(self, left: float, right: float) -> PhaseSpeed:
        """Return the bounds for a stretch of u between two edges."""
        ...


class _Trial(NamedTuple):
    """A way to bound the tail of F."""

    degree: int
    """n, a multiple of PANEL_DEGREE."""
    rho: float
    parts: int
    """Rectangles that cover the ellipse."""
    is_close: bool


TRIALS = (
    _Trial(64, 2.6, 1, False),
    _Trial(64, 2.4, 4, False),
    _Trial(96, 1.85, 4, False),
    _Trial(64, 2.4, 2, True),
    _Trial(96, 1.8, 8, False),
    _Trial(128, 1.6, 16, False),
)
"""In the order of their cost."""


FLAT = _Trial(128, 1.0 + 2.0**-20, 4, False)
"""Hardly more than the panel."""


@dataclass(frozen=True, slots=True)
class Ellipse:
    """An ellipse about a panel on which F is proved to be holomorphic, in units of u = θ/π."""

    degree: int
    """Degree of the interpolation that this ellipse is for."""
    rho: float
    largest: arb
    """M."""


def find_ellipse(speed: PhaseSpeed, left: float, right: float, middle_rate: arb) -> Ellipse | None:
    """Return an ellipse on which F is bounded well enough, or None; f is ``middle_rate`` in the middle."""
    size = 1 / (middle_rate * middle_rate)
    for trial in TRIALS:
        largest = speed.bound(_chain(left, right, trial), is_close=trial.is_close) / arb.pi() ** 2
        is_doubtful = trial is TRIALS[1] and not largest.is_finite()
        if is_doubtful and not speed.bound(_chain(left, right, FLAT), is_close=False).is_finite():
            # With a kink on the panel itself nothing else is worth its cost.
            return None
        if tail_of(trial.degree, trial.rho, largest) < WANTED_RELATIVE_TAIL * size:
            return Ellipse(trial.degree, trial.rho, largest.upper())
    return None


def tail_of(degree: int, rho: float, largest: arb) -> arb:
    """Return τ."""
    return 4 * largest / (arb(rho) ** degree * (arb(rho) - 1))


def _chain(left: float, right: float, trial: _Trial) -> list[acb]:
    """Return rectangles in θ = πu that cover the ellipse about the panel."""
    middle, half = (arb(left) + arb(right)) / 2, (arb(right) - arb(left)) / 2
    across, along = (trial.rho + 1.0 / trial.rho) / 2.0, (trial.rho - 1.0 / trial.rho) / 2.0
    width = across / trial.parts
    chain = []
    for k in range(trial.parts):
        place = (2 * k + 1 - trial.parts) * width
        nearest = max(0.0, abs(place) - width) / across
        x = arb.pi() * (middle + half * arb(place, width * REGION_RELATIVE_SIZE))
        y = arb(0, (arb.pi() * half * (along * sqrt(1.0 - nearest * nearest) * REGION_RELATIVE_SIZE)).upper())
        chain.append(acb(x, y))
    return chain
