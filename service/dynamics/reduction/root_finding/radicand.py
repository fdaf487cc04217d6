r"""Finds every zero of the radicand P on one half of the loop, 0 < v < π (or −π < v < 0).

Where V has a formula the places between which P has one zero at most are proved (:mod:`.structure`).
For a V that is given by an integral they come from a scan: P is resolved by Chebyshev series on
panels (:mod:`.panels`). A panel whose constant term outweighs all the others has no zero. In the
others the critical points of the series cut the panel into monotone pieces. A critical value that
is tiny against the panel is refined first, so that two zeros closer than doubles resolve are still
two, and a double zero is one. Either way the signs at the cuts are taken in balls, and every change
of sign is one zero, enclosed.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.root_finding.gap import NearRest
from service.dynamics.reduction.root_finding.orders import lowest_place
from service.dynamics.reduction.root_finding.panels import RegionPanel, resolved_panels
from service.dynamics.reduction.root_finding.zeros import (
    LoopPlace,
    PoleKind,
    Radicand,
    Region,
    Zero,
    classify_pole,
    is_known,
    zeros_between,
)

FloatArray = NDArray[np.float64]

TAIL_EXPONENTS = (-1408, -996, -704, -498, -352, -256, -187, -136, -99, -72, -53, -42)
"""log2 of the distances to a pole where balls take the sign beyond the scan, where P is known."""
SUSPECT = 1e-6
"""A critical value below this fraction of its panel is refined in balls: doubles resolve 1e-13 of it."""
LADDER = (640, 2560, 10240)
"""Bits, in turn, where those of the caller are not enough."""
SURE = -352
"""log2 of a distance to a pole at which these bits are taken to be enough."""
DOUBLE_SHARE = 5.0 / 8.0
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
        for bits in LADDER:
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
    return [at for at, e in zip(places, TAIL_EXPONENTS, strict=True) if e >= SURE or is_known(radicand(at))]


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
        if abs(np.polynomial.chebyshev.chebval(root, series)) < SUSPECT * size:
            found = _extremum(lambda at: radicand(LoopPlace(panel.region, at)), x, arb(1e-4 * half))
            # A parabola through a flat stretch leads anywhere.
            if abs(found - middle) < 1.01 * half:
                x, nothing = found, size * arb(2) ** -int(DOUBLE_SHARE * ctx.prec)
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
        nothing = before.max(after) * arb(2) ** -int(DOUBLE_SHARE * ctx.prec)
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
