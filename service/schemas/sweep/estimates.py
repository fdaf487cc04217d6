"""Estimates of what problems and sweeps cost before anything of them is computed.

No number here is a bound. The seconds of a single job are those of the installation's accuracy table. What a
point of a sweep costs where many go together is measured on the developers' machine (``python -m
tests.benchmarks estimates`` holds it against the truth) and scaled by the ratio of the tables. Seconds are
those of one worker that does nothing else: two workers need half of them.
"""

import math
import statistics
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

from service.dynamics.accuracy import (
    CERTIFIED_BITS,
    AccuracyTable,
    Expected,
    Family,
    MotionKind,
    expected,
    family_of,
)
from service.dynamics.equations.orientation import PRECESSION, QUATERNION
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.parameters import coefficients_of
from service.dynamics.formula.parser import parse
from service.dynamics.motion import columns_of
from service.dynamics.problem import ClassicalMotion, PlanarMotion, Problem, StateMotion, TimePeriods
from service.dynamics.verdict.proofs.power_sums import is_power_sum
from service.schemas.problem.problem import kind_of
from service.schemas.reading.documents import Part
from service.schemas.sweep.sweep import Sweep

SAMPLED = 5
"""Points of a sweep that are examined for its estimate."""
MOST_SLOW = 20
"""Reasons in an answer."""

REQUEST_SECONDS = 6e-3
"""Part of a row's seconds that is the request, the queue and the database, not the motion."""
LISTED_SECONDS = 1.5e-3
"""The same part of one problem of a list."""
LEAST_SECONDS = 6e-4
"""Seconds of the cheapest job alone."""
BLOCK_SECONDS = 4.5e-5
"""Seconds of a point with three terms at the tiers draft and standard, where points go in blocks."""
REFUSED_SECONDS = 1.6e-5
"""Seconds of a point without a motion there."""
OTHER_FAMILY = 2.0
"""Factor of potentials that have not just three terms."""
HIGH_SECONDS: Mapping[Family, float] = {"three-term": 8.5e-5, "rational": 5.5e-4}
"""Seconds of a point at the tier high, by family; others take HIGH_OTHERS."""
HIGH_OTHERS = 4e-4
VARYING_SECONDS = 1.1e-4
"""Seconds of a point whose body or exponent is its own."""
SLICE_SECONDS = 1e-2
"""Seconds for the verdict and the plan of the points with the same window, sign, body or exponent."""
STABILITY_SECONDS, PRECESSION_SECONDS, DRIFT_SECONDS = 3.5e-4, 4e-5, 1e-5
"""Further seconds of a point with these outputs, in blocks."""
SERIES_SECONDS = 4e-8
"""Seconds of a number in a series."""
TIMES_SECONDS = 7e-5
"""Further seconds of a point with times or a start of its own."""
STATE_SECONDS, STATE_UNIT_SECONDS = 4e-5, 1.8e-5
"""Seconds of a point from any state, and of a unit of phase that it is integrated over."""
PROVEN_UNIT_SECONDS, PROVEN_POWER, PROVEN_TURNING = 1.1e-2, 1.3, 3.0
"""Seconds of a unit of phase in proven steps of 64 bits; their power of the bits; so many with attitude."""
TABLE_PHASE = 16.0
"""Phase, about, of the motion from a state that the accuracy table has."""
LONG_PHASE, MOST_LONG = 50.0, 3.5
"""Errors grow with time: a unit of a phase of 50 takes twice as long, at most 3.5 times."""
BY_QUADRATURE, BY_BOTH = 3e-2, 1.1e-2
"""Seconds of a job by the method quadrature, and further ones by the method both."""
ATTITUDE_SECONDS, TRACE_SECONDS = 1.5e-2, 2e-2
"""Further seconds of a job with orientation, or with stability."""
UNKNOWN_VERDICT_SECONDS = 5e-3
"""Seconds of a verdict that no child has found."""

