"""Finds every zero of the radicand P on one half of the loop, 0 < v < π (or −π < v < 0).

Where V has a formula the places between which P has one zero at most are proved (:mod:`.structure`).
For a V that is given by an integral they come from a scan: P is resolved by Chebyshev series on
panels. A panel whose constant term outweighs all the others has no zero. In the
others the critical points of the series cut the panel into monotone pieces. A critical value that
is tiny against the panel is refined first, so that two zeros closer than doubles resolve are still
two, and a double zero is one. Either way the signs at the cuts are taken in balls, and every change
of sign is one zero, enclosed.

The panels shrink geometrically towards both poles. Near a pole P is like a power of the distance: the
series are those of P times a power that levels the panel's ends, which moves no zero. Doubles serve where
they agree with balls; where they underflow next to a pole, or cancel so that no series comes to its end,
the nodes of the panel are evaluated in balls.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.root_finding.gap import NearRest
from service.dynamics.reduction.root_finding.zeros import (
    LoopPlace,
    PoleKind,
    Radicand,
    Region,
    Zero,
    classify_pole,
    is_known,
    lowest_place,
    zeros_between,
)
from service.dynamics.solution.dense_output import chebyshev_coefficients, chebyshev_points

FloatArray = NDArray[np.float64]

PANEL_DEGREE = 16
FACING: dict[Region, float] = {"north": 1.0, "middle": 0.0, "south": -1.0}
"""The sign of g2 at the pole that a region faces."""
POLE_PANELS = 40
"""Panels from an eighth of a turn towards a pole: down to a distance of 1e-12."""
CHECKED_PANELS = (39, 34, 29, 24, 19, 14, 9, 4)
"""Panels at which doubles are compared with balls, from the pole outwards."""
TRUSTED_RELATIVE_DIFFERENCE = 1e-6
"""Relative difference from the ball up to which doubles are trusted: it cannot hide a change of sign."""
TAIL_RELATIVE_SIZE = 1e-9
"""Tail of a series, against its largest term, that is too much."""
INFINITY_RELATIVE_WIDTH = 1e-3
"""Relative width of a panel about a place where P is infinite: there its sign is known by other means."""
MAX_SPLITS = 12
MAX_LEVELLING_EXPONENT = 400.0
"""Largest power of the distance to a pole that a panel is levelled by."""
MAX_POWER_LAW_EXPONENT = 2000.0
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
        return middle + half * chebyshev_points(PANEL_DEGREE)


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
        resolved = (sizes[-3:].max(axis=0) <= TAIL_RELATIVE_SIZE * largest) & (largest > 0.0)
        following: list[RegionPanel] = []
        for panel, coefficients, good in zip(waiting, series.T, resolved, strict=True):
            if good:
                done.append((panel, coefficients))
            elif split == MAX_SPLITS or (panel.in_balls and np.isnan(coefficients[0])):
                done.append((panel, np.full(PANEL_DEGREE + 1, np.nan)))
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
    if panel.right - panel.left < INFINITY_RELATIVE_WIDTH * panel.left:
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
    panels = [RegionPanel(region, quarter * 0.5 ** (k + 1), quarter * 0.5**k) for k in range(POLE_PANELS)]
    trusted = 0
    for level in CHECKED_PANELS:
        x = panels[level].left
        sine, cosine = g3_sign * np.sin(x), np.cos(x) * (-1.0 if region == "south" else 1.0)
        double = float(loop.radicand_real(np.array([sine]), np.array([cosine]))[0])
        exact = float(radicand(LoopPlace(region, arb(x))))
        if abs(double - exact) <= TRUSTED_RELATIVE_DIFFERENCE * abs(exact):
            trusted = level + 1
            break
    panels[trusted:] = [replace(panel, in_balls=True) for panel in panels[trusted:]]
    return panels if region == "south" else panels[::-1]


def _levelled_values(loop: Loop, g3_sign: int, radicand: Radicand, panels: list[RegionPanel]) -> FloatArray:
    """Return P at the nodes of all panels, levelled, shape (PANEL_DEGREE + 1, panels)."""
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
        is_flat = (facing != 0.0) & (np.abs(power) > MAX_POWER_LAW_EXPONENT)
        power = np.where(facing == 0.0, 0.0, np.clip(power, -MAX_LEVELLING_EXPONENT, MAX_LEVELLING_EXPONENT))
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


TAIL_EXPONENTS = (-1408, -996, -704, -498, -352, -256, -187, -136, -99, -72, -53, -42)
"""log2 of the distances to a pole where balls take the sign beyond the scan, where P is known."""
REFINED_BELOW_SHARE = 1e-6
"""A critical value below this fraction of its panel is refined in balls: doubles resolve 1e-13 of it."""
HIGHER_BITS = (640, 2560, 10240)
"""Bits, in turn, where those of the caller are not enough."""
SURE_LOG2_DISTANCE = -352
"""log2 of a distance to a pole at which these bits are taken to be enough."""
DOUBLE_ZERO_BITS_SHARE = 5.0 / 8.0
"""A refined critical value below 2^-(5/8 of the bits) of its panel counts as a zero of even order:
2^-100 with 160 bits. With more bits a smaller gap is still distinguished from none."""


@dataclass(frozen=True, slots=True)
class HalfLoop:
    """The sign structure of P on one half of the loop."""

    zeros: tuple[Zero, ...]
    """Growing v."""
    signs: tuple[int, ...]
    """Sign of P between neighbouring zeros: len(zeros) + 1 of them."""
    first_pole: PoleKind
    last_pole: PoleKind
    """At the smaller v (0 or −π) and at the larger (π or 0)."""
    slow: tuple[NearRest, ...] = ()
    """Places where P nearly touches 0 and is proved not to."""


def scan_half(loop: Loop, g3_sign: int, known: Sequence[LoopPlace] = ()) -> HalfLoop:
    """Return the zeros and signs of P where g3 has this sign (primed axes), as far as a scan shows them.

    ``known`` are places where P is infinite, and others next to them.
    """
    radicand = precise_radicand(loop, g3_sign)
    if vanishes(radicand):
        return HalfLoop((), (-1,), "blocked", "blocked")
    inner = list(known)
    infinite = [float(place.v()) for place in known if place.is_infinite]
    for panel, series in resolved_panels(loop, g3_sign, radicand, infinite):
        inner.extend(_cuts(panel, series, radicand))
    cuts = [*_tail("north", radicand), *in_order(inner), *_tail("south", radicand)[::-1]]
    return half_between(cuts, g3_sign, radicand)


def in_order(places: list[LoopPlace]) -> list[LoopPlace]:
    """Return the places in the order of growing v."""
    # A critical point next to an edge is found from both panels, from one of them beyond the edge.
    return sorted(places, key=lambda place: place.v().mid())


def half_between(cuts: list[LoopPlace], g3_sign: int, radicand: Radicand) -> HalfLoop:
    """Return the half with the zeros that the cuts enclose."""
    zeros, signs = zeros_between(cuts, radicand)
    first, last = classify_pole(radicand, "north"), classify_pole(radicand, "south")
    if g3_sign < 0:
        zeros = [Zero(-zero.v, zero.kind) for zero in reversed(zeros)]
        signs.reverse()
        first, last = last, first
    return HalfLoop(tuple(zeros), tuple(signs), first, last)


def precise_radicand(loop: Loop, g3_sign: int) -> Radicand:
    """Return P as a function of the place, with more bits where its ball is wide.

    Next to a pole a formula may hold 1 − g2², or 1 − g2² − g3² = g1²: what is
    left of it there can be 2^-1000 and less. Where the formula has no value, more bits find none.
    """
    finer: dict[int, Loop] = {}

    def value(at: Loop, place: LoopPlace) -> arb:
        return at.radicand_from(*_direction(place, g3_sign))

    def radicand(place: LoopPlace) -> arb:
        P = value(loop, place)
        if not P.is_finite() and loop.has_no_value(*_direction(place, g3_sign)):
            return P
        for bits in HIGHER_BITS:
            if is_known(P):
                break
            with ctx.workprec(bits):
                if bits not in finer:
                    finer[bits] = loop.refined()
                P = value(finer[bits], place)
        return P

    return radicand


def _direction(place: LoopPlace, g3_sign: int) -> tuple[arb, arb]:
    """Return sin v and cos v."""
    sine, cosine = place.x.sin_cos()
    return sine * g3_sign, -cosine if place.region == "south" else cosine


def vanishes(radicand: Radicand) -> bool:
    """Tell whether P is zero at places that nothing distinguishes: then it is everywhere (V is constant)."""
    values = [radicand(LoopPlace("middle", arb(x))) for x in (1.1, 1.3)]
    return all(value.is_finite() and value.contains(arb(0)) for value in values)


def _tail(side: Region, radicand: Radicand) -> list[LoopPlace]:
    """Return places beyond the scan, from the pole outwards; the farthest in only where P is known there."""
    places = [LoopPlace(side, arb(2) ** e) for e in TAIL_EXPONENTS]
    return [
        at
        for at, e in zip(places, TAIL_EXPONENTS, strict=True)
        if e >= SURE_LOG2_DISTANCE or is_known(radicand(at))
    ]


def _cuts(panel: RegionPanel, series: FloatArray, radicand: Radicand) -> list[LoopPlace]:
    """Return places, in the order of growing v, that cut the panel into pieces on which P is monotone.

    A panel that plainly has no zero needs only one point.
    """
    backwards = panel.region == "south"
    if not np.all(np.isfinite(series)):
        return _sampled_cuts(panel, radicand)
    size = float(np.abs(series).sum())
    if 2.0 * abs(series[0]) > 1.000001 * size:
        return [LoopPlace(panel.region, arb(panel.left), sign=1 if series[0] > 0.0 else -1)]
    middle, half = 0.5 * (panel.left + panel.right), 0.5 * (panel.right - panel.left)
    roots = np.polynomial.chebyshev.chebroots(np.polynomial.chebyshev.chebder(series))
    # Complex pairs next to the axis are kept: a flat stretch may hide a double zero.
    inside = roots[(np.abs(roots.imag) < 1e-3) & (np.abs(roots.real) < 1.001)].real
    edges = {-1.0: panel.left, 1.0: panel.right}
    cuts = []
    for root in inside:
        x, nothing = arb(float(middle + half * root)), arb(0)
        if abs(np.polynomial.chebyshev.chebval(root, series)) < REFINED_BELOW_SHARE * size:
            found = _extremum(lambda at: radicand(LoopPlace(panel.region, at)), x, arb(1e-4 * half))
            # A parabola through a flat stretch leads anywhere.
            if abs(found - middle) < 1.01 * half:
                x, nothing = found, size * arb(2) ** -int(DOUBLE_ZERO_BITS_SHARE * ctx.prec)
            # The edge next to a double zero is a double, at which P is tiny but not zero.
            touches = abs(radicand(LoopPlace(panel.region, x))).upper() <= nothing
            if touches and abs(root) > 0.999:
                edges.pop(float(np.sign(root)), None)
        cuts.append(LoopPlace(panel.region, x, nothing))
    cuts.extend(LoopPlace(panel.region, arb(x)) for x in edges.values())
    return sorted(cuts, key=lambda place: float(place.x), reverse=backwards)


def _sampled_cuts(panel: RegionPanel, radicand: Radicand) -> list[LoopPlace]:
    """Return the nodes of a panel that no series resolves, and the zeros between them where P only touches 0.

    Such a zero of no order, as of exp(-1/x²), or of another than an even one, as of |x|³,
    leaves no series: between two nodes that are lowest among their neighbours it is looked for.
    """
    nodes = [arb(x) for x in panel.nodes()[::-1].tolist()]
    places = [LoopPlace(panel.region, x) for x in nodes]
    # A zero next to an end of the panel may be on either side of it.
    nodes = [2 * nodes[0] - nodes[1], *nodes, 2 * nodes[-1] - nodes[-2]]
    sizes = [abs(radicand(LoopPlace(panel.region, x)).mid()) for x in nodes]
    for (left, _, right), (before, size, after) in zip(_triples(nodes), _triples(sizes), strict=True):
        if not (size <= before and size <= after):
            continue
        nothing = before.max(after) * arb(2) ** -int(DOUBLE_ZERO_BITS_SHARE * ctx.prec)
        x = lowest_place(lambda at: radicand(LoopPlace(panel.region, at)), left, right, nothing)
        is_inside = min(x - left, right - x) > 1e-3 * (right - left)
        if is_inside and abs(radicand(LoopPlace(panel.region, x))).upper() <= nothing:
            places.append(LoopPlace(panel.region, x, nothing))
    return sorted(places, key=lambda place: float(place.x), reverse=panel.region == "south")


def _triples(values: list[arb]) -> Iterator[tuple[arb, arb, arb]]:
    return zip(values, values[1:], values[2:], strict=False)


def _extremum(function: Callable[[arb], arb], x: arb, step: arb) -> arb:
    """Return the critical point next to ``x``, by parabolas through three points that close in.

    At a zero of order four every parabola takes off a third of the distance only.
    """
    for _ in range(12 + 3 * ctx.prec // 8):
        left, centre, right = function(x - step).mid(), function(x).mid(), function(x + step).mid()
        curvature = left - 2 * centre + right
        if not curvature.is_finite() or curvature == 0:
            return x
        move = (step * (left - right) / (2 * curvature)).mid()
        x = (x + move).mid()
        smallest = abs(x) * arb(2) ** (-ctx.prec // 3)
        if abs(move) / 8 < step:
            step = (abs(move) / 8).mid()
        if step < smallest:
            return x
    return x
