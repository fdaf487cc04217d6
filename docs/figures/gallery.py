"""Draws the motions of docs/gallery.md: one picture for each problem in examples/.

Run it from the top folder of the repository: ``.venv/bin/python docs/figures/gallery.py``.
"""

import json
from decimal import ROUND_CEILING, Context
from pathlib import Path

from motions import draw_motion, use_files

from service.schemas.problem.problem import read_problem
from workers.computation.compute import solve
from workers.computation.outputs import InUnits, compute_outputs
from workers.solvers.units import Units

TOP = Path(__file__).parents[2]
PAGE = TOP / "docs" / "gallery.md"
SHOWN = {
    "first": """Back and forth
        Gravity along the first axis and a repelling wall at γ₃ = 0. γ crosses the equator, comes to rest on
        both sides and returns.""",
    "elliptic": """Three terms, by elliptic functions
        The period is an elliptic integral, and the six variables are Jacobi's functions of time.""",
    "rational": """The full rational potential
        All eight terms of the paper (that of a₃ with its sign corrected): an integral of higher genus, and
        still one integral.""",
    "homogeneous": """Homogeneous potentials
        Terms with fractional powers, for A = 3C: here the curves are |γ₃| = λ |γ₁|^(1/3).""",
    "general": """The general solution
        F(w) = exp(-w) and a polynomial G, A/C = 17/10. V itself is an integral that has no formula.""",
    "small-first-moment": """A < C
        The theorem does not need A > C; with A < C the first and the third axis change their parts.""",
    "bobylev-steklov": """Bobylev and Steklov, 1896
        The heavy body with A = 2C. p is constant, and γ passes both poles.""",
    "unstable": """The same, with B = 3
        B does not matter to a planar motion, but to its stability: here a small disturbance grows about
        sevenfold in each period.""",
    "collision": """A collision
        The potential attracts to γ₃ = 0 so strongly that a pole is reached in finite time. The picture ends
        shortly before.""",
    "state": """From any state
        q is not 0, and the theorem says nothing: the six equations are integrated.""",
}
"""The problems in examples/, each with a title and a text."""
INTRODUCTION = """# A gallery of motions

Each of these problems is a file in [examples/](../examples/); `polhode solve examples/NAME.json` runs it.
Left: the path of the vertical γ on the unit sphere, as the body sees it. Middle: the path of the angular
velocity ω in the body; the grey point is ω = 0. A red point is the start. Where the body has a moment B and
the motion a period, it is told whether the motion stays in its plane: it does, as far as linear equations
tell, where its multipliers have a sum between -2 and 2. Page and pictures are made by
`docs/figures/gallery.py`. The motions of the heavy body that are known by names are in [the classical
cases](classical.md).
"""
SAMPLES = 1200


def main() -> None:
    """Write docs/gallery.md, and docs/figures/gallery-NAME.png for each problem."""
    use_files()
    page = [INTRODUCTION]
    for name, said in SHOWN.items():
        title, _, text = said.partition("\n")
        page += [f"## {title}", "", f"`examples/{name}.json`. {' '.join(text.split())}", "", _draw(name), ""]
        page += [f"![γ on the sphere, ω in the body, and all six over time](figures/gallery-{name}.png)", ""]
    PAGE.write_text("\n".join(page))


def _draw(name: str) -> str:
    """Write the picture, and return the facts as a sentence."""
    document = json.loads((TOP / "examples" / f"{name}.json").read_text())
    document["time"]["samples"] = SAMPLES
    has_stability = document["motion"]["type"] == "planar" and "B" in document["body"]
    outputs = ["gamma", "omega", *(["stability"] if has_stability else [])]
    problem = read_problem({**document, "outputs": outputs, "method": "auto"})
    units = Units()
    posed = units.pose(problem)
    solved = solve(posed)
    draw_motion(f"gallery-{name}", solved.times, solved.samples)
    said = f"Error of the six variables: at most {_upwards(solved.error)}."
    if (period := solved.dense.period) is None:
        return said
    facts = f"Period {period.hi} ± {_upwards(abs(period.lo) + period.error)}. {said}"
    outputs_found = compute_outputs(problem, solved, InUnits(units, posed, solved, proven=None))
    if (stability := outputs_found.stability) is None:
        return facts
    stands = "marginal" if stability.verdict == "marginal" else f"linearly {stability.verdict}"
    trace = f"{stability.trace:.6f} ± {_upwards(stability.error + 5e-7)}"
    return f"{facts} It is {stands} against what leaves the plane: the multipliers have the sum {trace}."


def _upwards(bound: float) -> str:
    """Return a bound with one digit, which is rounded up."""
    return f"{Context(prec=1, rounding=ROUND_CEILING).create_decimal_from_float(bound):e}"


if __name__ == "__main__":
    main()
