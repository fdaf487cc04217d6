"""Every admissible window of a planar motion, its type, and the choice among several."""

from dataclasses import dataclass

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.arc import Arc, ArcEnd
from service.dynamics.reduction.ends import height
from service.dynamics.reduction.loop import Loop, make_loop, start_g3_sign
from service.dynamics.reduction.radicand import HalfLoop, precise_radicand, scan_half
from service.dynamics.reduction.window import EndKind, Window, WindowKind
from service.dynamics.reduction.zeros import Place, PoleKind, Region, ZeroKind

PRECISION = 160
"""Bits of the balls the reduction works in: 2^-160 of room below a double's 2^-53."""

CONFIRMED = (640, 2560)
"""Bits, in turn, in which a double zero is looked at again: 2560 tell a gap of 2^-1600, beyond any decimal's
400 digits, from none."""


class NoMotionError(DynamicsError):
    """p² < 0 on the whole curve: no motion with this λ and these signs."""

    code = "no_motion"


_WINDOW_POINTER = "/motion/window"


class SeveralWindowsError(DynamicsError):
    """More than one admissible window and none was chosen."""

    code = "several_windows"

    def __init__(self, windows: tuple[Window, ...]) -> None:
        listed = "; ".join(f"{w.index}: g1 from {w.g1[0]:.6g} to {w.g1[1]:.6g}" for w in windows)
        message = f'{len(windows)} admissible windows ({listed}); choose one with "window"'
        super().__init__(message, pointer=_WINDOW_POINTER)
        self.windows = windows


class NoSuchWindowError(DynamicsError):
    """A window was chosen that the curve does not have."""

    code = "no_such_window"

    def __init__(self, number: int, windows: tuple[Window, ...]) -> None:
        accepted = "accepted is 0" if len(windows) == 1 else f"accepted are 0 to {len(windows) - 1}"
        super().__init__(f"window {number} of {len(windows)}; {accepted}", pointer=_WINDOW_POINTER)
        self.windows = windows


_ENDS: dict[ZeroKind, ArcEnd] = {"simple": "rest", "multiple": "double", "flat": "flat", "edge": "edge"}


@dataclass(frozen=True, slots=True)
class _Break:
    """A place on the (unrolled) loop where an arc can end."""

    v: arb
    end: ArcEnd


def find_windows(
    body: RigidBody, potential: Potential, motion: PlanarMotion, *, precision: int = PRECISION
) -> tuple[Window, ...]:
    """Return all admissible windows on the half of the curve that ``motion`` names.

    Zeros of the radicand are enclosed in balls of ``precision`` bits. A double
    zero is believed only if it stays one in many more: coefficients are exact,
    and a gap too narrow for these bits makes a motion periodic all the same.

    Raises
    ------
    EqualMomentsError, NuNeedsDoubleMomentError
        The curve does not exist.
    """
    finer = (bits for bits in CONFIRMED if bits > precision)
    while True:
        with ctx.workprec(precision):
            loop = make_loop(body, potential, motion)
            g3_sign = start_g3_sign(loop, motion)
            arcs = _arcs(loop, g3_sign)
            following = next(finer, None)
            if following is None or not any("double" in (arc.lower_end, arc.upper_end) for arc in arcs):
                return _numbered(arcs, g3_sign)
        precision = following


def choose_window(windows: tuple[Window, ...], motion: PlanarMotion) -> Window:
    """Return the window that ``motion`` asks for.

    Raises
    ------
    NoMotionError, SeveralWindowsError, NoSuchWindowError
        There is none, there are several and none was named, or the named one is not there.
    """
    if not windows:
        raise NoMotionError(
            "p² is negative on the whole curve: no motion with this lambda and these signs of g1 and g3",
            pointer="/motion",
        )
    if motion.window is None:
        if len(windows) > 1:
            raise SeveralWindowsError(windows)
        return windows[0]
    if not 0 <= motion.window < len(windows):
        raise NoSuchWindowError(motion.window, windows)
    return windows[motion.window]


