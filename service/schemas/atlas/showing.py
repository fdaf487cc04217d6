"""Shows an atlas: as text for people, as a picture (SVG), and as columns.

In the picture windows are bands of g2 over λ, and below them are energy and periods. The columns have a row
for each window and each λ at which it is followed.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import ceil, floor, isfinite, log10
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from service.schemas.atlas.documents import (
    AtlasOut,
    AtlasPartOut,
    AtlasSamplesOut,
    AtlasStabilityOut,
    AtlasWindowOut,
    ProofOut,
)
from service.schemas.replies.response_model import range_in_words


def describe_atlas(atlas: AtlasOut) -> str:
    """Return a line for each part, its windows below it, and for each change between them."""
    return "\n".join(_lines(atlas))


def _lines(atlas: AtlasOut) -> Iterator[str]:
    if atlas.verdict == "undecided":
        yield "the potential is neither proved admissible nor refuted; these motions are those it would have"
    told = [(part.lambda_[0], list(_part(part))) for part in atlas.parts]
    told += [
        (
            change.lambda_.value,
            [
                f"  at λ = {change.lambda_.value!r} ± {change.lambda_.error:.2g}: {KINDS[change.kind]}"
                f"{_seen(change.proof)}"
            ],
        )
        for change in atlas.changes
    ]
    told += [(low, [f"λ from {low:.12g} to {high:.12g}: not decided"]) for low, high in atlas.undecided]
    for _, lines in sorted(told, key=lambda each: each[0]):
        yield from lines


def _seen(proof: ProofOut) -> str:
    return " (seen at single λ, not proved)" if proof == "seen" else ""


def _part(part: AtlasPartOut) -> Iterator[str]:
    low, high = part.lambda_
    where = f"λ from {low:.12g} to {high:.12g}"
    if part.samples is None:
        reason = "" if part.reason is None else f": {part.reason.code}: {part.reason.detail}"
        yield f"{where}{reason}"
        return
    windows = part.samples.windows
    if not windows:
        yield f"{where}: no motion{_seen(part.proof)}"
        return
    count = "1 window" if len(windows) == 1 else f"{len(windows)} windows"
    yield f"{where}: {count}, energy {_range(part.samples.energy)}{_seen(part.proof)}"
    for window in windows:
        yield _window(window)


def _window(window: AtlasWindowOut) -> str:
    period = "" if window.period is None else f", period {_range(window.period)}"
    ends = range_in_words(window.ends)
    return f"  window {window.window}: {window.kind}, {ends}{period}{_stability(window.stability)}"


def _stability(stability: AtlasStabilityOut | None) -> str:
    """Return how many of the λ that were looked at have which verdict."""
    if stability is None:
        return ""
    found = Counter(verdict or "not known" for verdict in stability.verdict)
    return "".join(f", {verdict} at {count} of {found.total()} λ" for verdict, count in found.most_common())


def _range(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    return f"{min(known):.6g} to {max(known):.6g}" if known else "unknown"


WIDTH, LEFT, RIGHT, TOP, GAP = 860.0, 60.0, 20.0, 58.0, 36.0
HEIGHTS = (260.0, 120.0, 120.0, 120.0)
"""Heights of the panels: windows, energy, periods, and the trace of the multipliers if it was asked for."""
TRACES = (-4.0, 4.0)
"""Ends of the axis of traces: between -2 and 2 a motion is stable; what is beyond is drawn at the border."""
LOGARITHMIC = 10.0
"""Ratio of the ends of the range from which λ is drawn on a logarithmic axis."""
SAME = 4.0
"""So many errors apart, values may be the same: each is off, and the line between them is too."""
COLOURS = ("#3b6ea5", "#c7762b", "#4c8c4a", "#9b4f96", "#a33c3c", "#5f6b7a")
KINDS = {
    "window_appears": "a window appears",
    "window_vanishes": "a window vanishes",
    "windows_merge": "windows merge",
    "window_splits": "a window splits",
    "end_crosses_equator": "an end crosses the equator",
    "end_at_pole": "an end reaches or leaves a pole",
    "several": "several changes",
}
STYLE = (
    "text{font:12px system-ui,sans-serif;fill:#222}.title{font-size:14px;font-weight:600}"
    ".axis{stroke:#888;fill:none}.grid{stroke:#ddd}.change{stroke:#222;stroke-dasharray:4 3}"
    ".open{fill:#bbb;fill-opacity:.5}"
)


@dataclass(frozen=True, slots=True)
class _Axis:
    """Maps numbers to places on the picture."""

    low: float
    high: float
    start: float
    stop: float
    is_logarithmic: bool = False

    def at(self, value: float) -> float:
        low, high, x = (
            (log10(self.low), log10(self.high), log10(value))
            if self.is_logarithmic
            else (self.low, self.high, value)
        )
        return self.start + (self.stop - self.start) * (x - low) / (high - low)

    def ticks(self) -> list[float]:
        if self.is_logarithmic:
            powers = range(floor(log10(self.low)), ceil(log10(self.high)) + 1)
            found = [m * 10.0**power for power in powers for m in (1.0, 2.0, 5.0)]
        else:
            step = _round_step((self.high - self.low) / 5.0)
            found = [k * step for k in range(ceil(self.low / step), floor(self.high / step) + 1)]
        return [tick for tick in found if self.low <= tick <= self.high]


def _round_step(rough: float) -> float:
    power = 10.0 ** floor(log10(rough))
    return next(power * m for m in (1.0, 2.0, 5.0, 10.0) if power * m >= rough)


def picture_of(atlas: AtlasOut) -> str:
    """Return an SVG document."""
    low, high = atlas.lambda_
    across = _Axis(low, high, LEFT, WIDTH - RIGHT, high / low >= LOGARITHMIC)
    series = [part.samples for part in atlas.parts if part.samples is not None]
    curves = [_panel("energy", _energies(series), _error(series))]
    # Without a periodic window, or where periods were not asked for, there is nothing to draw.
    periods = _panel("period", _periods(series))
    if any(points for _, points in periods.curves):
        curves.append(periods)
    if any(window.stability is not None for samples in series for window in samples.windows):
        curves.append(_panel("μ + 1/μ: stable between -2 and 2", _traces(series), ends=TRACES))
    tops = [TOP + sum(HEIGHTS[:k]) + GAP * k for k in range(len(curves) + 1)]
    bottom = tops[-1] + HEIGHTS[len(curves)]
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {bottom + 44:g}" role="img">',
        f"<title>{escape(_summary(atlas))}</title><style>{STYLE}</style>",
        f'<rect width="{WIDTH:g}" height="{bottom + 44:g}" fill="#fff"/>',
        f'<text class="title" x="{LEFT:g}" y="24">{escape(_summary(atlas))}</text>',
    ]
    windows = _Axis(-1.0, 1.0, tops[0] + HEIGHTS[0], tops[0])
    lines += _frame(across, windows, "g2", is_last=False)
    for samples in series:
        for window in samples.windows:
            lines += _bands(across, windows, samples, window)
    for k, panel in enumerate(curves, 1):
        up = _Axis(*panel.ends, tops[k] + HEIGHTS[k], tops[k])
        lines += _frame(across, up, panel.name, is_last=k == len(curves))
        lines += [_curve(across, up, colour, points) for colour, points in panel.curves if len(points) > 1]
    lines += _marks(atlas, across, bottom)
    lines.append("</svg>")
    return "\n".join(lines) + "\n"


@dataclass(frozen=True, slots=True)
class _Panel:
    name: str
    curves: list[tuple[str, list[tuple[float, float]]]]
    ends: tuple[float, float]


def _panel(
    name: str, drawn: "Iterable[_Curve]", error: float = 0.0, ends: tuple[float, float] | None = None
) -> _Panel:
    curves = [(colour, list(points)) for colour, points in drawn]
    values = [y for _, points in curves for _, y in points]
    return _Panel(name, curves, _spread(values, error) if ends is None else ends)


def _summary(atlas: AtlasOut) -> str:
    low, high = atlas.lambda_
    count = len(atlas.changes)
    many = "no change" if count == 0 else "1 change" if count == 1 else f"{count} changes"
    rest = f", {len(atlas.undecided)} stretches undecided" if atlas.undecided else ""
    seen = ", seen and not proved" if any(part.proof == "seen" for part in atlas.parts) else ""
    return f"Windows of planar motions for λ from {low:g} to {high:g}: {many}{rest}{seen}"


def _frame(across: _Axis, up: _Axis, name: str, *, is_last: bool) -> Iterator[str]:
    for tick in up.ticks():
        y = up.at(tick)
        yield f'<line class="grid" x1="{LEFT:g}" x2="{WIDTH - RIGHT:g}" y1="{y:.1f}" y2="{y:.1f}"/>'
        yield f'<text x="{LEFT - 8:g}" y="{y + 4:.1f}" text-anchor="end">{tick:.4g}</text>'
    for tick in across.ticks():
        x = across.at(tick)
        yield f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{up.stop:.1f}" y2="{up.start:.1f}"/>'
        if is_last:
            yield f'<text x="{x:.1f}" y="{up.start + 18:.1f}" text-anchor="middle">{tick:.4g}</text>'
    if is_last:
        middle = 0.5 * (LEFT + WIDTH - RIGHT)
        yield f'<text x="{middle:g}" y="{up.start + 36:.1f}" text-anchor="middle">λ</text>'
    width, height = WIDTH - RIGHT - LEFT, up.start - up.stop
    yield f'<rect class="axis" x="{LEFT:g}" y="{up.stop:.1f}" width="{width:g}" height="{height:.1f}"/>'
    yield f'<text x="{LEFT:g}" y="{up.stop - 7:.1f}">{name}</text>'


def _bands(across: _Axis, up: _Axis, samples: AtlasSamplesOut, window: AtlasWindowOut) -> Iterator[str]:
    colour = COLOURS[window.window % len(COLOURS)]
    known = [
        (across.at(x), low, high)
        for x, low, high in zip(samples.lambda_, *window.g2, strict=True)
        if low is not None and high is not None
    ]
    if len(known) > 1:
        yield _band(up, colour, window, known)
        if window.has_mirror_image:
            yield _band(up, colour, window, [(x, -high, -low) for x, low, high in known])


def _band(up: _Axis, colour: str, window: AtlasWindowOut, known: Sequence[tuple[float, float, float]]) -> str:
    outline = [(x, up.at(high)) for x, _, high in known] + [(x, up.at(low)) for x, low, _ in known[::-1]]
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in outline)
    title = f"window {window.window}: {window.kind}, {range_in_words(window.ends)}"
    look = f'fill="{colour}" fill-opacity=".45" stroke="{colour}"'
    return f'<polygon points="{points}" {look}><title>{title}</title></polygon>'


_Curve = tuple[str, Iterable[tuple[float, float]]]


def _energies(series: Sequence[AtlasSamplesOut]) -> Iterator[_Curve]:
    for samples in series:
        # Where there is no motion there is no energy of one.
        if samples.windows:
            yield "#222", _known(samples.lambda_, samples.energy)


def _error(series: Sequence[AtlasSamplesOut]) -> float:
    """Return the largest error of an energy."""
    errors = [error for samples in series if samples.windows for error in samples.energy_error]
    return max((error for error in errors if error is not None), default=0.0)


def _periods(series: Sequence[AtlasSamplesOut]) -> Iterator[_Curve]:
    for samples in series:
        for window in samples.windows:
            if window.period is not None:
                yield COLOURS[window.window % len(COLOURS)], _known(samples.lambda_, window.period)


def _traces(series: Sequence[AtlasSamplesOut]) -> Iterator[_Curve]:
    for samples in series:
        for window in samples.windows:
            if window.stability is not None:
                colour = COLOURS[window.window % len(COLOURS)]
                yield colour, _known(samples.lambda_, window.stability.trace)


def _known(x: Sequence[float], y: Sequence[float | None]) -> list[tuple[float, float]]:
    return [(one, other) for one, other in zip(x, y, strict=True) if other is not None]


def _curve(across: _Axis, up: _Axis, colour: str, points: Sequence[tuple[float, float]]) -> str:
    places = " ".join(f"{across.at(x):.1f},{up.at(min(max(y, up.low), up.high)):.1f}" for x, y in points)
    return f'<polyline points="{places}" fill="none" stroke="{colour}" stroke-width="1.6"/>'


def _spread(values: Sequence[float], error: float) -> tuple[float, float]:
    """Return the ends of an axis: those of the values, without the highest few where they run away.

    Values that are the same within their ``error`` are drawn as a level line.
    """
    finite = sorted(value for value in values if isfinite(value))
    if not finite:
        return 0.0, 1.0
    low, high = finite[0], finite[-1]
    usual = finite[int(0.97 * (len(finite) - 1))]
    if usual > low and high - low > 4.0 * (usual - low):
        high = usual
    room = 0.05 * (high - low)
    if high - low <= SAME * error or not room:
        room = 0.05 * abs(high) if abs(high) > SAME * error else 1.0
    return low - room, high + room


def _marks(atlas: AtlasOut, across: _Axis, bottom: float) -> Iterator[str]:
    for low, high in atlas.undecided:
        x, width = across.at(low), max(across.at(high) - across.at(low), 1.0)
        title = f"not decided from {low:g} to {high:g}"
        yield (
            f'<rect class="open" x="{x:.1f}" y="{TOP:g}" width="{width:.1f}" height="{bottom - TOP:.1f}">'
            f"<title>{title}</title></rect>"
        )
    for row, change in enumerate(atlas.changes):
        x = across.at(change.lambda_.value)
        yield f'<line class="change" x1="{x:.1f}" x2="{x:.1f}" y1="{TOP:g}" y2="{bottom:.1f}"/>'
        side, off = ("end", -4.0) if x > 0.6 * WIDTH else ("start", 4.0)
        label = f"{KINDS[change.kind]}, λ = {change.lambda_.value:.6g}"
        yield f'<text x="{x + off:.1f}" y="{TOP + 16 + 16 * (row % 8):g}" text-anchor="{side}">{label}</text>'


FloatArray = NDArray[np.float64]

INTEGERS = ("part", "window")
NUMBERS = (
    "lambda",
    "energy",
    "energy_error",
    "g1_smallest",
    "g1_smallest_error",
    "g1_largest",
    "g1_largest_error",
    "g2_smallest",
    "g2_smallest_error",
    "g2_largest",
    "g2_largest_error",
    "period",
    "period_error",
)
WORDS = ("kind", "smallest_end", "largest_end", "proof")
"""The kind of the motion, the ends of the window where |g1| is smallest and largest, and whether the part is
proved or seen."""


def atlas_columns(atlas: AtlasOut) -> dict[str, NDArray[np.generic]]:
    """Return equally long columns; NaN where a number is not known."""
    rows = [
        (number, part, part.samples, window)
        for number, part in enumerate(atlas.parts)
        if part.samples is not None
        for window in part.samples.windows
    ]
    columns: dict[str, NDArray[np.generic]] = {
        "part": _joined([np.full(len(samples.lambda_), number) for number, _, samples, _ in rows], np.int64),
        "window": _joined(
            [np.full(len(samples.lambda_), window.window) for _, _, samples, window in rows], np.int64
        ),
    }
    numbers = [_numbers(samples, window) for _, _, samples, window in rows]
    for k, name in enumerate(NUMBERS):
        columns[name] = _joined([each[k] for each in numbers], np.float64)
    words = [
        (window.kind, *window.ends, part.proof) for _, part, samples, window in rows for _ in samples.lambda_
    ]
    for k, name in enumerate(WORDS):
        columns[name] = np.array([each[k] for each in words], dtype=np.str_)
    return columns


def _numbers(samples: AtlasSamplesOut, window: AtlasWindowOut) -> list[FloatArray]:
    nothing: list[float | None] = [None] * len(samples.lambda_)
    given: list[Sequence[float | None]] = [
        samples.lambda_,
        samples.energy,
        samples.energy_error,
        window.g1[0],
        window.g1_error[0],
        window.g1[1],
        window.g1_error[1],
        window.g2[0],
        window.g2_error[0],
        window.g2[1],
        window.g2_error[1],
        window.period or nothing,
        window.period_error or nothing,
    ]
    return [np.array([np.nan if value is None else value for value in values]) for values in given]


def _joined(parts: Sequence[NDArray[np.generic]], kind: type[np.generic]) -> NDArray[np.generic]:
    return np.concatenate(parts).astype(kind) if parts else np.array([], dtype=kind)
