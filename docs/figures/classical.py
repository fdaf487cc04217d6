"""Draws a picture of each classical case: the path of the vertical on the sphere, and of omega in the body.

Run it from the top folder of the repository: ``.venv/bin/python docs/figures/classical.py``.
"""

from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from service.catalogue.classical import classical
from service.schemas.problem.problem import read_problem
from workers.computation.compute import solve

FOLDER = Path(__file__).parent
SAMPLES = 1500
APERIODIC = {"hess": 60, "staude": 1}
"""How long the cases that do not close are drawn."""


def main() -> None:
    """Write docs/figures/classical-CASE.png for every case that can be computed."""
    mpl.use("Agg")
    mpl.rcParams["savefig.dpi"] = 80
    for row in classical():
        if row.example is not None:
            _draw(row.case, row.title, row.example)


def _draw(case: str, title: str, example: dict[str, object]) -> None:
    time = {"stop": APERIODIC[case]} if case in APERIODIC else {"periods": 1}
    problem = read_problem({**example, "time": {**time, "samples": SAMPLES}, "outputs": ["gamma", "omega"]})
    samples = solve(problem).samples
    figure = plt.figure(figsize=(8, 4))
    _path(figure, 1, samples[:, 3:], "γ on the sphere", is_on_sphere=True)
    _path(figure, 2, samples[:, :3], "ω in the body", is_on_sphere=False)
    figure.suptitle(title)
    figure.tight_layout()
    # Without the version of the library the same motion gives the same file.
    figure.savefig(FOLDER / f"classical-{case}.png", metadata={"Software": None})
    plt.close(figure)


def _path(figure: plt.Figure, place: int, points: np.ndarray, label: str, *, is_on_sphere: bool) -> None:
    axes = figure.add_subplot(1, 2, place, projection="3d")
    if is_on_sphere:
        across, up = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13))
        sphere = np.cos(across) * np.sin(up), np.sin(across) * np.sin(up), np.cos(up)
        axes.plot_wireframe(*sphere, color="lightgrey", linewidth=0.4)
    else:
        axes.scatter(0, 0, 0, color="grey", s=12)
    axes.plot(*points.T, color="tab:blue", linewidth=1.2)
    axes.scatter(*points[0], color="tab:red", s=18)
    axes.set_box_aspect((1, 1, 1))
    axes.set_title(label, fontsize=10)
    axes.tick_params(labelsize=6)


if __name__ == "__main__":
    main()
