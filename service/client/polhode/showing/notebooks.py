"""Output in notebooks: a table of facts, and a small picture of a path on the sphere."""

from collections.abc import Mapping
from html import escape

import numpy as np
from numpy.typing import NDArray

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


def sphere_svg(gamma: NDArray[np.float64]) -> str:
    """Return a picture of a path on the unit sphere, shape (n, 3); what is behind is pale."""
    across, up, towards = _axes()
    radius = _SIZE / 2 - 6

    def place(point: NDArray[np.float64]) -> str:
        return (
            f"{_SIZE / 2 + radius * float(point @ across):.1f},{_SIZE / 2 - radius * float(point @ up):.1f}"
        )

    lines = []
    is_front = gamma @ towards >= 0
    edges = np.flatnonzero(np.diff(is_front)) + 1
    for part in np.split(np.arange(len(gamma)), edges):
        # One point more on either side joins the pieces.
        points = " ".join(place(gamma[k]) for k in range(part[0], min(part[-1] + 2, len(gamma))))
        opacity = "1" if is_front[part[0]] else "0.3"
        lines.append(
            f"<polyline points='{points}' fill='none' stroke='#1f6feb' stroke-width='1.6'"
            f" opacity='{opacity}'/>"
        )
    axes = "".join(
        f"<line x1='{_SIZE / 2}' y1='{_SIZE / 2}' x2='{place(axis).partition(',')[0]}'"
        f" y2='{place(axis).partition(',')[2]}' stroke='#999' stroke-width='0.7'/>"
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


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 120 else f"{text[:117]}..."
