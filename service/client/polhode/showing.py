"""Drawings of motions by matplotlib, tables and spheres in notebooks, and a progress bar."""

from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from polhode.evaluation import Samples, optional

if TYPE_CHECKING:
    from matplotlib.axes import Axes
import sys
import time
from collections.abc import Mapping
from html import escape

from polhode.transport.terms import Progress

FloatArray = NDArray[np.float64]

_FEW = 10
"""As many values of an axis are marked one by one."""
_NAMES = {"g1": "γ₁", "g2": "γ₂", "g3": "γ₃"}


def curves(samples: Samples, columns: Sequence[str], ax: "Axes | None") -> "Axes":
    """Draw columns over time."""
    ax = ax if ax is not None else _new_axes("plot()")
    for name in columns:
        ax.plot(samples.t, samples[name], label=_NAMES.get(name, name))
    ax.set_xlabel("t")
    ax.grid(visible=True, alpha=0.3)
    ax.legend(loc="best")
    return ax


def sphere(gamma: FloatArray, ax: "Axes | None") -> "Axes":
    """Draw a path on the unit sphere in three dimensions."""
    ax = ax if ax is not None else _new_axes("sphere()", projection="3d")
    across, along = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13))
    mesh = np.sin(along) * np.cos(across), np.sin(along) * np.sin(across), np.cos(along)
    ax.plot_wireframe(*mesh, color="0.8", linewidth=0.5)  # type: ignore[attr-defined]  # of axes in 3d
    ax.plot(*gamma.T, color="tab:blue")
    ax.set_aspect("equal")
    ax.set_xlabel("γ₁")
    ax.set_ylabel("γ₂")
    ax.set_zlabel("γ₃")  # type: ignore[attr-defined]  # of axes in 3d
    return ax


def heatmap(
    values: FloatArray, axes: Sequence[FloatArray], names: Sequence[str], title: str, ax: "Axes | None"
) -> "Axes":
    """Draw numbers on a grid as colours; points without a number stay empty."""
    ax = ax if ax is not None else _new_axes("heatmap()")
    # The axis with more values lies across.
    if len(axes[1]) < len(axes[0]):
        values, axes, names = values.T, axes[::-1], names[::-1]
    for values_of, set_ticks in ((axes[1], ax.set_xticks), (axes[0], ax.set_yticks)):
        if len(values_of) <= _FEW:
            set_ticks(values_of)
    down, across = (np.argsort(axis) for axis in axes)
    colours = np.ma.masked_invalid(values[np.ix_(down, across)])
    mesh = ax.pcolormesh(axes[1][across], axes[0][down], colours, shading="nearest")
    ax.figure.colorbar(mesh, ax=ax, label=title)
    ax.set_xlabel(names[1])
    ax.set_ylabel(names[0])
    return ax


def _new_axes(what: str, **options: str) -> "Axes":
    pyplot: ModuleType = optional("matplotlib.pyplot", what)
    figure = pyplot.figure()
    axes: Axes = figure.add_subplot(**options)
    return axes


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


def sphere_svg(gamma: NDArray[np.float64]) -> str:
    """Return a picture of a path on the unit sphere, shape (n, 3); what is behind is pale."""
    across, up, towards = _axes()
    radius = _SIZE / 2 - 6

    def position(point: NDArray[np.float64]) -> str:
        return (
            f"{_SIZE / 2 + radius * float(point @ across):.1f},{_SIZE / 2 - radius * float(point @ up):.1f}"
        )

    lines = []
    is_front = gamma @ towards >= 0
    edges = np.flatnonzero(np.diff(is_front)) + 1
    for part in np.split(np.arange(len(gamma)), edges):
        # One point more on either side joins the pieces.
        points = " ".join(position(gamma[k]) for k in range(part[0], min(part[-1] + 2, len(gamma))))
        opacity = "1" if is_front[part[0]] else "0.3"
        lines.append(
            f"<polyline points='{points}' fill='none' stroke='#1f6feb' stroke-width='1.6'"
            f" opacity='{opacity}'/>"
        )
    axes = "".join(
        f"<line x1='{_SIZE / 2}' y1='{_SIZE / 2}' x2='{position(axis).partition(',')[0]}'"
        f" y2='{position(axis).partition(',')[2]}' stroke='#999' stroke-width='0.7'/>"
        for axis in np.eye(3)
    )
    circle = f"<circle cx='{_SIZE / 2}' cy='{_SIZE / 2}' r='{radius}' fill='#8881' stroke='#888'/>"
    return (
        f"<svg width='{_SIZE}' height='{_SIZE}' viewBox='0 0 {_SIZE} {_SIZE}' role='img'"
        f" aria-label='path of the vertical on the unit sphere'>{circle}{axes}{''.join(lines)}</svg>"
    )


def _axes() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
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
