"""The certified tier: a motion whose samples are the midpoints of proven enclosures."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.enclosure import RADIUS, parts_for, split
from service.dynamics.errors import DynamicsError
from service.dynamics.motion import COLUMNS, Motion
from service.dynamics.problem import Accuracy, Problem, StateMotion
from workers.solvers.certified.certify import Certified, certify

FloatArray = NDArray[np.float64]

CHECKED_TOLERANCE = 1e-9
"""Of the function of time that is stored beside the enclosures, where a cross-check wants it."""


def beside_enclosures(problem: Problem) -> Accuracy:
    """Return the accuracy of the function of time between the enclosures.

    It says its own error, and however large that is, it does not keep the
    enclosures from being had; a cross-check only makes sense of a small one.
    """
    return Accuracy(CHECKED_TOLERANCE if problem.method == "both" else float("inf"), "certified")


def certified_samples(problem: Problem, motion: Motion) -> tuple[Motion, Certified, dict[str, FloatArray]]:
    """Return ``motion`` with proven samples, the enclosures, and the columns that hold them.

    The times are the doubles of the motion, taken as exact.

    Raises
    ------
    CertifiedUnavailableError
        There is no enclosure of this kind of motion.
    """
    if isinstance(problem.motion, StateMotion):
        raise DynamicsError("the certified tier is for planar motions", pointer="/accuracy/tier")
    times = [Fraction(t) for t in motion.times.tolist()]
    found = certify(problem.body, problem.potential, problem.motion, times, problem.accuracy.bits)
    parts = parts_for(problem.accuracy.bits)
    rows = [[split(ball, parts) for ball in state] for state in found.states]
    first = np.array([[doubles[0] for doubles, _ in row] for row in rows])
    error = max(
        (
            _error(ball, doubles[0])
            for state, row in zip(found.states, rows, strict=True)
            for ball, (doubles, _) in zip(state, row, strict=True)
        ),
        default=0.0,
    )
    proven = replace(motion, samples=first, error=error, conventions=found.conventions)
    return proven, found, _columns(rows, parts)


def _columns(rows: list[list[tuple[list[float], float]]], parts: int) -> dict[str, FloatArray]:
    columns: dict[str, FloatArray] = {}
    for index, name in enumerate(COLUMNS):
        for part in range(1, parts):
            columns[f"{name}.{part}"] = np.array([row[index][0][part] for row in rows])
        columns[f"{name}.{RADIUS}"] = np.array([row[index][1] for row in rows])
    return columns


def _error(ball: arb, double: float) -> float:
    """Return a bound of the distance of ``double`` from the true number."""
    return float(abs(ball - arb(double)).abs_upper())
