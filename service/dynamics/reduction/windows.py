"""Finds every admissible window of a planar motion, its type, and the chosen one among several.

Arcs that are mirror images make one window; the window with the smallest |g1| comes first.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any  # keys and values of what is kept

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.potentials.potential import FormulaPotential, Potential
from service.dynamics.potentials.recognition import is_even_in_g2
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.arcs_of_loop import arcs_of
from service.dynamics.reduction.geometry.loop import Loop, make_loop, start_g3_sign
from service.dynamics.reduction.root_finding.radicand import HalfLoop
from service.dynamics.reduction.separatrices import resolved
from service.dynamics.reduction.structure import HalfInDoubles, halves_in_doubles, proved_half
from service.dynamics.reduction.window import Arc, EndKind, Window, WindowKind, height


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


REDUCTION_BITS = 160
"""Bits of the balls the reduction works in: 2^-160 of room below a double's 2^-53."""

CONFIRMATION_BITS = 640
"""Bits in which what looks like a double zero is looked at again, before it is proved to be one."""


ANSWERS_CACHED = 8
"""Answers that are remembered: a job asks for its windows when it is judged, when it is solved, and for
enclosures, and what proves them takes longer than many a motion."""


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


def find_windows(
    body: RigidBody, potential: Potential, motion: PlanarMotion, *, precision: int = REDUCTION_BITS
) -> tuple[Window, ...]:
    """Return all admissible windows on the half of the curve that ``motion`` names.

    Zeros of the radicand are enclosed in balls of ``precision`` bits. A zero of
    order two or more is proved to be one: coefficients are exact, and a gap too
    narrow for these bits makes a motion periodic all the same.

    Raises
    ------
    SeparatrixUndecidedError
        A zero is neither proved to be of order two or more, nor distinguished from others next to it.
    PassageUndecidedError
        It is neither proved nor disproved that p² has one limit at a pole it is positive at.
    EqualMomentsError, NuNeedsDoubleMomentError
        The curve does not exist.
    """
    # Hashing an exact problem takes longer than many a step of its solution.
    handed = _HANDED.get(id(motion)) if precision == REDUCTION_BITS else None
    if handed is not None and handed[0] is body and handed[1] is potential:
        return handed[3]
    key = _key(body, potential, motion, precision)
    found = _KNOWN.get(key)
    if found is None:
        try:
            found = _all_windows(body, potential, motion, precision)
        except DynamicsError as refusal:
            found = refusal
        _remember(key, found)
    if isinstance(found, DynamicsError):
        raise found.with_traceback(None)
    return found


def remember_windows(
    body: RigidBody, potential: Potential, motion: PlanarMotion, windows: tuple[Window, ...]
) -> None:
    """Let :func:`find_windows` answer with windows that it found before, in another process.

    They hold for the precision at which windows are found first.
    """
    _remember(_key(body, potential, motion, REDUCTION_BITS), windows)


def hand_on_windows(
    body: RigidBody, potential: Potential, motion: PlanarMotion, windows: tuple[Window, ...]
) -> None:
    """Let :func:`find_windows` answer so when it is next asked for these very objects."""
    _HANDED[id(motion)] = body, potential, motion, windows
    _keep_few(_HANDED)


class _TheSame:
    """A potential that is equal to no other object: those without a formula are not compared."""

    def __init__(self, potential: Potential) -> None:
        self._potential = potential

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _TheSame) and other._potential is self._potential

    def __hash__(self) -> int:
        return id(self._potential)


_Key = tuple[RigidBody, Potential | _TheSame, PlanarMotion, int]
_KNOWN: dict[_Key, tuple[Window, ...] | DynamicsError] = {}
"""The last ANSWERS_CACHED answers, the oldest first."""
_HANDED: dict[int, tuple[RigidBody, Potential, PlanarMotion, tuple[Window, ...]]] = {}
"""Problems and windows handed on last, by ``id`` of the motion: while that is kept, nothing else has its
id."""


def _key(body: RigidBody, potential: Potential, motion: PlanarMotion, precision: int) -> _Key:
    compared = potential if isinstance(potential, FormulaPotential) else _TheSame(potential)
    # Neither the window that is chosen nor the start has a say in it.
    return body, compared, replace(motion, window=None, start=None), precision


def _remember(key: _Key, found: tuple[Window, ...] | DynamicsError) -> None:
    _KNOWN[key] = found
    _keep_few(_KNOWN)


def _keep_few(known: dict[Any, Any]) -> None:
    while len(known) > ANSWERS_CACHED:
        # Another thread may have taken the oldest one away.
        known.pop(next(iter(known), None), None)


def find_windows_together(
    body: RigidBody, potential: Potential, motions: Sequence[PlanarMotion]
) -> list[tuple[Window, ...] | DynamicsError]:
    """Return for each motion what :func:`find_windows` returns, or the refusal that it raises.

    What doubles say is found for all of them at once, which takes a fraction of the time. Balls prove the
    same of each; the last bits of a ball may depend on the other motions.
    """
    in_doubles: list[_Loop | None] = [None] * len(motions)
    groups: dict[tuple[int, int], list[int]] = {}
    with ctx.workprec(REDUCTION_BITS), suppress(DynamicsError):
        loops = [make_loop(body, potential, motion) for motion in motions]
        for k, (loop, motion) in enumerate(zip(loops, motions, strict=True)):
            groups.setdefault((loop.g1_sign, start_g3_sign(loop, motion)), []).append(k)
        for (_, g3_sign), indices in groups.items() if potential.has_formula else ():
            for k, half in zip(indices, halves_in_doubles([loops[k] for k in indices], g3_sign), strict=True):
                in_doubles[k] = None if half is None else _Loop(loops[k], half)
    found: list[tuple[Window, ...] | DynamicsError] = []
    for motion, known in zip(motions, in_doubles, strict=True):
        try:
            found.append(_all_windows(body, potential, motion, REDUCTION_BITS, known))
        except DynamicsError as refusal:
            found.append(refusal.with_traceback(None))
    return found


@dataclass(frozen=True, slots=True)
class _Loop:
    """A loop, and what doubles say of the half that is asked."""

    loop: Loop
    in_doubles: HalfInDoubles


def _all_windows(
    body: RigidBody, potential: Potential, motion: PlanarMotion, precision: int, known: _Loop | None = None
) -> tuple[Window, ...]:
    while True:
        with ctx.workprec(precision):
            loop = make_loop(body, potential, motion) if known is None else known.loop
            g3_sign = start_g3_sign(loop, motion)
            # With fewer bits two zeros that are merely close look like a double one.
            is_last = precision >= CONFIRMATION_BITS
            arcs = arcs_of(loop, g3_sign, _resolved_half if is_last else _proved_by(g3_sign, known))
            if is_last or not any("double" in (arc.lower_end, arc.upper_end) for arc in arcs):
                return windows_of(arcs, g3_sign, potential)
        precision, known = CONFIRMATION_BITS, None


def _proved_by(asked: int, known: _Loop | None) -> Callable[[Loop, int], HalfLoop]:
    """Return what proves the halves of a loop; of the half that is ``asked`` there may be something known."""
    return lambda loop, sign: proved_half(loop, sign, known.in_doubles if known and sign == asked else None)


def _resolved_half(loop: Loop, g3_sign: int) -> HalfLoop:
    return resolved(loop, proved_half(loop, g3_sign))


def choose_window(windows: tuple[Window, ...], motion: PlanarMotion) -> Window:
    """Return the window that ``motion`` chooses.

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
