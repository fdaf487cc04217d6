"""Motions from any state beside one solve_ivp each, at an error that is not larger than ours."""

import json
import time
from collections.abc import Mapping, Sequence
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from service.dynamics.problem import Problem, StateMotion
from service.dynamics.sampling import sample_times
from service.schemas.problem.problem import read_problem
from service.schemas.sweep.reading import read_sweep
from tests.benchmarks.measuring import Effort, Table, in_words
from tests.workers.solvers.integration.cases import reference
from workers.computation.compute import solve_document
from workers.sweeping.chunk import ChunkSolver
from workers.sweeping.plan import make_plan

FloatArray = NDArray[np.float64]

POINTS = 1000
COMPARED = 5
"""Points whose errors are measured."""
RTOLS = (1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 3e-13, 1e-13, 3e-14, 2.3e-14)
"""The last one is about the least that SciPy takes."""
TIMES = 50
"""So many times faster than solve_ivp is asked."""
_TERMS = ((Fraction(-1), 1, 0, 0), (Fraction(1, 20), 0, 0, -2))
"""V = -g1 + 1/(20 g3²)."""
_BASE: Mapping[str, object] = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": -1, "b": "1/20"}},
    "motion": {"type": "state", "omega": ["1/2", "1/10", 1], "gamma": ["3/5", 0, "4/5"]},
    "time": {"stop": 10, "samples": 101},
}
_AXIS = {"pointer": "/motion/omega/0", "linspace": ["1/10", "9/10", POINTS]}
_COLLIDING: Mapping[str, object] = {
    **_BASE,
    "potential": {"type": "expression", "expression": "a*g1 - b/g3^2", "parameters": {"a": -1, "b": "1/20"}},
}
_KINDS = (
    ("solved, p(0) varies", _BASE, _AXIS, 1e-9, ""),
    (
        "solved, b varies",
        _BASE,
        {"pointer": "/potential/parameters/b", "linspace": ["1/30", "1/10", POINTS]},
        1e-9,
        "",
    ),
    ("solved, B varies", _BASE, {"pointer": "/body/B", "linspace": ["5/4", "7/4", POINTS]}, 1e-9, ""),
    ("an accuracy that is not met", _BASE, _AXIS, 1e-15, "≤ 2×"),
    (
        "a pole is met",
        _COLLIDING,
        {"pointer": "/motion/omega/0", "linspace": [1, 3, POINTS]},
        1e-9,
        "≤ 2×",
    ),
)
"""What happens to the points of a sweep, its base, its axis, its tolerance, and what is asked."""
_HEADS = ("tolerance", "a point", "error", "solve_ivp", "error", "faster", "a job", "a job, 1000 samples")


def states(effort: Effort) -> Table:
    """Return what a point of a sweep takes, and solve_ivp with DOP853 for the same motion."""
    tolerances = (1e-9,) if effort.is_quick else (1e-6, 1e-9, 1e-12)
    rows = tuple(_row(tolerance, effort) for tolerance in tolerances)
    remark = (
        "p(0) along an axis, 101 samples to t = 10, in one process. Errors are the largest of some points, "
        "against 64-bit significands; solve_ivp, its right-hand sides written out, has the loosest rtol "
        f"whose errors are not larger, or the finest there is. Asked: at least {TIMES} times faster."
    )
    return Table("Motions from any state, beside solve_ivp", remark, _HEADS, rows)


def kinds(effort: Effort) -> Table:
    """Return what points take whose potential or body varies, and what refusals take."""
    found = [_of_kind(base, axis, tolerance, effort) for _, base, axis, tolerance, _ in _KINDS]
    rows = tuple(
        (name, outcome, in_words(seconds), f"{seconds / found[0][0]:.1f}×", asked)
        for (name, _, _, _, asked), (seconds, outcome) in zip(_KINDS, found, strict=True)
    )
    remark = (
        f"{POINTS} points, 101 samples to t = 10, in one process, at a tolerance of 1e-9, or of 1e-15, "
        "which is not met; asked of a refused point: at most two solved ones."
    )
    heads = ("points", "outcome", "a point", "of a solved one", "asked")
    return Table("Motions from any state, by what varies and what is refused", remark, heads, rows)


