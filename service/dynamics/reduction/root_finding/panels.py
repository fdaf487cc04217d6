"""Resolves P by Chebyshev series on panels that shrink geometrically towards both poles.

Near a pole P is like a power of the distance: the series are those of P times
a power that levels the panel's ends, which moves no zero. Doubles serve where
they agree with balls; where they underflow next to a pole, or cancel so that
no series comes to its end, the nodes of the panel are evaluated in balls.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.root_finding.zeros import LoopPlace, Radicand, Region
from service.dynamics.solution.dense_output import chebyshev_coefficients, chebyshev_points

FloatArray = NDArray[np.float64]

DEGREE = 16
FACING: dict[Region, float] = {"north": 1.0, "middle": 0.0, "south": -1.0}
"""The sign of g2 at the pole that a region faces."""
LEVELS = 40
"""Panels from an eighth of a turn towards a pole: down to a distance of 1e-12."""
CHECKED_LEVELS = (39, 34, 29, 24, 19, 14, 9, 4)
"""Panels at which doubles are compared with balls, from the pole outwards."""
AGREEMENT = 1e-6
"""Relative difference from the ball up to which doubles are trusted: it cannot hide a change of sign."""
UNRESOLVED = 1e-9
"""Tail of a series, against its largest term, that is too much."""
ABOUT_INFINITY = 1e-3
"""Relative width of a panel about a place where P is infinite: there its sign is known by other means."""
MAX_SPLITS = 12
STEEPEST = 400.0
"""Largest power of the distance to a pole that a panel is levelled by."""
FLAT = 2000.0
"""A larger one is not that of a power law, and panels would never be short enough for a series."""


@dataclass(frozen=True, slots=True)
class RegionPanel:
    """left ≤ x ≤ right in one region."""

    region: Region
    left: float
    right: float
    in_balls: bool = False
    """Doubles do not serve here."""

    def halves(self) -> "tuple[RegionPanel, RegionPanel]":
        """Return the panel's two halves."""
        middle = 0.5 * (self.left + self.right)
        return replace(self, right=middle), replace(self, left=middle)

    def nodes(self) -> FloatArray:
        """Return the places of the series, from right to left."""
        middle, half = 0.5 * (self.left + self.right), 0.5 * (self.right - self.left)
        return middle + half * chebyshev_points(DEGREE)


def resolved_panels(
    loop: Loop, g3_sign: int, radicand: Radicand, infinite: Sequence[float] = ()
) -> list[tuple[RegionPanel, FloatArray]]:
    """Return panels in the order of growing v with the series of P on the half of this sign of g3.

    A panel that even balls do not resolve has a series of NaN. About the v where P is ``infinite`` there is
    none.
    """
    waiting = [
        *_towards_pole(loop, g3_sign, radicand, "north"),
        RegionPanel("middle", 0.25 * np.pi, 0.75 * np.pi),
    ]
    waiting.extend(_towards_pole(loop, g3_sign, radicand, "south"))
    waiting = [part for panel in waiting for part in _without(panel, infinite)]
    done: list[tuple[RegionPanel, FloatArray]] = []
    for split in range(MAX_SPLITS + 1):
        series = chebyshev_coefficients(_levelled_values(loop, g3_sign, radicand, waiting))
        sizes = np.abs(series)
        # Written so that NaN is unresolved.
        largest = sizes.max(axis=0)
        # Doubles that underflow all along a panel say nothing of P.
        resolved = (sizes[-3:].max(axis=0) <= UNRESOLVED * largest) & (largest > 0.0)
        following: list[RegionPanel] = []
        for panel, coefficients, good in zip(waiting, series.T, resolved, strict=True):
            if good:
                done.append((panel, coefficients))
            elif split == MAX_SPLITS or (panel.in_balls and np.isnan(coefficients[0])):
                done.append((panel, np.full(DEGREE + 1, np.nan)))
            elif panel.in_balls:
                following.extend(panel.halves())
            else:
                following.extend(_retried(panel, coefficients))
        waiting = following
        if not waiting:
            break
    order = {"north": 0, "middle": 1, "south": 2}
    done.sort(key=lambda at: (order[at[0].region], -at[0].left if at[0].region == "south" else at[0].left))
    return done


