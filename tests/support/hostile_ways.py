"""When a motion is where, and on which way: up (v grows, g2 falls) or down, once or many rounds later."""

from dataclasses import dataclass

import numpy as np
from flint import arb

from tests.support.hostile_times import Timeline, half_round

ROUNDS = (0, 0, 0, 1, -1, 7, 1000)
LATEST = 1e6
"""Later times, on the way to where the motion never arrives, are not asked."""


@dataclass(frozen=True, slots=True)
class Way:
    """A place, when the motion is there, and the signs it has there."""

    v: arb
    time: arb
    direction: int
    """1 where v grows, −1 where it falls."""
    flip: int
    """−1 after an odd number of poles."""


def ways_of(line: Timeline, s_sign: int, passed: tuple[bool, bool], draws: np.random.Generator) -> list[Way]:
    """Return ways through the places of a timeline; the first is the start, where v grows if ``s_sign`` is 1.

    ``passed`` says whether the lower and the upper end are poles that the motion passes.
    """
    found: list[Way] = []
    first, crossings = arb(0), 0
    for k, (v, at) in enumerate(zip(line.places, line.times, strict=True)):
        direction, rounds = s_sign, 0
        if k:
            turned = 1 if draws.random() < 0.5 else -1
            many = int(draws.choice(ROUNDS))
            if line.begins or line.end is not None:
                direction = turned
            rounds = many if half_round(line) is not None else 0
        time, lower, upper = _phase(line, at, direction, rounds)
        crossed = lower * passed[0] + upper * passed[1]
        if not k:
            first, crossings = time, crossed
        way = Way(v, time - first, direction, -1 if (crossed - crossings) % 2 else 1)
        if abs(way.time) < LATEST:
            found.append(way)
    return found


def _phase(line: Timeline, at: arb, direction: int, rounds: int) -> tuple[arb, int, int]:
    """Return a time that counts from an end, and how often each end was passed till then."""
    half = half_round(line)
    if half is not None:
        phase = at if direction > 0 else 2 * half - at
        return phase + 2 * half * rounds, rounds, rounds + (direction < 0)
    if line.begins:
        return at * direction, int(direction > 0), 0
    if line.end is not None:
        return (at - line.end) * direction, 0, int(direction < 0)
    return at * direction, 0, 0
