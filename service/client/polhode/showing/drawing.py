"""Pictures by matplotlib, which is loaded when the first one is asked for."""

from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from polhode.evaluation.samples import Samples, optional

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
