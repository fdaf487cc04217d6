"""What a point of a sweep costs, by what the sweep varies, keeps and asks for, in one process."""

import time
from collections.abc import Mapping, Sequence

from service.schemas.sweep.reading import read_sweep
from tests.benchmarks.measuring import Effort, Table, in_words
from workers.sweeping.chunk import ChunkSolver
from workers.sweeping.plan import make_plan

POINTS = 2000
WARM = 8
MOST = 100_000
_NUMBERS = ("period", "energy", "error")
OUTPUTS = ["period", "gamma", "omega"]
BASE: Mapping[str, object] = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": -1, "b": "1/20"}},
    "motion": {"type": "planar", "lambda": 1},
    "time": {"stop": 10, "samples": 101},
    "accuracy": {"tolerance": 1e-9},
}
_LINEAR = "1e-9"


def axis(pointer: str, first: object, last: object) -> Mapping[str, object]:
    return {"pointer": pointer, "linspace": [first, last, 1000]}


_LAMBDA = {"pointer": "/motion/lambda", "linspace": ["6/10", 2, POINTS + WARM]}
_MOMENTS = {"pointer": "/body/A", "values": [f"{150 + k}/100" for k in range(50)]}
_POWERS = {"type": "homogeneous", "A": [0], "B": [-1], "C": ["1/20"]}
_REPELLING = {"type": "homogeneous", "A": [0], "B": [1], "C": ["1/20"]}


def _drawn(pointer: str, first: object, last: object, seed: int) -> Mapping[str, object]:
    return {"pointer": pointer, "uniform": [first, last, 1000], "seed": seed}


def expression(text: str, **parameters: object) -> Mapping[str, object]:
    return {"type": "expression", "expression": text, "parameters": parameters}


def points(effort: Effort) -> Table:
    """Return the processor time of a point of each kind, beside the one at 1e-9."""
    seconds = {name: _point(document, effort) for name, document in sweeps().items()}
    rows = [(name, in_words(seconds[name]), f"{seconds[name] / seconds[_LINEAR]:.1f}×") for name in seconds]
    remark = "A = 2C, 101 samples to t = 10 unless the row says otherwise; along λ, in one process."
    return Table("What a point of a sweep costs", remark, ("sweep", "a point", "against 1e-9"), tuple(rows))


def sweeps() -> dict[str, Mapping[str, object]]:
    return {
        _LINEAR: sweep_of(),
        "draft": sweep_of(accuracy={"tier": "draft"}),
        "standard": sweep_of(accuracy={"tier": "standard"}),
        "high": sweep_of(accuracy={"tier": "high"}),
        "1e-12": sweep_of(accuracy={"tolerance": 1e-12}),
        "drifts kept": sweep_of(("invariants.energy.drift",), outputs=[*OUTPUTS, "invariants"]),
        "Kovalevskaya's integral kept": sweep_of(
            ("invariants.kovalevskaya.drift",),
            outputs=[*OUTPUTS, "invariants"],
            body={"A": 2, "B": 2, "C": 1},
            potential={"type": "gravity", "a": -1},
        ),
        "orientation kept": sweep_of(("precession.psi1",), outputs=[*OUTPUTS, "orientation"]),
        "stability kept": sweep_of(("stability.trace",), outputs=[*OUTPUTS, "stability"]),
        "without a motion": sweep_of(potential={"type": "gravity", "a": 1}),
        "A alone": sweep_of(axes=[axis("/body/A", "3/2", "5/2")], potential=_POWERS),
        "C alone": sweep_of(axes=[axis("/body/C", "7/10", "6/5")], potential=_POWERS),
        "A, C, a coefficient and λ, drawn": sweep_of(
            axes=[
                _drawn("/body/A", "17/10", "5/2", 1),
                _drawn("/body/C", "3/4", "5/4", 2),
                _drawn("/potential/B/0", -2, "-1/2", 3),
                _drawn("/motion/lambda", "6/10", 2, 4),
            ],
            combine="zip",
            potential=_POWERS,
        ),
        "A alone, refused: no motion": sweep_of(axes=[axis("/body/A", "3/2", "5/2")], potential=_REPELLING),
        "A alone, refused: inadmissible": sweep_of(
            axes=[axis("/body/A", "3/2", "19/10")], potential={"type": "gravity", "a": -1}
        ),
        "an exponent alone, refused": sweep_of(
            axes=[axis("/potential/parameters/k", "1/2", 3)],
            potential=expression("b/abs(g3)^k - g1", b=1, k=1),
        ),
        "an exponent and A": sweep_of(
            axes=[
                {"pointer": "/potential/parameters/k", "values": [1, 2, 3, 4, 5]},
                {"pointer": "/body/A", "linspace": ["7/4", "9/4", 90]},
            ],
            potential=expression(
                "-abs(g1)^(2*(A-C)/A) + c/abs(g3)^(2*(A-C)/C) + (A*g1^2 + C*g3^2)*g2^k/10", c="1/20", k=2
            ),
        ),
        "a parameter under exp alone": sweep_of(
            axes=[axis("/potential/parameters/k", 0, 1)],
            potential=expression("b/g3^2 - exp(k)*g1", b="1/50", k=1),
        ),
        "the end of the times": sweep_of(axes=[axis("/time/stop", 1, 20)]),
        "signs and λ": sweep_of(
            axes=[{"pointer": "/motion/g3_sign", "values": [1, -1]}, axis("/motion/lambda", "6/10", 2)],
            motion={"type": "planar", "lambda": 1, "g3_sign": 1},
        ),
        "A, and a thousand λ": sweep_of(
            axes=[_MOMENTS, axis("/motion/lambda", "6/10", 2)], potential=_POWERS
        ),
        "a parameter under exp, and λ": sweep_of(
            axes=[
                {"pointer": "/potential/parameters/k", "values": [1, "3/2", 2]},
                axis("/motion/lambda", "6/10", 2),
            ],
            potential=expression("b/g3^2 - exp(k)*g1", b="1/50", k=1),
        ),
        "from any state": sweep_of(
            axes=[axis("/motion/omega/0", "1/10", "9/10")],
            keep=("energy", "error"),
            motion={"type": "state", "omega": ["1/2", "1/10", 1], "gamma": ["3/5", 0, "4/5"]},
        ),
    }


def sweep_of(
    more: tuple[str, ...] = (),
    *,
    axes: Sequence[Mapping[str, object]] = (_LAMBDA,),
    keep: tuple[str, ...] = _NUMBERS,
    combine: str = "grid",
    **fields: object,
) -> Mapping[str, object]:
    return {"base": {**BASE, **fields}, "axes": [*axes], "combine": combine, "keep": [*keep, *more]}


def _point(document: Mapping[str, object], effort: Effort) -> float:
    """Return the processor seconds of a point, from as many as are solved in a second or two."""
    sweep = read_sweep(document, max_points=MOST)
    solver = ChunkSolver(make_plan(sweep))
    solver.solve(0, WARM, time.perf_counter() + 60.0)
    began, until = time.process_time(), time.perf_counter() + 0.2 * effort.repeats(10)
    found = solver.solve(WARM, min(POINTS, sweep.points - WARM), until)
    return (time.process_time() - began) / len(found.outcomes)
