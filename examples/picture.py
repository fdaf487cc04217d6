"""A picture of a solution: γ and ω over time, and the path of γ on the unit sphere.

Written as SVG by hand: the demonstration installs nothing that only draws.
"""

from collections.abc import Iterable, Sequence
from math import cos, pi, sin
from pathlib import Path

COLOURS = ("#1f77b4", "#ff7f0e", "#2ca02c")
WIDTH, HEIGHT = 1100, 480
TILT, TURN = 0.4, 0.6
"""Angles of the view of the sphere, in radians."""


def draw(columns: dict[str, list[float]], title: str, path: Path) -> None:
    """Draw the columns t, p, r, g1, g2, g3 into an SVG file."""
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/><text x="20" y="28">{title}</text>',
        *_over_time(columns, ("g1", "g2", "g3"), 50),
        *_over_time(columns, ("p", "r"), 265),
        *_on_sphere(list(zip(columns["g1"], columns["g2"], columns["g3"], strict=True))),
        "</svg>",
    ]
    path.write_text("\n".join(parts) + "\n", encoding="utf-8")


def _over_time(columns: dict[str, list[float]], names: Sequence[str], top: int) -> Iterable[str]:
    left, width, height = 60, 520, 180
    times, values = columns["t"], [value for name in names for value in columns[name]]
    low, high = min(values), max(values)
    span, duration = (high - low) or 1.0, (times[-1] - times[0]) or 1.0

    def place(t: float, value: float) -> tuple[float, float]:
        return left + width * (t - times[0]) / duration, top + height * (high - value) / span

    yield f'<rect x="{left}" y="{top}" width="{width}" height="{height}" fill="none" stroke="grey"/>'
    for value, y in ((high, top + 10), (low, top + height)):
        yield f'<text x="{left - 6}" y="{y}" font-size="11" text-anchor="end">{value:.3g}</text>'
    for number, (name, colour) in enumerate(zip(names, COLOURS, strict=False)):
        yield _line(map(place, times, columns[name]), colour, 1.6)
        yield f'<text x="{left + width + 8}" y="{top + 15 + 18 * number}" fill="{colour}">{name}</text>'


def _on_sphere(points: Sequence[tuple[float, float, float]]) -> Iterable[str]:
    around = [2 * pi * k / 72 for k in range(73)]
    for angle in (pi * k / 6 for k in range(1, 6)):
        yield _line(
            _seen([(sin(angle) * cos(a), sin(angle) * sin(a), cos(angle)) for a in around]), "#ccc", 0.6
        )
    for angle in (pi * k / 6 for k in range(6)):
        circle = [(sin(a) * cos(angle), sin(a) * sin(angle), cos(a)) for a in around]
        yield _line(_seen(circle), "#ccc", 0.6)
    yield _line(_seen(points), "crimson", 2.2)


def _seen(points: Iterable[tuple[float, float, float]]) -> Iterable[tuple[float, float]]:
    """Return where points of the sphere lie in the picture."""
    for x, y, z in points:
        across, away = x * cos(TURN) + y * sin(TURN), y * cos(TURN) - x * sin(TURN)
        yield 860 + 190 * across, 250 - 190 * (z * cos(TILT) - away * sin(TILT))


def _line(points: Iterable[tuple[float, float]], colour: str, width: float) -> str:
    places = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline points="{places}" fill="none" stroke="{colour}" stroke-width="{width}"/>'
