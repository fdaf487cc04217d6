"""What the benchmarks share: times, rows of the table of targets, and what is known of the run."""

import os
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime

from service.versions import version_of
from workers.calibration.measurement import this_machine

PACKAGES = ("polhode", "numpy", "scipy", "numba", "heyoka", "python-flint", "mpmath")
LOADED = 1.5
"""Processes that run, ourselves among them, above which times are not those of a quiet machine."""


@dataclass(frozen=True)
class Result:
    """What a way took, and its largest error against the reference."""

    name: str
    seconds: float
    error: float
    remark: str = ""
    """Such as a claimed error, or from what a time is extrapolated."""

    def __str__(self) -> str:
        remark = f" ({self.remark})" if self.remark else ""
        return f"{self.name}: {in_words(self.seconds)}, {self.error:.1e}{remark}"


@dataclass(frozen=True)
class Row:
    """One measured claim of a target."""

    target: int
    what: str
    asked: str
    reached: str
    is_reached: bool
    ours: Result
    rival: Result | None

    def cells(self) -> tuple[str, ...]:
        return (
            str(self.target),
            self.what,
            self.asked,
            self.reached if self.is_reached else f"**{self.reached}, missed**",
            str(self.ours),
            str(self.rival or "—"),
        )


@dataclass(frozen=True)
class Table:
    """Measured things that are no targets."""

    title: str
    remark: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Effort:
    """How much is measured."""

    is_quick: bool

    def repeats(self, number: int) -> int:
        return max(1, number // 5) if self.is_quick else number


def faster(
    target: int, what: str, ratio: float, error: float, ours: Result, rival: Result, *, asked: str = ""
) -> Row:
    """Return the row of a target: so many times faster than the rival, with no more than this error."""
    reached = rival.seconds / ours.seconds
    return Row(
        target,
        what,
        asked or f"≥ {ratio:,.0f}×, ≤ {error:.0e}",
        f"{reached:,.3g}×, {ours.error:.1e}" if reached < 1000 else f"{reached:,.0f}×, {ours.error:.1e}",
        reached >= ratio and ours.error <= error,
        ours,
        rival,
    )


def clock() -> float:
    """Return the processor time of this process: what other processes do meanwhile does not count.

    By a clock on the wall long runs would seem slower than short ones on a busy machine.
    """
    return time.process_time()


def median(action: Callable[[], object], repeats: int) -> float:
    """Return the median time of a warm call in seconds."""
    action()
    times = []
    for _ in range(repeats):
        began = clock()
        action()
        times.append(clock() - began)
    return statistics.median(times)


def in_turns(
    actions: tuple[Callable[[], object], ...], repeats: int, clock: Callable[[], float] = clock
) -> tuple[float, ...]:
    """Return the median times of warm calls, made in turns so that a drift hits all alike."""
    times: list[list[float]] = [[] for _ in actions]
    for _ in range(repeats + 1):
        for action, list_ in zip(actions, times, strict=True):
            began = clock()
            action()
            list_.append(clock() - began)
    return tuple(statistics.median(list_[1:]) for list_ in times)


def in_words(seconds: float) -> str:
    for unit, size in (("µs", 1e-6), ("ms", 1e-3)):
        if seconds < 1000 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:,.3g} s" if seconds < 1000 else f"{seconds:,.0f} s"


def circumstances() -> tuple[str, ...]:
    """Return date, machine, versions, and how busy the machine is."""
    machine = this_machine()
    load = os.getloadavg()[0]
    return (
        f"{datetime.now(UTC):%Y-%m-%d}, {machine.model or 'unknown processor'}, {machine.cpus} processors, "
        f"{machine.system}, Python {sys.version.split()[0]}",
        ", ".join(f"{name} {version_of(name)}" for name in PACKAGES),
        f"load average at the start {load:.1f}" + (": the machine was busy" if load > LOADED else ""),
    )


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()
