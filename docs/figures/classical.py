"""Draws a picture of each classical case: the paths of the vertical and of omega, and all six over time.

Run it from the top folder of the repository: ``.venv/bin/python docs/figures/classical.py``.
"""

from motions import draw_motion, use_files

from service.catalogue import classical
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
    solved = solve(problem)
    draw_motion(f"classical-{case}", solved.times, solved.samples, title)


if __name__ == "__main__":
    main()
