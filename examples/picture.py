"""A picture of a solution: γ and ω over time, and the path of γ on the unit sphere."""

from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np


def draw(columns: dict[str, list[float]], title: str, path: Path) -> None:
    """Draw the columns t, p, r, g1, g2, g3 into a PNG."""
    mpl.use("Agg")
    figure = plt.figure(figsize=(12, 5.2), layout="constrained")
    figure.suptitle(title)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.3, 1))
    upper = figure.add_subplot(grid[0, 0])
    lower = figure.add_subplot(grid[1, 0], sharex=upper)
    sphere = figure.add_subplot(grid[:, 1], projection="3d")
    for axes, names, label in ((upper, ("g1", "g2", "g3"), "γ"), (lower, ("p", "r"), "ω")):
        for name in names:
            axes.plot(columns["t"], columns[name], label=name)
        axes.set_ylabel(label)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        axes.grid(visible=True, alpha=0.3)
    lower.set_xlabel("t")
    _draw_path(sphere, columns)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _draw_path(axes: "plt.Axes", columns: dict[str, list[float]]) -> None:
    around, down = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 37), np.linspace(0.0, np.pi, 19))
    wires = (np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down))
    axes.plot_wireframe(*wires, color="grey", linewidth=0.3, alpha=0.5)
    axes.plot(columns["g1"], columns["g2"], columns["g3"], color="crimson", linewidth=2)
    axes.set_xlabel("g1")
    axes.set_ylabel("g2")
    axes.set_zlabel("g3")
    axes.set_box_aspect((1, 1, 1))
