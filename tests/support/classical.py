"""Worked examples of the classical particular solutions of the heavy body, V = a g1 + b g2 + c g3.

An example is a state that starts the motion, its energy, areas and period to all
digits of a double, and the invariant relations that single the solution out, as
residuals that vanish along it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.potentials.families.coefficients import gravity_potential
from service.dynamics.potentials.potential import Potential

FloatArray = NDArray[np.float64]
Residuals = Callable[[FloatArray], FloatArray]
"""Samples (n, 6) to residuals (k, n), each a sum of numbers of the size of the variables."""


@dataclass(frozen=True)
class ClassicalMotion:
    name: str
    body: RigidBody
    centre: tuple[Fraction, Fraction, Fraction]
    omega: tuple[Fraction, ...]
    gamma: tuple[Fraction, ...]
    residuals: Residuals
    energy: float
    areas: float
    period: float | None = None

    @property
    def potential(self) -> Potential:
        return gravity_potential(*self.centre)


def exact(text: str) -> tuple[Fraction, ...]:
    return tuple(Fraction(number) for number in text.split())


def motion(
    name: str,
    moments: str,
    centre: str,
    omega: str,
    gamma: str,
    residuals: Residuals,
    energy: str | float,
    areas: str | float,
    period: float | None = None,
) -> ClassicalMotion:
    A, B, C = exact(moments)
    a, b, c = exact(centre)
    return ClassicalMotion(
        name, RigidBody(A, B, C), (a, b, c), exact(omega), exact(gamma), residuals,
        float(Fraction(energy)), float(Fraction(areas)), period,
    )  # fmt: skip


def sensitivity(residuals: Residuals, samples: FloatArray) -> float:
    """How much the largest residual changes if all six variables change by one: central differences."""
    step = 1e-6
    changes = [np.abs(residuals(samples + row) - residuals(samples - row)) for row in step * np.eye(6)]
    return float(np.sum(changes, axis=0).max()) / (2 * step)
