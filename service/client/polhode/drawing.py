"""Pictures by matplotlib: curves, spheres and heat maps, a figure, an animation; what notebooks show.

Notebooks show tables and spheres, and a progress bar.
"""

import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from polhode.errors import WrongArgumentError
from polhode.evaluation import FloatArray, Samples, optional
from polhode.transport.terms import Progress

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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


_FEW = 10
"""As many values of an axis are marked one by one."""
_LABEL_HEIGHT = 0.17
"""Height of a line of text, as a share of one of the two axes with curves."""
_UNIT_OF_TIME = r"$\sqrt{\mathrm{moment}\,/\,\mathrm{potential}}$"
"""Nothing is converted: times are in the unit that those of the problem make."""


def label_of(name: str) -> str:
    """Return a column's name as it is printed."""
    return rf"$\gamma_{name[1]}$" if name in ("g1", "g2", "g3") else f"${name}$" if len(name) == 1 else name


def curves(samples: Samples, columns: Sequence[str], ax: "Axes | None") -> "Axes":
    """Draw columns over time."""
    ax = ax if ax is not None else _new_axes("plot()")
    for name in columns:
        ax.plot(samples.t, samples[name], label=label_of(name))
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


def figure(samples: Samples, period: float | None, file: str | os.PathLike[str] | None) -> "Figure":
    """Draw a motion for a paper: γ and ω over time, labelled beside the curves, and the path on the sphere.

    Raises
    ------
    WrongArgumentError
        The name of the file ends in nothing that is a picture.
    """
    drawn = _figure(samples, period)
    if file is not None:
        formats = drawn.canvas.get_supported_filetypes()
        if Path(file).suffix.removeprefix(".") not in formats:
            raise WrongArgumentError(
                f"{os.fspath(file)}: names that end in .{', .'.join(formats)} are accepted"
            )
        drawn.savefig(file)
    return drawn


def _figure(samples: Samples, period: float | None) -> "Figure":
    optional("matplotlib.pyplot", "figure()")  # notebooks show figures once it is there
    kind: type[Figure] = optional("matplotlib.figure", "figure()").Figure
    drawn = kind(figsize=(7.2, 3.4), layout="constrained")
    grid = drawn.add_gridspec(2, 2, width_ratios=(1.6, 1.0))
    upper, lower, right = (drawn.add_subplot(place) for place in (grid[0, 0], grid[1, 0], grid[:, 1]))
    for ax, names, title in (
        (upper, ("g1", "g2", "g3"), r"vertical $\gamma$"),
        (lower, ("p", "q", "r"), r"angular velocity"),
    ):
        # In a planar motion q is 0 for ever.
        shown = [name for name in names if name != "q" or samples[name].any()]
        for k, name in enumerate(shown):
            ax.plot(samples.t, samples[name], linewidth=1.2, color=f"C{k}")
        ax.set_ylabel(title)
        ax.margins(x=0)
        ax.spines[["right", "top"]].set_visible(False)
        _label_beside(ax, {name: float(samples[name][-1]) for name in shown})
    upper.tick_params(labelbottom=False)
    lower.set_xlabel(f"time $t$ in {_UNIT_OF_TIME}")
    if period is not None:
        turns = upper.secondary_xaxis("top", functions=(_scaled(1.0 / period), _scaled(period)))
        turns.set_xlabel("periods $t/T$")
    _clean_sphere(right, samples.gamma)
    return drawn


def _scaled(factor: float) -> Callable[[ArrayLike], FloatArray]:
    return lambda times: factor * np.asarray(times, dtype=np.float64)


def _label_beside(ax: "Axes", ends: Mapping[str, float]) -> None:
    """Write the names of the curves beside their ends, apart from each other, in their colours."""
    low, high = ax.get_ylim()
    places = {name: (end - low) / (high - low) for name, end in ends.items()}
    lowest = 0.0
    for name in sorted(places, key=places.__getitem__):
        places[name] = max(places[name], lowest)
        lowest = places[name] + _LABEL_HEIGHT
    excess = max(0.0, lowest - _LABEL_HEIGHT - 1.0)
    for k, (name, place) in enumerate(places.items()):
        where = (1.02, place - excess)
        ax.annotate(label_of(name), where, xycoords="axes fraction", color=f"C{k}", va="center")