def _arcs(loop: Loop, g3_sign: int) -> list[Arc]:
    """Return the arcs that meet the half of the loop where g3 has ``g3_sign``."""
    half = scan_half(loop, g3_sign)
    base = arb(0) if g3_sign > 0 else -arb.pi()
    breaks = [_Break(zero.v, _ENDS[zero.kind]) for zero in half.zeros]
    first_open = half.signs[0] > 0 and half.first_pole == "passable"
    last_open = half.signs[-1] > 0 and half.last_pole == "passable"
    signs = list(half.signs)
    other = scan_half(loop, -g3_sign) if first_open or last_open else None
    if other is not None:
        north, south = (_is_the_same_from_both_sides(loop, side) for side in ("north", "south"))
        first, last = (north, south) if g3_sign > 0 else (south, north)
        first_open = first_open and other.last_pole == "passable" and first
        last_open = last_open and other.first_pole == "passable" and last
    if first_open and last_open and not breaks and other is not None and not other.zeros:
        return [Arc(loop, base, base + 2 * arb.pi(), None, None)]
    lower = (
        _beyond(other, base, before=True)
        if first_open and other
        else _Break(base, _pole_end(half.first_pole))
    )
    top = base + arb.pi()
    upper = (
        _beyond(other, top, before=False) if last_open and other else _Break(top, _pole_end(half.last_pole))
    )
    edges = [lower, *breaks, upper]
    arcs = [
        Arc(loop, left.v, right.v, left.end, right.end)
        for left, right, sign in zip(edges, edges[1:], signs, strict=False)
        if sign > 0
    ]
    isolated = [
        Arc(loop, at.v, at.v, at.end, at.end)
        for at, left, right in zip(breaks, signs, signs[1:], strict=False)
        if at.end in ("double", "flat") and left < 0 and right < 0
    ]
    return sorted(arcs + isolated, key=lambda arc: float(arc.lower))


def _is_the_same_from_both_sides(loop: Loop, side: Region) -> bool:
    """Say whether p² has one limit at a pole: with another F beyond it no motion with q = 0 goes on."""
    at = Place(side, arb(2) ** -352)
    here, there = (precise_radicand(loop, g3_sign)(at) for g3_sign in (1, -1))
    # Both are known to 32 bits at least.
    return bool(abs(here - there) < abs(here) * arb(2) ** -24)


def _beyond(other: HalfLoop, pole: arb, *, before: bool) -> _Break:
    """Return where an arc that passes a pole ends on the mirror curve.

    The mirror half runs over −π < v < 0 or 0 < v < π; seen from the pole at
    ``pole`` its zeros are moved by whole turns to the right side of it. If it
    has none, the arc comes round to the far pole, which then ends it.
    """
    zeros = other.zeros
    if not zeros:
        kind = other.first_pole if before else other.last_pole
        return _Break(pole - arb.pi() if before else pole + arb.pi(), _pole_end(kind))
    zero = zeros[-1] if before else zeros[0]
    turn = 2 * arb.pi()
    v = zero.v
    while before and v > pole:
        v = v - turn
    while not before and v < pole:
        v = v + turn
    return _Break(v, _ENDS[zero.kind])


def _pole_end(kind: PoleKind) -> ArcEnd:
    # P > 0 up to a pole that cannot be passed: it diverges, or dies out there, or
    # has another limit on the mirror curve.
    if kind == "flat":
        return "flat"
    return "collision" if kind == "collision" else "pole"


def _numbered(arcs: list[Arc], g3_sign: int) -> tuple[Window, ...]:
    """Join mirror images, order by largest |g1|, describe."""
    joined: list[tuple[Arc, ...]] = []
    rest = list(arcs)
    while rest:
        arc = rest.pop(0)
        twin = next((other for other in rest if _are_mirror_images(arc, other)), None)
        if twin is None:
            joined.append((arc,))
        else:
            rest.remove(twin)
            joined.append(_northern_first(arc, twin))
    described = sorted((_describe(group, g3_sign) for group in joined), key=lambda w: abs(w.g1[1]))
    return tuple(Window(index, w.kind, w.ends, w.g1, w.g2, w.arcs) for index, w in enumerate(described))


def _are_mirror_images(one: Arc, two: Arc) -> bool:
    """Say whether v → π − v (modulo a turn) maps one arc onto the other."""
    if one.is_whole_loop or (one.lower_end, one.upper_end) != (two.upper_end, two.lower_end):
        return False
    gap = one.lower + two.upper - arb.pi()
    turns = (gap / (2 * arb.pi())).mid()
    whole = 2 * arb.pi() * arb(round(float(turns)))
    close = arb(2) ** -40  # both arcs are kept as they are: nothing is lost by counting them as one
    return bool(abs(gap - whole) < close and abs(one.upper + two.lower - arb.pi() - whole) < close)


def _northern_first(one: Arc, two: Arc) -> tuple[Arc, Arc]:
    return (one, two) if one.lower.cos() + one.upper.cos() > 0 else (two, one)


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
    return "equilibrium" if end in ("double", "flat") else "edge" if end == "edge" else "rest"


def _ends_at_pole(arc: Arc, v: arb) -> bool:
    end = arc.lower_end if v is arc.lower else arc.upper_end
    return end in ("pole", "collision")


def _kind(arc: Arc) -> WindowKind:
    ends = {arc.lower_end, arc.upper_end}
    if arc.lower is arc.upper:
        return "equilibrium"
    if "edge" in ends:
        return "edge"
    if "collision" in ends:
        return "collision"
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