USUAL_KIND: MotionKind = "rest to equator"
"""The kind that stands for a planar point whose window is not known."""

NUMBER_BYTES, SERIES_BYTES = 5.5, 4.4
"""Stored bytes of a kept number of a point, and of a number of a series or of samples."""
JOB_BYTES, FUNCTION_BYTES = 4000, 6000
"""Stored bytes of a job and its solution without arrays, and of its function of time."""
UNIT_BYTES = 3000
"""Stored bytes of the function of time of a motion from any state, for a unit of phase."""

Way = Literal["blocks", "bodies", "states", "alone"]
"""The ways of points: in blocks of one body, of many bodies or exponents, from any state, one by one."""


@dataclass(frozen=True, slots=True)
class ExaminedPoint:
    """The outcome of the examination of a problem."""

    window: Part | None
    """The window of its planar motion; None for other motions."""
    seconds: float
    """Seconds that a child took for its verdict; 0 if it was known."""
    is_refused: bool = False
    """Whether it has no motion, or none that is proved."""


UNEXAMINED = ExaminedPoint(None, UNKNOWN_VERDICT_SECONDS)
"""Stands for a problem whose examination has not ended in time."""


@dataclass(frozen=True, slots=True)
class SlowReason:
    """A part of a document that makes it slow."""

    pointer: str
    why: str


@dataclass(frozen=True, slots=True)
class CostEstimate:
    """The expected cost of a sweep, a problem or a list."""

    points: int
    tier: str | None
    """None for a list whose problems have different ones."""
    seconds: float
    """Seconds of one worker."""
    bytes: int
    """Stored bytes."""
    slow: tuple[SlowReason, ...]


def scale_of(table: AccuracyTable, shipped: AccuracyTable) -> float:
    """Return how many times slower than the developers' machine the one of ``table`` is, by common rows."""
    theirs = {(row.tier, row.kind, row.family): row.seconds for row in shipped.rows}
    ratios = [
        row.seconds / theirs[key] for row in table.rows if (key := (row.tier, row.kind, row.family)) in theirs
    ]
    return statistics.median(ratios) if ratios else 1.0


def job_seconds(problem: Problem, found: ExaminedPoint, table: AccuracyTable, scale: float) -> float:
    """Return the seconds of a job alone, without its verdict, its request and its storing."""
    kind, family = _kind(problem, found), family_of(problem.body, problem.potential)
    seconds = LEAST_SECONDS
    known = expected(table, problem.accuracy.tier, problem.time.samples, kind, family)
    if isinstance(known, Expected):
        seconds = max(
            seconds, known.seconds - _unneeded(problem, kind, family, table) - REQUEST_SECONDS * scale
        )
    further = 0.0
    if isinstance(problem.motion, PlanarMotion) and problem.method != "auto":
        further = {"quadrature": BY_QUADRATURE, "both": BY_BOTH}.get(problem.method, 0.0)
    if "orientation" in problem.outputs:
        further += ATTITUDE_SECONDS
    if "stability" in problem.outputs:
        further += TRACE_SECONDS
    if kind == "any state":
        further += _state_seconds(problem)
    return seconds + further * scale


def estimate_of_jobs(
    problems: Mapping[int | None, tuple[Problem, ExaminedPoint]], table: AccuracyTable, shipped: AccuracyTable
) -> CostEstimate:
    """Return the estimate of a list, by the indices of its problems, or of the problem at None."""
    scale, slow = scale_of(table, shipped), list[SlowReason]()
    around = (REQUEST_SECONDS if None in problems else LISTED_SECONDS) * scale
    seconds = stored = 0.0
    for index, (problem, found) in problems.items():
        alone = job_seconds(problem, found, table, scale)
        seconds += around + alone
        stored += _job_bytes(problem)
        if alone > REQUEST_SECONDS * scale and len(slow) < MOST_SLOW:
            place = "" if index is None else f"/{index}"
            slow += [SlowReason(place + each.pointer, each.why) for each in _slow_parts(problem, found)]
    tiers = {problem.accuracy.tier for problem, _ in problems.values()}
    tier = next(iter(tiers)) if len(tiers) == 1 else None
    return CostEstimate(len(problems), tier, seconds, round(stored), tuple(slow[:MOST_SLOW]))