def _clean_sphere(ax: "Axes", gamma: FloatArray) -> None:
    """Draw the path of the vertical on the unit sphere, seen from the body; what is behind is pale."""
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    cosine, sine, zero = np.cos(turn), np.sin(turn), np.zeros_like(turn)
    ax.plot(cosine, sine, color="0.5", linewidth=0.8)
    for circle in ((cosine, sine, zero), (cosine, zero, sine), (zero, cosine, sine)):
        for points, is_front in sphere_parts(np.stack(circle, axis=-1)):
            ax.plot(*points.T, color="0.7", linewidth=0.5, linestyle="-" if is_front else ":")
    for k, end in enumerate(seen(np.eye(3))):
        ax.annotate("", xy=1.25 * end, xytext=end, arrowprops={"arrowstyle": "->", "color": "0.4", "lw": 0.8})
        ax.annotate(rf"$\gamma_{k + 1}$", xy=1.36 * end, ha="center", va="center")
    for points, is_front in sphere_parts(gamma):
        ax.plot(*points.T, color="tab:blue", linewidth=1.4, alpha=1.0 if is_front else 0.35)
    ax.set_aspect("equal")
    ax.set_axis_off()


@dataclass(frozen=True, slots=True)
class Animation:
    """An animation that notebooks show.

    Parameters
    ----------
    html
        With all frames in it, and buttons to play them.
    """

    html: str

    def _repr_html_(self) -> str:
        return self.html


def animation(
    samples: Samples, period: float | None, file: str | os.PathLike[str] | None, frames: int, seconds: float
) -> Path | Animation:
    """Draw :func:`figure` with the vertical and the time moving on.

    Raises
    ------
    WrongArgumentError
        The name of the file ends in none of .gif, .mp4 and .html; or there is no ffmpeg for .mp4.
    """
    module: ModuleType = optional("matplotlib.animation", "animate()")
    suffix = None if file is None else Path(file).suffix.lower()
    accepted = [".gif", ".html", *([".mp4"] if module.writers.is_available("ffmpeg") else [])]
    if suffix not in (None, *accepted):
        why = (
            "MP4 needs ffmpeg, which is not on the PATH"
            if suffix == ".mp4"
            else f"{suffix!r} is no animation"
        )
        raise WrongArgumentError(f"{why}; files that end in {', '.join(accepted)} are accepted")
    drawn = _figure(samples, period)
    upper, lower, right = drawn.axes[:3]
    flat = seen(samples.gamma)
    (point,) = right.plot(*flat[:1].T, "o", color="tab:red", markersize=5)
    cursors = [ax.axvline(float(samples.t[0]), color="tab:red", linewidth=0.8) for ax in (upper, lower)]
    # All curves closed: the last sample is the first one again.
    chosen = np.linspace(0, len(samples), frames, endpoint=False).astype(int)

    def show(k: int) -> "Sequence[object]":
        point.set_data(*flat[k : k + 1].T)
        for cursor in cursors:
            cursor.set_xdata([samples.t[k]] * 2)
        return (point, *cursors)

    rate = frames / seconds
    # The layout is found once: it would tremble from frame to frame.
    drawn.draw_without_rendering()
    drawn.set_layout_engine("none")
    film = module.FuncAnimation(drawn, show, frames=chosen.tolist(), interval=1000.0 / rate)
    if file is None or suffix == ".html":
        html = film.to_jshtml(fps=rate)
        if file is None:
            return Animation(html)
        Path(file).write_text(html, encoding="utf-8")
    else:
        film.save(file, writer=module.PillowWriter(rate) if suffix == ".gif" else module.FFMpegWriter(rate))
    return Path(file)
