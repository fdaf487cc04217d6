"""Describes the windows of given arcs: mirror images are one window, the smallest |g1| comes first."""

from flint import arb

from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.recognition.evenness import is_even_in_g2
from service.dynamics.reduction.arc import Arc
from service.dynamics.reduction.ends import height
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.window import EndKind, Window, WindowKind


def windows_of(arcs: list[Arc], g3_sign: int, potential: Potential) -> tuple[Window, ...]:
    """Join mirror images, order by largest |g1|, describe; there are some only where V is even in g2.

    Equal ends make no mirror images: a bump of V within one of two arcs changes its motion and not its ends.
    """
    joined: list[tuple[Arc, ...]] = []
    rest = list(arcs)
    while rest:
        arc = rest.pop(0)
        twin = next((other for other in rest if _are_mirror_images(arc, other)), None)
        if twin is None or not is_even_in_g2(potential):
            joined.append((arc,))
        else:
            rest.remove(twin)
            joined.append(_northern_first(arc, twin))
    described = sorted((_describe(group, g3_sign) for group in joined), key=_size_and_side)
    return tuple(Window(index, w.kind, w.ends, w.g1, w.g2, w.arcs) for index, w in enumerate(described))


def _size_and_side(window: Window) -> tuple[float, float]:
    """Return the order of a window: of two with one largest |g1|, at g2 and −g2, the northern is first."""
    # To fewer digits than the rounding of either.
    return float(f"{abs(window.g1[1]):.12e}"), -window.g2[1]


def _are_mirror_images(one: Arc, two: Arc) -> bool:
    """Tell whether v → π − v (modulo a turn) maps one arc onto the other."""
    if one.is_whole_loop or (one.lower_end, one.upper_end) != (two.upper_end, two.lower_end):
        return False
    gap = one.lower + two.upper - arb.pi()
    turns = (gap / (2 * arb.pi())).mid()
    whole = 2 * arb.pi() * arb(round(float(turns)))
    close = arb(2) ** -40  # both arcs are kept as they are: nothing is lost by counting them as one
    return bool(abs(gap - whole) < close and abs(one.upper + two.lower - arb.pi() - whole) < close)


def _northern_first(one: Arc, two: Arc) -> tuple[Arc, Arc]:
    # Ends on the equator, or next to it, have no sure hemisphere; an arc that has a mirror image lies
    # within half a turn, and its middle has one.
    return (one, two) if ((one.lower + one.upper) / 2).cos() > 0 else (two, one)


def _describe(arcs: tuple[Arc, ...], g3_sign: int) -> Window:
    arc = arcs[0]
    ends_v = [arc.lower, arc.upper]
    sizes = [_absolute_g1(arc.loop, v) for v in ends_v]
    lo_v, hi_v = (arc.lower, arc.upper) if sizes[0] < sizes[1] else (arc.upper, arc.lower)
    lo_end: EndKind = (
        "pole" if arc.is_whole_loop or arc.poles or _ends_at_pole(arc, lo_v) else _stop(arc, lo_v)
    )
    hi_end: EndKind = "equator" if arc.is_whole_loop or arc.equators else _stop(arc, hi_v)
    loop = arc.loop
    sign = g3_sign if loop.mirrored else loop.g1_sign
    lo = 0.0 if lo_end == "pole" else min(sizes)
    hi = _absolute_g1(loop, arb.pi() / 2) if hi_end == "equator" else max(sizes)
    heights = [height(loop, v) for v in (lo_v, hi_v)]
    for pole in [*arc.poles, *([arb(0), arb.pi()] if arc.is_whole_loop else [])]:
        heights.append(float(pole.cos()))
    return Window(
        0, _kind(arc), (lo_end, hi_end), (sign * lo + 0.0, sign * hi), (min(heights), max(heights)), arcs
    )


def _stop(arc: Arc, v: arb) -> EndKind:
    end = arc.lower_end if v is arc.lower else arc.upper_end
    if end == "edge" or end == "collision" or end == "standstill":
        return end
    return "equilibrium" if end in ("double", "flat") else "rest"


def _ends_at_pole(arc: Arc, v: arb) -> bool:
    end = arc.lower_end if v is arc.lower else arc.upper_end
    return end == "pole" or (end == "collision" and v.sin().contains(0))


def _kind(arc: Arc) -> WindowKind:
    ends = {arc.lower_end, arc.upper_end}
    if arc.lower is arc.upper:
        return "equilibrium"
    if "edge" in ends:
        return "edge"
    if "collision" in ends:
        return "collision"
    if "standstill" in ends:
        return "standstill"
    if "double" in ends or "flat" in ends:
        return "separatrix"
    return "pole" if "pole" in ends else "periodic"


def _absolute_g1(loop: Loop, v: arb) -> float:
    """Return the client's |g1| at v."""
    sine = abs(v.sin())
    if loop.mirrored:
        return float(loop.Z * sine)
    if sine.contains(arb(0)):
        return 0.0
    return float(loop.G * (sine.log() * loop.alpha.numerator / loop.alpha.denominator).exp())
