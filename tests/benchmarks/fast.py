"""Targets 1 to 4 and 9: one motion in compiled doubles against integrators."""

from fractions import Fraction

import numpy as np

from tests.benchmarks.measuring import Effort, Result, Row, clock, faster, in_turns, median
from tests.benchmarks.motions import (
    FloatArray,
    Measured,
    elliptic,
    librations,
    near_separatrix,
    taylor_of_elliptic,
)
from workers.solvers.choose import enclose
from workers.solvers.compiled.solve import Tier

STEPS = (1e-7, 1e-8, 1e-9, 1e-10, 3e-11, 1e-11, 3e-12, 1e-12, 3e-13, 1e-13, 3e-14)
WANTED = 1e-10
MANY, FEWER = 100_000, 10_000
GAPS = ("1/2", "1/1000", "1/1000000", "1/1000000000", "1/1000000000000")
STRIDE = 9
"""Distance of the samples, of 1000, that are compared where the reference is an integral."""


def against_scipy(effort: Effort) -> list[Row]:
    """Target 1: 1000 samples to 1e-10 against DOP853 at the loosest rtol that reaches it."""
    rows = [_against_scipy(1, elliptic(), 10, 300, "standard", effort)]
    if not effort.is_quick:
        rows.append(_against_scipy(1, elliptic(), 100, 3000, "high", effort))
    return rows


def general_alpha(effort: Effort) -> list[Row]:
    """Target 9: the same for other ratios of the moments."""
    motions = librations()[-1:] if effort.is_quick else librations()
    return [_against_scipy(9, motion, 10, 100, "standard", effort, STRIDE) for motion in motions]


def _against_scipy(
    target: int, motion: Measured, periods: int, ratio: float, tier: Tier, effort: Effort, stride: int = 1
) -> Row:
    grid, state = motion.grid(0, periods), motion.state()
    found = motion.solved(tier)
    error = motion.error(grid, found.sample(grid), stride)
    seconds = median(lambda: motion.solved(tier).sample(grid), effort.repeats(25))
    rtol = _loosest(motion, state, grid, stride)
    began = clock()
    theirs = motion.by_scipy(state, grid, rtol)
    theirs_seconds = clock() - began
    ours = Result(f"tier {tier}", seconds, error, f"claimed {found.error_at(grid):.0e}")
    their_error = motion.error(grid, theirs, stride)
    rival = Result(
        f"DOP853 {rtol:.0e}", theirs_seconds, their_error, "its best" if their_error > WANTED else ""
    )
    return faster(target, f"{motion.name}, 1000 samples, {periods} periods", ratio, WANTED, ours, rival)


def _loosest(motion: Measured, state: FloatArray, grid: FloatArray, stride: int) -> float:
    """Return the loosest rtol that reaches the wanted error, by bisection; the tightest if none does."""
    first, last = 0, len(STEPS) - 1
    while first < last:
        middle = (first + last) // 2
        if motion.error(grid, motion.by_scipy(state, grid, STEPS[middle]), stride) <= WANTED:
            last = middle
        else:
            first = middle + 1
    return STEPS[last]


def against_heyoka(effort: Effort) -> list[Row]:
    """Target 2: the last of 1e5 periods against heyoka at 1e-16, which must pass the others."""
    motion = elliptic()
    grid = motion.grid(MANY - 1, MANY)
    found = motion.solved("high")
    seconds = median(lambda: motion.solved("high").sample(grid), effort.repeats(25))
    reached = FEWER if effort.is_quick else MANY
    end = motion.grid(reached - 1, reached)[-1:]
    integrator = taylor_of_elliptic(motion.state(), 1e-16)
    began = clock()
    integrator.propagate_until(float(end[0]))
    theirs = (clock() - began) * MANY / reached
    claimed = f"claimed {found.error_at(grid):.0e}"
    ours = Result("tier high", seconds, motion.error(grid, found.sample(grid)), claimed)
    remark = "one state" + (f", from {reached:,} periods" if reached != MANY else "")
    rival = Result("heyoka 1e-16", theirs, motion.error(end, np.array([integrator.state])), remark)
    proven, seconds = _proven_state(motion, grid[-1:], effort)
    one = Result("certified, 64 bits, one state", seconds, motion.error(grid[-1:], proven), "rounded")
    return [
        faster(2, f"1000 samples of the last of {MANY:,} periods", 10_000, 1e-15, ours, rival),
        faster(2, f"the state after {MANY:,} periods", 10_000, 1e-15, one, rival),
    ]


def _proven_state(motion: Measured, time_: FloatArray, effort: Effort) -> tuple[FloatArray, float]:
    """Return the six variables at one time, the midpoints of enclosures, and the seconds they take."""
    exact = [Fraction(float(time_[0]))]

    def state() -> FloatArray:
        found = enclose(motion.body, motion.potential, motion.motion, exact, 64)
        return np.array([[float(value) for value in row] for row in found.states])

    return state(), median(state, effort.repeats(25))


def any_time(effort: Effort) -> list[Row]:
    """Target 3: 1e8 periods cost what 10 do."""
    motion = elliptic()
    near, late = motion.grid(0, 10), motion.grid(10**8 - 10, 10**8)
    seconds = in_turns(
        (lambda: motion.solved("high").sample(near), lambda: motion.solved("high").sample(late)),
        effort.repeats(101),
    )
    found = motion.solved("high")
    first, last = (
        Result(name, took, motion.error(grid, found.sample(grid)), f"claimed {found.error_at(grid):.0e}")
        for name, took, grid in zip(("periods 0 to 10", "the last 10"), seconds, (near, late), strict=True)
    )
    ratio = last.seconds / first.seconds
    is_reached = ratio <= 1.2 and last.error <= 2e-15
    reached = f"{ratio:.2f}×, {last.error:.1e}"
    return [Row(3, "10 of 1e8 periods", "≤ 1.2× the first 10, ≤ 2e-15", reached, is_reached, last, first)]


def near_the_separatrix(effort: Effort) -> list[Row]:
    """Target 4: the cost of a gap of 1e-12."""
    gaps = (GAPS[0], GAPS[-1]) if effort.is_quick else GAPS
    results = []
    for gap in gaps:
        motion = near_separatrix(Fraction(gap))
        grid, found = motion.grid(0, 10), motion.solved("high")
        seconds = median(lambda: motion.solved("high").sample(grid), effort.repeats(25))  # noqa: B023
        error = motion.error(grid, found.sample(grid))
        results.append(Result(motion.name, seconds, error, f"{len(found.panels)} panels"))
    rows = []
    for result in results[1:]:
        ratio = result.seconds / results[0].seconds
        reached = f"{ratio:.2f}×, {result.error:.1e}"
        is_reached = ratio <= 5.0 and result.error <= 1e-13
        what = f"separatrix, {result.name} against a half"
        rows.append(Row(4, what, "≤ 5×, ≤ 1e-13", reached, is_reached, result, results[0]))
    return rows