def _of_kind(
    base: Mapping[str, object], axis: Mapping[str, object], tolerance: float, effort: Effort
) -> tuple[float, str]:
    document = {"base": {**base, "accuracy": {"tolerance": tolerance}}, "axes": [axis], "series": True}
    solver = ChunkSolver(make_plan(read_sweep(document, max_points=POINTS)))
    # The first solution compiles what is not compiled yet.
    outcomes = set(solver.solve(0, POINTS, time.perf_counter() + 600.0).outcomes)
    return min(_of_points(solver) for _ in range(effort.repeats(5))), ", ".join(sorted(outcomes))


def _row(tolerance: float, effort: Effort) -> tuple[str, ...]:
    base = {**_BASE, "accuracy": {"tolerance": tolerance}}
    document = {"base": base, "axes": [_AXIS], "keep": ["energy", "error"], "series": True}
    sweep = read_sweep(document, max_points=POINTS)
    solver = ChunkSolver(make_plan(sweep))
    places = np.linspace(0, POINTS - 1, COMPARED).astype(int).tolist()
    problems = [read_problem(sweep.document(place)) for place in places]
    exact = [_reference(problem) for problem in problems]
    found = solver.solve(0, POINTS, time.perf_counter() + 600.0)
    columns = [name for name in ("p", "q", "r", "g1", "g2", "g3") if name in sweep.series_columns]
    ours = max(
        float(np.abs(np.stack([found.series[name][place] for name in columns], axis=1) - truth).max())
        for place, truth in zip(places, exact, strict=True)
    )
    seconds, rival, error = np.inf, np.inf, np.inf
    for _ in range(effort.repeats(5)):
        # Side by side, so that both see the same machine.
        seconds = min(seconds, _of_points(solver))
        taken, error = _by_scipy(problems, exact, ours)
        rival = min(rival, taken)
    faster = rival / seconds
    told = f"{faster:.0f}×" if faster >= TIMES else f"**{faster:.0f}×, missed**"
    single, long = (_job({**base, "time": {"stop": 10, "samples": count}}, effort) for count in (101, 1000))
    return (
        f"{tolerance:.0e}",
        in_words(seconds),
        f"{ours:.1e}",
        in_words(rival),
        f"{error:.1e}",
        told,
        in_words(single),
        in_words(long),
    )


def _reference(problem: Problem) -> FloatArray:
    motion = problem.motion
    assert isinstance(motion, StateMotion)
    times = sample_times(problem.time, None).doubles
    return reference(problem.body, _TERMS, (*motion.omega, *motion.gamma), times)


def _of_points(solver: ChunkSolver) -> float:
    began = time.process_time()
    found = solver.solve(0, POINTS, time.perf_counter() + 600.0)
    return (time.process_time() - began) / len(found.outcomes)


def _by_scipy(
    problems: Sequence[Problem], exact: Sequence[FloatArray], allowed: float
) -> tuple[float, float]:
    """Return seconds a motion, and the largest error, at the loosest rtol that allows no larger one."""
    taken, error = np.inf, np.inf
    for rtol in RTOLS:
        began = time.process_time()
        solved = [_solve(problem, rtol) for problem in problems]
        taken = (time.process_time() - began) / len(problems)
        error = max(float(np.abs(one - truth).max()) for one, truth in zip(solved, exact, strict=True))
        if error <= allowed:
            break
    return taken, error


def _solve(problem: Problem, rtol: float) -> FloatArray:
    motion = problem.motion
    assert isinstance(motion, StateMotion)
    times = sample_times(problem.time, None).doubles
    start = [float(number) for number in (*motion.omega, *motion.gamma)]
    span = (0.0, float(times[-1]))
    solution = solve_ivp(_rates, span, start, method="DOP853", rtol=rtol, atol=rtol, t_eval=times)
    samples: FloatArray = solution.y.T
    return samples


def _rates(_time: float, state: FloatArray) -> list[float]:
    p, q, r, g1, g2, g3 = state.tolist()
    V1, V3 = -1.0, -0.1 / (g3 * g3 * g3)
    return [
        (0.5 * q * r + g2 * V3) / 2.0,
        (-p * r + g3 * V1 - g1 * V3) / 1.5,
        0.5 * p * q - g2 * V1,
        r * g2 - q * g3,
        p * g3 - r * g1,
        q * g1 - p * g2,
    ]


def _job(document: Mapping[str, object], effort: Effort) -> float:
    """Return the processor seconds of a whole job."""
    text = json.dumps(document)
    solve_document(text)
    taken = []
    for _ in range(effort.repeats(20)):
        began = time.process_time()
        solve_document(text)
        taken.append(time.process_time() - began)
    return min(taken)
