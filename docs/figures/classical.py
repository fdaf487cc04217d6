"""Draws a picture of each classical case: the path of the vertical on the sphere, and of omega in the body.

Run it from the top folder of the repository: ``.venv/bin/python docs/figures/classical.py``.
"""

import matplotlib.pyplot as plt
from motions import path_in_body, path_on_sphere, save, use_files

from service.catalogue.classical import classical
from service.schemas.problem.problem import read_problem
from workers.computation.compute import solve

SAMPLES = 1500
APERIODIC = {"hess": 60, "staude": 1}
"""How long the cases that do not close are drawn."""


def main() -> None:
    """Write docs/figures/classical-CASE.png for every case that can be computed."""
    use_files()
    for row in classical():
        if row.example is not None:
            _draw(row.case, row.title, row.example)


def _draw(case: str, title: str, example: dict[str, object]) -> None:
    time = {"stop": APERIODIC[case]} if case in APERIODIC else {"periods": 1}
    problem = read_problem({**example, "time": {**time, "samples": SAMPLES}, "outputs": ["gamma", "omega"]})
    samples = solve(problem).samples
    figure = plt.figure(figsize=(8, 4))
    sphere = figure.add_subplot(1, 2, 1, projection="3d")
    path_on_sphere(sphere, samples[:, 3:])
    sphere.set_title("γ on the sphere", fontsize=10)
    body = figure.add_subplot(1, 2, 2, projection="3d")
    path_in_body(body, samples[:, :3])
    body.set_title("ω in the body", fontsize=10)
    figure.suptitle(title)
    figure.tight_layout()
    save(figure, f"classical-{case}")


if __name__ == "__main__":
    main()
