"""Measures the drift of the three integrals along a computed motion."""

from dataclasses import dataclass

import numpy as np
from flint import ctx
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.equations.euler_poisson import areas_integral, geometric_integral, kinetic_energy
from service.dynamics.further_integrals import FurtherIntegral, integral_drift
from service.dynamics.motion import Motion
from service.dynamics.potentials.potential import Potential
from workers.solvers.ways import is_plain

FloatArray = NDArray[np.float64]

BITS = 128
"""Precision of the balls for V: a double's 53 bits and room for 1e22 of cancellation."""


@dataclass(frozen=True, slots=True)
class Drifts:
    """Largest departure of each integral from its value, over the samples."""

    energy: float
    geometric: float
    areas: float


def measure_drifts(body: RigidBody, potential: Potential, motion: Motion) -> Drifts:
    """Compare the integrals at the samples with their values.

    The energy's value is that of the motion, that of γ·γ is 1, that of the areas
    integral is 0 for a planar motion, else the one at the first sample.
    """
    is_planar = motion.window is not None
    return drifts_of(body, potential, motion.samples, motion.energy.value, is_planar=is_planar)


def drifts_of(
    body: RigidBody, potential: Potential, samples: FloatArray, energy: float, *, is_planar: bool
) -> Drifts:
    """Compare the integrals at ``samples``, shape (n, 6), with their values, as :func:`measure_drifts`."""
    omega, gamma = samples[:, :3], samples[:, 3:]
    areas = areas_integral(body, omega, gamma)
    V = _potential_energies(potential, samples)
    # A potential such as g3^8/g1^3 has a limit at a pole but no value there.
    is_undefined = ~np.isfinite(V) & np.isfinite(samples).all(axis=1)
    energies = kinetic_energy(body, omega) + V
    return Drifts(
        energy=_largest(energies[~is_undefined] - energy),
        geometric=_largest(geometric_integral(gamma) - 1.0),
        areas=_largest(areas - (0.0 if is_planar else areas[0])),
    )


def further_drift(integral: FurtherIntegral, samples: FloatArray) -> tuple[float, float]:
    """Return what :func:`.integral_drift` does, without balls where twice the digits of doubles tell it."""
    if is_plain():
        return integral_drift(integral, samples)
    # The compiler is loaded only where it is needed.
    from workers.solvers.compiled.integrals.of_many import further_drifts_of_many  # noqa: PLC0415

    ((value, drift),) = further_drifts_of_many({0: integral}, samples[None])
    return integral_drift(integral, samples) if np.isnan(drift) else (float(value), float(drift))


def _potential_energies(potential: Potential, samples: FloatArray) -> FloatArray:
    """Return V from balls, or what they round to: large terms that cancel are no drift of the motion."""
    found = np.full(len(samples), np.nan)
    if not is_plain():
        from workers.solvers.compiled.integrals.of_many import energies_at  # noqa: PLC0415

        found = energies_at(potential, samples)
    left = np.flatnonzero(np.isnan(found))
    if len(left):
        with ctx.workprec(BITS):
            found[left] = [float(V) for V in potential.value_balls(samples[left, 3:].tolist())]
    return found


def _largest(departures: FloatArray) -> float:
    return float(np.abs(departures).max(initial=0.0))
