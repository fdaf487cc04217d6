"""Tables and spheres in notebooks, and a progress bar."""

import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from polhode.transport.terms import Progress

FloatArray = NDArray[np.float64]

_SIZE = 160
_VIEW = np.array([0.48, 0.62, 0.62])
"""The direction from which the sphere is seen: all three axes are in front."""


def table_html(title: str, facts: Mapping[str, object], picture: str = "") -> str:
    """Return HTML with a title, a row for each fact, and a picture beside them."""
    rows = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th>"
        f"<td style='text-align:left'>{escape(_short(value))}</td></tr>"
        for name, value in facts.items()
    )
    table = f"<table><caption style='text-align:left'><b>{escape(title)}</b></caption>{rows}</table>"
    return f"<div style='display:flex;gap:1em;align-items:center'>{table}{picture}</div>"


def rows_html(title: str, columns: Sequence[str], rows: Sequence[Mapping[str, object]]) -> str:
    """Return an HTML table with a row for each of ``rows``."""
    head = "".join(f"<th style='text-align:left'>{escape(name)}</th>" for name in columns)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(_cell(row.get(name)))}</td>' for name in columns)}</tr>" for row in rows
    )
    caption = f"<caption style='text-align:left'><b>{escape(title)}</b></caption>"
    return f"<table>{caption}<tr>{head}</tr>{body}</table>"


def sphere_svg(gamma: FloatArray) -> str:
    """Return a picture of a path on the unit sphere, shape (n, 3); what is behind is pale."""
    radius = _SIZE / 2 - 6

    def positions(points: FloatArray) -> Iterator[str]:
        return (f"{_SIZE / 2 + radius * x:.1f},{_SIZE / 2 - radius * y:.1f}" for x, y in points.tolist())

    lines = [
        f"<polyline points='{' '.join(positions(points))}' fill='none' stroke='#1f6feb' stroke-width='1.6'"
        f" opacity='{'1' if is_front else '0.3'}'/>"
        for points, is_front in sphere_parts(gamma)
    ]
    ends = (end.split(",") for end in positions(seen(np.eye(3))))
    axes = "".join(
        f"<line x1='{_SIZE / 2}' y1='{_SIZE / 2}' x2='{x}' y2='{y}' stroke='#999' stroke-width='0.7'/>"
        for x, y in ends
    )
    circle = f"<circle cx='{_SIZE / 2}' cy='{_SIZE / 2}' r='{radius}' fill='#8881' stroke='#888'/>"
    return (
        f"<svg width='{_SIZE}' height='{_SIZE}' viewBox='0 0 {_SIZE} {_SIZE}' role='img'"
        f" aria-label='path of the vertical on the unit sphere'>{circle}{axes}{''.join(lines)}</svg>"
    )


def sphere_parts(gamma: FloatArray) -> Iterator[tuple[FloatArray, bool]]:
    """Yield the parts of a path on the sphere, shape (n, 3), as they are seen, and whether in front."""
    flat, is_front = seen(gamma), gamma @ _view()[2] >= 0
    edges = np.flatnonzero(np.diff(is_front)) + 1
    for part in np.split(np.arange(len(gamma)), edges):
        # One point more joins it to the next.
        yield flat[part[0] : part[-1] + 2], bool(is_front[part[0]])


def seen(points: FloatArray) -> FloatArray:
    """Return points of space as they are seen from where all three axes are in front, shape (n, 2)."""
    across, up, _ = _view()
    return points @ np.stack([across, up], axis=-1)


def _view() -> tuple[FloatArray, FloatArray, FloatArray]:
    towards = _VIEW / np.linalg.norm(_VIEW)
    across = np.cross(np.array([0.0, 0.0, 1.0]), towards)
    across /= np.linalg.norm(across)
    return across, np.cross(towards, across), towards


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.10g}" if isinstance(value, float) else _short(value)


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 120 else f"{text[:117]}..."


_WIDTH = 30
_LEAST_SECONDS = 0.2
"""Between two drawings, and before the first: what is over at once needs no bar."""


class Bar:
    """Draws how far something is on one line of stderr."""

    def __init__(self) -> None:
        self._began: float | None = None
        self._first, self._drawn, self._is_shown = 0, 0.0, False

    def __call__(self, progress: Progress) -> None:
        """Draw it, at most five times a second."""
        now = time.monotonic()
        if self._began is None:
            self._began, self._first, self._drawn = now, progress.done, now
        if progress.is_over:
            if self._is_shown:
                sys.stderr.write(f"\r{self._line(progress, now)}\n")
            # Ready for the next one.
            self._began, self._is_shown = None, False
        elif now - self._drawn > _LEAST_SECONDS:
            self._drawn, self._is_shown = now, True
            sys.stderr.write(f"\r{self._line(progress, now)}")
            sys.stderr.flush()

    def _line(self, progress: Progress, now: float) -> str:
        share = progress.done / max(progress.total, 1)
        bar = "█" * int(share * _WIDTH)
        seconds = now - (self._began or now)
        rate = (progress.done - self._first) / seconds if seconds > 0 else 0.0
        rest = progress.remaining_seconds
        if rest is None and rate > 0:
            rest = (progress.total - progress.done) / rate
        left = "" if rest is None or progress.is_over else f", {_span(rest)} left"
        done = f"{progress.done:,} of {progress.total:,} {progress.what}"
        return f"{bar:<{_WIDTH}} {share:4.0%} {done}, {rate:,.0f}/s{left}   "


def is_watched() -> bool:
    """Tell whether somebody sees what is written to stderr: on a terminal, or in a notebook."""
    return "ipykernel" in sys.modules or (sys.stderr is not None and sys.stderr.isatty())


def _span(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
