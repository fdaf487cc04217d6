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
_OUTPUTS = ["period", "gamma", "omega"]
_BASE: Mapping[str, object] = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": -1, "b": "1/20"}},
    "motion": {"type": "planar", "lambda": 1},
    "time": {"stop": 10, "samples": 101},
    "accuracy": {"tolerance": 1e-9},
}
_LINEAR = "1e-9"


def _axis(pointer: str, first: object, last: object) -> Mapping[str, object]:
    return {"pointer": pointer, "linspace": [first, last, 1000]}


_LAMBDA = {"pointer": "/motion/lambda", "linspace": ["6/10", 2, POINTS + WARM]}
_MOMENTS = {"pointer": "/body/A", "values": [f"{150 + k}/100" for k in range(50)]}
_POWERS = {"type": "homogeneous", "A": [0], "B": [-1], "C": ["1/20"]}


def points(effort: Effort) -> Table:
    """Return the processor time of a point of each kind, beside the one at 1e-9."""
    seconds = {name: _point(document, effort) for name, document in _sweeps().items()}
    rows = [(name, in_words(seconds[name]), f"{seconds[name] / seconds[_LINEAR]:.1f}×") for name in seconds]
    remark = "A = 2C, 101 samples to t = 10 unless the row says otherwise; along λ, in one process."
    return Table("What a point of a sweep costs", remark, ("sweep", "a point", "against 1e-9"), tuple(rows))


def _sweeps() -> dict[str, Mapping[str, object]]:
    return {
        _LINEAR: _sweep(),
        "draft": _sweep(accuracy={"tier": "draft"}),
        "standard": _sweep(accuracy={"tier": "standard"}),
        "high": _sweep(accuracy={"tier": "high"}),
        "1e-12": _sweep(accuracy={"tolerance": 1e-12}),
        "drifts kept": _sweep(("invariants.energy.drift",), outputs=[*_OUTPUTS, "invariants"]),
        "Kovalevskaya's integral kept": _sweep(
            ("invariants.kovalevskaya.drift",),
            outputs=[*_OUTPUTS, "invariants"],
            body={"A": 2, "B": 2, "C": 1},
            potential={"type": "gravity", "a": -1},
        ),
        "orientation kept": _sweep(("precession.psi1",), outputs=[*_OUTPUTS, "orientation"]),
        "stability kept": _sweep(("stability.trace",), outputs=[*_OUTPUTS, "stability"]),
        "without a motion": _sweep(potential={"type": "gravity", "a": 1}),
        "A alone": _sweep(axes=[_MOMENTS], potential=_POWERS),
        "A, and a thousand λ": _sweep(axes=[_MOMENTS, _axis("/motion/lambda", "6/10", 2)], potential=_POWERS),
        "a parameter under exp, and λ": _sweep(
            axes=[
                {"pointer": "/potential/parameters/k", "values": [1, "3/2", 2]},
                _axis("/motion/lambda", "6/10", 2),
            ],
            potential={
                "type": "expression",
                "expression": "b/g3^2 - exp(k)*g1",
                "parameters": {"k": 1, "b": "1/50"},
            },
        ),
        "from any state": _sweep(
            axes=[_axis("/motion/omega/0", "1/10", "9/10")],
            keep=("energy", "error"),
            motion={"type": "state", "omega": ["1/2", "1/10", 1], "gamma": ["3/5", 0, "4/5"]},
        ),
    }


def _sweep(
    more: tuple[str, ...] = (),
    *,
    axes: Sequence[Mapping[str, object]] = (_LAMBDA,),
    keep: tuple[str, ...] = _NUMBERS,
    **fields: object,
) -> Mapping[str, object]:
    return {"base": {**_BASE, **fields}, "axes": [*axes], "keep": [*keep, *more]}


def _point(document: Mapping[str, object], effort: Effort) -> float:
    """Return the processor seconds of a point, from as many as are solved in a second or two."""
    sweep = read_sweep(document, max_points=MOST)
    solver = ChunkSolver(make_plan(sweep))
    solver.solve(0, WARM, time.perf_counter() + 60.0)
    began, until = time.process_time(), time.perf_counter() + 0.2 * effort.repeats(10)
    found = solver.solve(WARM, min(POINTS, sweep.points - WARM), until)
    return (time.process_time() - began) / len(found.outcomes)