def sampled_points(sweep: Sweep) -> tuple[int, ...]:
    """Return the points that stand for all of a sweep: its ends, and others evenly between."""
    last = sweep.points - 1
    return tuple(dict.fromkeys(last * k // (SAMPLED - 1) for k in range(SAMPLED)))


def estimate_of_sweep(
    sweep: Sweep,
    sampled: Sequence[tuple[Problem, ExaminedPoint]],
    table: AccuracyTable,
    shipped: AccuracyTable,
) -> CostEstimate:
    """Return the estimate of a sweep from the examination of some of its points.

    ``sampled`` has those of :func:`sampled_points` that are problems; a point that is none costs nothing.
    """
    scale, problem = scale_of(table, shipped), sweep.first_problem
    plan = _plan(sweep)
    each = [_point_seconds(sweep, plan, point, found, table, scale) for point, found in sampled]
    count = max(1, len(sampled_points(sweep)))
    seconds = sweep.points * sum(each) / count + plan.slices * SLICE_SECONDS * scale
    solved = sweep.points * sum(not found.is_refused for _, found in sampled) / count
    stored = NUMBER_BYTES * len(sweep.keep) + SERIES_BYTES * sweep.samples * len(sweep.series_columns)
    slow = list(plan.slow)
    if plan.way == "alone" or any(_is_aperiodic(point, found) for point, found in sampled):
        motion = next((found for point, found in sampled if _is_aperiodic(point, found)), UNEXAMINED)
        slow += [SlowReason(f"/base{part.pointer}", part.why) for part in _slow_parts(problem, motion)]
    if sweep.series_columns and SERIES_SECONDS * sweep.samples * len(sweep.series_columns) > BLOCK_SECONDS:
        slow.append(SlowReason("/series", "the samples of every point are computed and stored"))
    return CostEstimate(
        sweep.points,
        problem.accuracy.tier,
        seconds,
        round(solved * stored),
        tuple(dict.fromkeys(slow))[:MOST_SLOW],
    )


@dataclass(frozen=True, slots=True)
class _Plan:
    """The way of the points of a sweep, as far as its document tells it."""

    way: Way
    slices: int
    """Groups of points that have a verdict of their own, beside the first."""
    has_verdicts: bool
    """Whether every point that goes alone has its own verdict."""
    slow: tuple[SlowReason, ...]


def _plan(sweep: Sweep) -> _Plan:
    problem, slow = sweep.first_problem, list[SlowReason]()
    if sweep.are_states:
        if _phase(problem) > LONG_PHASE / 2:
            slow.append(
                SlowReason(
                    "/base/time", "the errors of an integration grow with time, and its steps with them"
                )
            )
        return _Plan("states", 0, has_verdicts=False, slow=tuple(slow))
    varies = [axis.varies for axis in sweep.axes]
    is_planar = isinstance(problem.motion, PlanarMotion)
    has_verdicts = is_planar and any(each in ("potential", "body") for each in varies)
    if not is_planar or not _is_quick(sweep):
        return _Plan("alone", 0, has_verdicts, _slow_axes(sweep, {"other": _ALONE}))
    if "other" in varies:
        return _Plan("alone", 0, has_verdicts, _slow_axes(sweep, {"other": _ALONE}))
    is_linear = "body" not in varies and _is_linear(sweep)
    why = {"time": _TIMES, "start": _START, "sign": _SLICE}
    if is_linear:
        return _Plan("blocks", _slices(sweep, "sign"), has_verdicts=False, slow=_slow_axes(sweep, why))
    if is_power_sum(problem.body, problem.potential):
        why["body"] = _BODY
        return _Plan("bodies", _slices(sweep, "sign"), has_verdicts=True, slow=_slow_axes(sweep, why))
    outer = _slices(sweep, "sign", "body", "potential")
    why |= {"body": _VERDICT, "potential": _VERDICT}
    if outer < sweep.points:
        return _Plan("blocks", outer, has_verdicts=True, slow=_slow_axes(sweep, why))
    return _Plan("alone", 0, has_verdicts=True, slow=_slow_axes(sweep, why))


_ALONE = "points that differ in it are solved one by one"
_TIMES = "every point has times of its own"
_START = "every point has a start of its own"
_SLICE = "every value makes a part of the sweep with a verdict of its own"
_BODY = "every point has a body of its own"
_VERDICT = "no proof holds for all of its values: each has a verdict of its own"


def _slow_axes(sweep: Sweep, why: Mapping[str, str]) -> tuple[SlowReason, ...]:
    return tuple(
        SlowReason(f"/axes/{place}", why[axis.varies])
        for place, axis in enumerate(sweep.axes)
        if axis.varies in why
    )


def _slices(sweep: Sweep, *kinds: str) -> int:
    """Return how many combinations of values axes of these kinds have; 0 if there are none."""
    lengths = [axis.axis.length for axis in sweep.axes if axis.varies in kinds]
    if not lengths:
        return 0
    return math.prod(lengths) if sweep.combine == "grid" else max(lengths)


def _is_quick(sweep: Sweep) -> bool:
    """Tell whether the method, the accuracy and the outputs are those of blocks."""
    problem, tier = sweep.first_problem, sweep.first_problem.accuracy.tier
    return (
        problem.method == "auto"
        and problem.accuracy.budget_seconds is None
        and tier != "certified"
        and sweep.has_block_outputs(by_doubles=tier in ("draft", "standard"))
        and family_of(problem.body, problem.potential) != "integral"
    )


def _is_linear(sweep: Sweep) -> bool:
    """Tell whether the potential is a polynomial in the numbers that vary, as far as formulas show."""
    potential: Part = sweep.base["potential"]  # type: ignore[assignment]
    names = [
        axis.path[2] for axis in sweep.axes if axis.varies == "potential" and axis.path[1] == "parameters"
    ]
    if not names:
        return True
    texts = [potential[name] for name in ("expression", "F", "G") if isinstance(potential.get(name), str)]
    with suppress(DynamicsError):
        return all(coefficients_of(parse(text), names) is not None for text in texts)
    return False


def _point_seconds(
    sweep: Sweep, plan: _Plan, problem: Problem, found: ExaminedPoint, table: AccuracyTable, scale: float
) -> float:
    """Return the seconds of a point that was examined."""
    verdict = found.seconds if plan.has_verdicts else 0.0
    if plan.way == "states":
        return scale * (_state_seconds(problem) + _series(sweep))
    if plan.way == "alone" or _is_aperiodic(problem, found):
        return verdict + job_seconds(problem, found, table, scale)
    if found.is_refused:
        return REFUSED_SECONDS * scale
    family = family_of(problem.body, problem.potential)
    if plan.way == "bodies":
        seconds = VARYING_SECONDS
    elif problem.accuracy.tier == "high":
        seconds = HIGH_SECONDS.get(family, HIGH_OTHERS)
    else:
        seconds = BLOCK_SECONDS * (1.0 if family in ("three-term", "function") else OTHER_FAMILY)
    varies = {axis.varies for axis in sweep.axes}
    seconds += TIMES_SECONDS * len(varies & {"time", "start"})
    if "stability" in problem.outputs:
        seconds += STABILITY_SECONDS
    if "orientation" in problem.outputs:
        seconds += PRECESSION_SECONDS
    if "invariants" in problem.outputs:
        seconds += DRIFT_SECONDS
    return scale * (seconds + _series(sweep))


def _series(sweep: Sweep) -> float:
    return SERIES_SECONDS * sweep.samples * len(sweep.series_columns)


def _kind(problem: Problem, found: ExaminedPoint) -> MotionKind:
    if isinstance(problem.motion, ClassicalMotion):
        return "aperiodic"  # it is a curve with one quadrature, like a motion that is not periodic
    if isinstance(problem.motion, PlanarMotion) and found.window is None:
        return USUAL_KIND
    return kind_of(problem, found.window)


def _is_aperiodic(problem: Problem, found: ExaminedPoint) -> bool:
    is_known = found.window is not None and isinstance(problem.motion, PlanarMotion)
    return is_known and _kind(problem, found) == "aperiodic"


def _unneeded(problem: Problem, kind: MotionKind, family: Family, table: AccuracyTable) -> float:
    """Return the seconds that a row of 1000 samples has for those beyond the asked ones."""
    missing = 1.0 - min(1.0, problem.time.samples / 1000)
    more = expected(table, problem.accuracy.tier, 2000, kind, family)
    one = expected(table, problem.accuracy.tier, 1000, kind, family)
    if not (isinstance(more, Expected) and isinstance(one, Expected)):
        return 0.0
    return missing * min(more.seconds - one.seconds, one.seconds)


def _phase(problem: Problem) -> float:
    """Return the asked time in units of the motion: of its angular velocity where that is above 1."""
    time, rate = problem.time, 1.0
    if isinstance(problem.motion, StateMotion):
        rate = max(1.0, math.hypot(*map(float, problem.motion.omega)))
    if isinstance(time, TimePeriods):
        return float(time.periods) * 2.0 * math.pi
    times = getattr(time, "times", None) or (time.start, time.stop)  # type: ignore[union-attr]
    return rate * max(abs(float(t)) for t in times)


def _state_seconds(problem: Problem) -> float:
    phase = _phase(problem)
    if problem.accuracy.tier == "certified":
        each = PROVEN_UNIT_SECONDS * (problem.accuracy.bits / CERTIFIED_BITS[0]) ** PROVEN_POWER
        each *= PROVEN_TURNING if "orientation" in problem.outputs else 1.0
        return float(each * max(0.0, phase - TABLE_PHASE))
    return STATE_SECONDS + STATE_UNIT_SECONDS * phase * min(1.0 + phase / LONG_PHASE, MOST_LONG)


def _job_bytes(problem: Problem) -> float:
    columns = ["t", *columns_of(problem.outputs)]
    if "orientation" in problem.outputs:
        columns += [*QUATERNION, *PRECESSION]
    function = FUNCTION_BYTES
    if isinstance(problem.motion, StateMotion) or problem.method == "integration":
        function = round(max(FUNCTION_BYTES, UNIT_BYTES * _phase(problem)))
    return JOB_BYTES + function + SERIES_BYTES * problem.time.samples * len(columns)


def _slow_parts(problem: Problem, found: ExaminedPoint) -> Iterator[SlowReason]:
    """Yield what makes a job slower than the quickest ones."""
    if problem.accuracy.tier == "certified":
        yield SlowReason("/accuracy", "every sample is enclosed in a proven radius")
    if problem.method in ("quadrature", "both") and isinstance(problem.motion, PlanarMotion):
        yield SlowReason("/method", f"the method {problem.method} has no compiled code for all of it")
    if isinstance(problem.motion, StateMotion) and _phase(problem) > LONG_PHASE:
        yield SlowReason("/time", "the errors of an integration grow with time, and its steps with them")
    if "orientation" in problem.outputs or "stability" in problem.outputs:
        yield SlowReason("/outputs", "orientation and stability are computed besides, along the whole motion")
    if problem.time.samples > 10_000:
        yield SlowReason("/time/samples", "every sample is computed and stored")
    if _is_aperiodic(problem, found) or isinstance(problem.motion, ClassicalMotion):
        yield SlowReason(
            "/motion", "the motion is not periodic: its samples are computed one after the other"
        )
    if family_of(problem.body, problem.potential) == "integral":
        yield SlowReason("/potential", "F or G has no closed form: the potential itself is an integral")