def _without(panel: RegionPanel, infinite: Sequence[float]) -> list[RegionPanel]:
    """Return the parts of a panel that are left without the neighbourhoods of places where P is infinite."""
    ends = (np.pi - panel.right, np.pi - panel.left) if panel.region == "south" else (panel.left, panel.right)
    if not any(ends[0] <= v <= ends[1] for v in infinite):
        return [panel]
    if panel.right - panel.left < ABOUT_INFINITY * panel.left:
        return []
    parts = [part for half in panel.halves() for part in _without(half, infinite)]
    return parts[::-1] if panel.region == "south" else parts


def _retried(panel: RegionPanel, coefficients: FloatArray) -> tuple[RegionPanel, ...]:
    """Halve a panel whose series decays too slowly; use balls if it ends in noise or overflows."""
    sizes = np.abs(coefficients)
    decays = sizes[-4:].max() < 0.1 * sizes[4:8].max()
    return panel.halves() if decays else (replace(panel, in_balls=True),)


def _towards_pole(loop: Loop, g3_sign: int, radicand: Radicand, region: Region) -> list[RegionPanel]:
    """Return the panels next to one pole, in the order of growing v."""
    quarter = 0.25 * np.pi
    panels = [RegionPanel(region, quarter * 0.5 ** (k + 1), quarter * 0.5**k) for k in range(LEVELS)]
    trusted = 0
    for level in CHECKED_LEVELS:
        x = panels[level].left
        sine, cosine = g3_sign * np.sin(x), np.cos(x) * (-1.0 if region == "south" else 1.0)
        double = float(loop.radicand_real(np.array([sine]), np.array([cosine]))[0])
        exact = float(radicand(LoopPlace(region, arb(x))))
        if abs(double - exact) <= AGREEMENT * abs(exact):
            trusted = level + 1
            break
    panels[trusted:] = [replace(panel, in_balls=True) for panel in panels[trusted:]]
    return panels if region == "south" else panels[::-1]


def _levelled_values(loop: Loop, g3_sign: int, radicand: Radicand, panels: list[RegionPanel]) -> FloatArray:
    """Return P at the nodes of all panels, levelled, shape (DEGREE + 1, panels)."""
    nodes = np.stack([panel.nodes() for panel in panels], axis=1)
    facing = np.array([FACING[panel.region] for panel in panels])
    cosines = np.where(facing < 0.0, -1.0, 1.0) * np.cos(nodes)
    values = loop.radicand_real(g3_sign * np.sin(nodes), cosines)
    for k, panel in enumerate(panels):
        if panel.in_balls:
            values[:, k] = _values_in_balls(panel, radicand)
    with np.errstate(all="ignore"):
        ratio = values[0] / values[-1]
        power = np.log(np.where(ratio > 0.0, ratio, 1.0)) / np.log(nodes[0] / nodes[-1])
        # A zero at an end of the panel, as one on the equator, is no power of the distance to a pole.
        is_flat = (facing != 0.0) & (np.abs(power) > FLAT)
        power = np.where(facing == 0.0, 0.0, np.clip(power, -STEEPEST, STEEPEST))
        levelled = values * (nodes / nodes[0]) ** -power
    levelled[:, is_flat] = np.nan
    return np.where(np.isfinite(levelled), levelled, np.nan)


def _values_in_balls(panel: RegionPanel, radicand: Radicand) -> list[float]:
    """Return P at the nodes against its size at one of them: even a power of 100 then fits a double."""
    values = [radicand(LoopPlace(panel.region, arb(float(x)))) for x in panel.nodes()]
    if not all(value.is_finite() for value in values):
        return [float("nan")] * len(values)
    size = abs(values[0].mid())
    return [float(value / size) for value in values]
