"""Finds every admissible window of a planar motion, its type, and the chosen one among several."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any  # keys and values of what is kept

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.potentials.potential import FormulaPotential, Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.arc import Arc, ArcEnd
from service.dynamics.reduction.geometry.loop import Loop, make_loop, start_g3_sign
from service.dynamics.reduction.root_finding.radicand import HalfLoop
from service.dynamics.reduction.root_finding.zeros import PoleKind, Region, Zero, ZeroKind
from service.dynamics.reduction.separatrices import resolved
from service.dynamics.reduction.sides import has_one_limit, is_even
from service.dynamics.reduction.structure import proved_half
from service.dynamics.reduction.window import Window
from service.dynamics.reduction.windows_of_arcs import windows_of

PRECISION = 160
"""Bits of the balls the reduction works in: 2^-160 of room below a double's 2^-53."""

CONFIRMED = 640
"""Bits in which what looks like a double zero is looked at again, before it is proved to be one."""


KEPT = 8
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
    handed = _HANDED.get(id(motion)) if precision == PRECISION else None
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
    _remember(_key(body, potential, motion, PRECISION), windows)


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
"""The last KEPT answers, the oldest first."""
_HANDED: dict[int, tuple[RigidBody, Potential, PlanarMotion, tuple[Window, ...]]] = {}
"""What was handed on last, by the number of the motion: while that is kept, no other object has it."""


def _key(body: RigidBody, potential: Potential, motion: PlanarMotion, precision: int) -> _Key:
    compared = potential if isinstance(potential, FormulaPotential) else _TheSame(potential)
    # Neither the window that is chosen nor the start has a say in it.
    return body, compared, replace(motion, window=None, start=None), precision


def _remember(key: _Key, found: tuple[Window, ...] | DynamicsError) -> None:
    _KNOWN[key] = found
    _keep_few(_KNOWN)


def _keep_few(known: dict[Any, Any]) -> None:
    while len(known) > KEPT:
        # Another thread may have taken the oldest one away.
        known.pop(next(iter(known), None), None)


def _all_windows(
    body: RigidBody, potential: Potential, motion: PlanarMotion, precision: int
) -> tuple[Window, ...]:
    while True:
        with ctx.workprec(precision):
            loop = make_loop(body, potential, motion)
            g3_sign = start_g3_sign(loop, motion)
            # With fewer bits two zeros that are merely close look like a double one.
            is_last = precision >= CONFIRMED
            arcs = _arcs(loop, g3_sign, _resolved_half if is_last else proved_half)
            if is_last or not any("double" in (arc.lower_end, arc.upper_end) for arc in arcs):
                return windows_of(arcs, g3_sign, potential)
        precision = CONFIRMED


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


def _arcs(loop: Loop, g3_sign: int, scan: Callable[[Loop, int], HalfLoop]) -> list[Arc]:
    """Return the arcs that meet the half of the loop where g3 has ``g3_sign``."""
    half = scan(loop, g3_sign)
    base = arb(0) if g3_sign > 0 else -arb.pi()
    breaks = [_Break(zero.v, _ENDS[zero.kind]) for zero in half.zeros]
    first_open = half.signs[0] > 0 and half.first_pole == "passable"
    last_open = half.signs[-1] > 0 and half.last_pole == "passable"
    signs = list(half.signs)
    other = _mirror_half(loop, half, g3_sign, scan) if first_open or last_open else None
    if other is not None:
        poles: tuple[Region, Region] = ("north", "south") if g3_sign > 0 else ("south", "north")
        first_open = first_open and other.last_pole == "passable" and has_one_limit(loop, poles[0])
        last_open = last_open and other.first_pole == "passable" and has_one_limit(loop, poles[1])
    if first_open and last_open and not breaks and other is not None and not other.zeros:
        return [Arc(loop, base, base + 2 * arb.pi(), None, None, half.slow + other.slow)]
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
    slow = half.slow + (other.slow if other else ())
    arcs = [
        Arc(loop, left.v, right.v, left.end, right.end, slow)
        for left, right, sign in zip(edges, edges[1:], signs, strict=False)
        if sign > 0
    ]
    isolated = [
        Arc(loop, at.v, at.v, at.end, at.end)
        for at, left, right in zip(breaks, signs, signs[1:], strict=False)
        if at.end in ("double", "flat") and left < 0 and right < 0
    ]
    return sorted(arcs + isolated, key=lambda arc: float(arc.lower))


def _mirror_half(loop: Loop, half: HalfLoop, g3_sign: int, scan: Callable[[Loop, int], HalfLoop]) -> HalfLoop:
    """Return the other half of the loop: the mirror image, to the last bit, if the formula is even there."""
    if half.slow or not is_even(loop):
        return scan(loop, -g3_sign)
    zeros = tuple(Zero(-zero.v, zero.kind) for zero in reversed(half.zeros))
    return HalfLoop(zeros, half.signs[::-1], half.last_pole, half.first_pole)


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
    v = zero.v
    with ctx.workprec(max(ctx.prec, v.bits() + 64)):
        turn = 2 * arb.pi()
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
