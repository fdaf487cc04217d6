"""What is true of a hostile problem: its windows, and one motion with its period, energy and states."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from flint import arb

from tests.support.hostile_curve import Curve, make_curve
from tests.support.hostile_features import Feature, exact
from tests.support.hostile_known import Document, Known
from tests.support.hostile_reference import Cuts, Stretch, UnknownError, cuts_of, sides_at, stretches_of
from tests.support.hostile_times import Timeline, half_round, timeline
from tests.support.hostile_ways import Way, ways_of
from tests.support.jets import Jet, Value, power, root

BITS = 192
TIME_DIGITS = 40
"""Digits after the point of the times that are asked."""


@dataclass(frozen=True, slots=True)
class TrueWindow:
    """A window as the service describes it, with balls."""

    kind: str
    ends: tuple[str, str]
    g1: tuple[float, float]
    g2: tuple[float, float]
    stretch: Stretch


@dataclass(frozen=True, slots=True)
class TrueMotion:
    """A motion."""

    document: Document
    """With window and start, without times and tier."""
    window: TrueWindow
    period: arb | None
    energy: arb
    times: tuple[str, ...]
    states: tuple[tuple[arb, ...], ...]
    """(p, q, r, g1, g2, g3) at the times."""
    collisions: tuple[arb | None, arb | None]
    """When it began and when it ends, at places where p² is infinite."""


@dataclass(frozen=True, slots=True)
class Setting:
    """A known potential on its curve, mirrored if A < C."""

    known: Known
    curve: Curve
    """The curve of p²."""
    energy: arb
    cuts: Cuts
    windows: tuple[TrueWindow, ...]

    @property
    def mirrored(self) -> bool:
        return self.known.A < self.known.C


def setting_of(known: Known) -> Setting:
    """Return the windows of a known potential, at the current precision.

    Raises
    ------
    UnknownError
        They could not be told.
    """
    signed = [level.signed(known.lambda_) for level in known.levels]
    mirrored = known.A < known.C
    A, C = (known.C, known.A) if mirrored else (known.A, known.C)
    first = known.b + sum(signed)
    b, c = (known.c, first) if mirrored else (first, known.c)
    size = exact(known.lambda_)
    size = size ** (-exact(known.A / known.C)) if mirrored else size

    def bounded(y: Value, sides: tuple[int, ...]) -> Value:
        total = arb(0) * y
        for a in reversed(known.powers):
            total = total * y + exact(a)
        for feature, side in zip(known.features, sides, strict=False):
            if feature.shape != "infinite":
                total = total + feature.value(y, side)
        for level, height in zip(known.levels, signed, strict=True):
            total = total - exact(height) / exact(known.C) / root(-4 * y * y + (exact(level.nu) ** 2 + 4), 2)
        return total

    def of_g2(y: Value, sides: tuple[int, ...]) -> Value:
        total = bounded(y, sides)
        for feature, side in zip(known.features, sides, strict=False):
            if feature.shape == "infinite":
                total = total + feature.value(y, side)
        return total

    def weight(y: Value, sides: tuple[int, ...], without: Feature | None = None) -> Value:
        product = arb(1)
        for feature, side in zip(known.features, sides, strict=False):
            if feature.shape == "infinite" and feature is not without:
                product = power(feature.distance(y, side), feature.power) * product
        return product

    def weighted(y: Value, sides: tuple[int, ...]) -> Value:
        total = bounded(y, sides) * weight(y, sides)
        for feature, side in zip(known.features, sides, strict=False):
            if feature.shape == "infinite":
                total = total + weight(y, sides, feature) * (exact(feature.height) * side**feature.power)
        return total

    def with_flat(y: Value, sides: tuple[int, ...]) -> Value:
        assert known.flat is not None
        return of_g2(y, sides) * known.flat.value(y)

    signs = make_curve(A, C, size, b, c, of_g2)
    if any(feature.shape == "infinite" for feature in known.features):
        signs = replace(signs, weighted=weighted, weight=weight)
    curve = signs if known.flat is None else make_curve(A, C, size, b, c, with_flat)
    cuts = cuts_of(curve, known.features)
    stretches = stretches_of(signs, known.features, cuts)
    if known.flat is not None:
        (flat,) = cuts_of(curve, [known.flat]).kinks
        stretches = _split(stretches, flat)
    return Setting(known, curve, _energy(known, first), cuts, _windows(known, curve, stretches))


def _split(stretches: Sequence[Stretch], at: arb) -> list[Stretch]:
    parts: list[Stretch] = []
    for stretch in stretches:
        if stretch.lower < at and stretch.upper > at:
            parts.append(Stretch(stretch.lower, at, stretch.lower_end, "flat"))
            parts.append(Stretch(at, stretch.upper, "flat", stretch.upper_end))
        elif stretch.upper < at or stretch.lower > at:
            parts.append(stretch)
        else:
            raise UnknownError("a zero beside the flat one")
    if not any(stretch.lower.overlaps(at) or stretch.upper.overlaps(at) for stretch in parts):
        # Nowhere to go from there: an equilibrium on its own.
        parts.append(Stretch(at, at, "flat", "flat"))
    return parts


_ENDS = {
    "rest": "rest",
    "passed": "pole",
    "approached": "pole",
    "collision": "pole",
    "flat": "equilibrium",
    "infinite": "collision",
}
_APERIODIC = ("separatrix", "pole")
_KINDS = {"collision": "collision", "infinite": "collision", "approached": "pole", "flat": "separatrix"}


def _windows(known: Known, curve: Curve, stretches: Sequence[Stretch]) -> tuple[TrueWindow, ...]:
    found = []
    for stretch in stretches:
        if known.is_even and not stretch.crosses_equator and stretch.lower + stretch.upper > arb.pi():
            # The mirror image of a northern one.
            continue
        ends = [(stretch.lower, stretch.lower_end), (stretch.upper, stretch.upper_end)]
        sizes = [(float(_g1(known, curve, v).mid()), _ENDS[end]) for v, end in ends]
        if stretch.crosses_equator:
            sizes = [min(sizes), (float(_g1(known, curve, arb.pi() / 2).mid()), "equator")]
        sizes.sort()
        kind = _kind(stretch)
        g2 = sorted(float(_g2(curve, v).mid()) for v, _ in ends)
        sign = known.g1_sign
        g1 = (sign * sizes[0][0], sign * sizes[1][0])
        found.append(TrueWindow(kind, (sizes[0][1], sizes[1][1]), g1, (g2[0], g2[1]), stretch))
    return tuple(sorted(found, key=lambda window: (round(abs(window.g1[1]), 12), -window.g2[1])))


def _kind(stretch: Stretch) -> str:
    if stretch.lower is stretch.upper:
        return "equilibrium"
    kinds = [_KINDS.get(end, "periodic") for end in (stretch.lower_end, stretch.upper_end)]
    return min(kinds, key=("collision", "separatrix", "pole", "periodic").index)


def _g2(curve: Curve, v: arb) -> arb:
    if v.contains(0) or v.contains(arb.pi()) or v.overlaps(arb.pi()):
        return arb(1) if v < 1 else arb(-1)
    return curve.g2(v)


def _g1(known: Known, curve: Curve, v: arb) -> arb:
    """Return |g1| of the body that is asked about."""
    if v.overlaps(arb.pi()) or v.overlaps(arb(0)):
        return arb(0)
    sine = v.sin()
    if known.A < known.C:
        return curve.Z * sine
    return curve.G * sine ** exact(known.A / known.C)


def motion_of(setting: Setting, draws: np.random.Generator) -> TrueMotion | None:
    """Return a motion in one of the windows from a random start; None if there is no window to move in.

    Raises
    ------
    UnknownError
        Its times could not be enclosed.
    """
    moving = [k for k, window in enumerate(setting.windows) if not _is_without_motion(window)]
    if not moving:
        return None
    index = moving[draws.integers(len(moving))]
    window, known, curve = setting.windows[index], setting.known, setting.curve
    stretch = window.stretch
    document = known.motion()
    if len(setting.windows) > 1:
        document["window"] = index
    v, start = _start(setting, stretch, draws)
    s_sign = 1 if draws.random() < 0.5 else -1
    document["start"] = {**start, "s_sign": s_sign}
    places = _places(setting, stretch, draws)
    line = timeline(curve, known.features, setting.cuts, stretch, [v, *places])
    passed = (stretch.lower_end == "passed", stretch.upper_end == "passed")
    half = half_round(line)
    period = None if half is None else half * (4 if passed[0] != passed[1] else 2)
    ways = ways_of(line, s_sign, passed, draws)
    states = []
    for way in ways:
        digits = round(Fraction(way.time.str(250, radius=False)) * 10**TIME_DIGITS)
        asked = Fraction(digits, 10**TIME_DIGITS)
        late = arb(abs(way.time - exact(asked)).abs_upper())
        states.append((_decimal(digits), _state(setting, way, late)))
    return TrueMotion(
        {**known.document(), "motion": document},
        window,
        period,
        setting.energy,
        tuple(time for time, _ in states),
        tuple(state for _, state in states),
        _collisions(line, stretch, s_sign),
    )


def _is_without_motion(window: TrueWindow) -> bool:
    return window.kind == "equilibrium" or "collision" in (window.stretch.lower_end, window.stretch.upper_end)


def _collisions(line: Timeline, stretch: Stretch, direction: int) -> tuple[arb | None, arb | None]:
    """Return when a motion that begins at the first place, with v growing or not, was and will be in one."""
    start, (first, last) = line.times[0], line.collisions
    # Upwards and downwards in v: to that end, or back from it to the other one.
    lower = arb(0) if stretch.lower_end in ("rest", "passed") else None
    up = last if line.end is None else None if first is None else 2 * line.end - first
    down = first if lower is None else None if last is None else -last
    up, down = (None if each is None else each - start for each in (up, down))
    return (down, up) if direction > 0 else tuple(None if x is None else -x for x in (up, down))


def _start(setting: Setting, stretch: Stretch, draws: np.random.Generator) -> tuple[arb, Document]:
    if stretch.crosses_equator and draws.random() < 0.4:
        return arb.pi() / 2, {"at": "equator"}
    known, curve = setting.known, setting.curve
    share = exact(Fraction(f"{draws.uniform(0.02, 0.98):.6f}"))
    wanted = stretch.lower + (stretch.upper - stretch.lower) * share
    g1 = Fraction(_g1(known, curve, wanted).str(60, radius=False))
    size = exact(g1)
    ratio = size / curve.Z if setting.mirrored else (size / curve.G) ** exact(known.C / known.A)
    v = ratio.asin()
    north = bool(wanted < arb.pi() / 2)
    v = v if north else arb.pi() - v
    if not (v > stretch.lower and v < stretch.upper):
        raise UnknownError("the start is not inside the window")
    return v, {"g1": str(known.g1_sign * g1), "g2_sign": 1 if north else -1}


def _places(setting: Setting, stretch: Stretch, draws: np.random.Generator) -> list[arb]:
    """Return places all over the stretch, and about those of the features inside it."""
    shares = list(draws.uniform(0.001, 0.999, 4))
    found = [stretch.lower + (stretch.upper - stretch.lower) * arb(share) for share in shares]
    inside = [v for v in setting.cuts.places if v > stretch.lower and v < stretch.upper]
    if inside:
        found += [arb(inside[draws.integers(len(inside))].mid()) for _ in range(2)]
    return found


def _decimal(digits: int) -> str:
    sign, digits = ("-" if digits < 0 else ""), abs(digits)
    text = f"{digits:0{TIME_DIGITS + 1}d}"
    return f"{sign}{text[:-TIME_DIGITS]}.{text[-TIME_DIGITS:]}"


def _state(setting: Setting, way: Way, late: arb) -> tuple[arb, ...]:
    """Return the six variables at a place, widened by what they change in the time ``late``."""
    known, curve, v = setting.known, setting.curve, way.v
    signs = (known.g3_sign, known.g1_sign) if setting.mirrored else (known.g1_sign, known.g3_sign)
    sides = sides_at(curve, known.features, arb(v.mid()))
    square = curve.p_squared_at(Jet(v, arb(1)), sides)
    size = square.value.sqrt()
    g3 = signs[1] * way.flip * curve.Z * v.sin()
    g1 = signs[0] * curve.G * v.sin() ** exact(Fraction(curve.n, curve.m))
    # s > 0 where g2 falls.
    p = -signs[1] * way.flip * way.direction * size
    r = -curve.A * g1 * p / (curve.C * g3)
    steep = 1 + abs(r / p) + abs(g1 / g3)
    # dp/dt = (dp²/dv) c/(2Z); what the others do is of the size of p and r. Ten times that is plenty.
    speed = 10 * steep * (1 + abs(square.slope) / curve.Z + abs(p) + abs(r))
    wide = arb(0, (speed * late).abs_upper())
    p, r, g1, g2, g3 = (x + wide for x in (p, r, g1, curve.g2(v), g3))
    if setting.mirrored:
        return (-r, arb(0), -p, g3, g2, g1)
    return (p, arb(0), r, g1, g2, g3)


def _energy(known: Known, b: Fraction) -> arb:
    """Return H = −bλ²/α − cαλ^(−2α)."""
    alpha, size = exact(known.A / known.C), exact(known.lambda_)
    return -exact(b) * size**2 / alpha - exact(known.c) * alpha * size ** (-2 * alpha)
