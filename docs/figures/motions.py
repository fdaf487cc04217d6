"""Drawings of motions for the documentation: paths on the sphere and in the body."""

from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

FOLDER = Path(__file__).parent
START_COLOUR = "tab:red"


def use_files() -> None:
    """Draw into files, without a window."""
    mpl.use("Agg")
    mpl.rcParams["savefig.dpi"] = 80


def save(figure: Figure, name: str) -> None:
    """Write docs/figures/NAME.png; without the version of the library the same figure gives the same file."""
    figure.savefig(FOLDER / f"{name}.png", metadata={"Software": None})
    plt.close(figure)


def draw_motion(name: str, times: np.ndarray, samples: np.ndarray, title: str | None = None) -> None:
    """Write docs/figures/NAME.png: both paths, and the six variables (n, 6) at the times (n,)."""
    figure = plt.figure(figsize=(11, 3.6), layout="constrained")
    grid = figure.add_gridspec(2, 3)
    sphere = figure.add_subplot(grid[:, 0], projection="3d")
    path_on_sphere(sphere, samples[:, 3:])
    sphere.set_title("γ on the sphere", fontsize=10)
    body = figure.add_subplot(grid[:, 1], projection="3d")
    path_in_body(body, samples[:, :3])
    body.set_title("ω in the body", fontsize=10)
    for row, (names, first) in enumerate((("γ₁ γ₂ γ₃", 3), ("p q r", 0))):
        axes = figure.add_subplot(grid[row, 2])
        for place, label in enumerate(names.split()):
            axes.plot(times, samples[:, first + place], label=label, linewidth=1)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
        axes.tick_params(labelsize=7)
        axes.grid(visible=True, alpha=0.3)
    axes.set_xlabel("t", fontsize=8)
    if title:
        figure.suptitle(title)
    save(figure, name)


def path_on_sphere(axes: Axes3D, points: np.ndarray, **style: object) -> None:
    """Draw points (n, 3) as a path on the unit sphere, with a mark where it starts."""
    across, up = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13))
    sphere = np.cos(across) * np.sin(up), np.sin(across) * np.sin(up), np.cos(up)
    axes.plot_wireframe(*sphere, color="lightgrey", linewidth=0.4)
    axes.set_axis_off()
    _path(axes, points, **style)
    axes.set_box_aspect((1, 1, 1), zoom=1.35)


def path_in_body(axes: Axes3D, points: np.ndarray, **style: object) -> None:
    """Draw points (n, 3) as a path about the fixed point."""
    axes.scatter(0, 0, 0, color="grey", s=12)
    _path(axes, points, **style)


def _path(axes: Axes3D, points: np.ndarray, **style: object) -> None:
    axes.plot(*points.T, **{"color": "tab:blue", "linewidth": 1.2, **style})
    axes.scatter(*points[0], color=START_COLOUR, s=18)
    axes.set_box_aspect((1, 1, 1))
    axes.tick_params(labelsize=6)
