"""Raises the claimed error of a motion to at least its drifts and its defect.

Drifts of the three integrals, and of further ones, are measured along the samples.
"""

from dataclasses import dataclass, replace
from math import isfinite

import numpy as np
from flint import ctx
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.defect.evidence import ResidualEvidence, check_residual, check_samples
from service.dynamics.equations.euler_poisson import areas_integral, geometric_integral, kinetic_energy
from service.dynamics.further_integrals import FurtherIntegral, integral_drift
from service.dynamics.motion import COLUMNS, Estimate, Motion
from service.dynamics.numerics import largest
from service.dynamics.potentials.potential import Potential
from service.dynamics.solution.dense_output import DenseOutput, chebyshev_points, chebyshev_series
from workers.solvers.ways import is_plain

FloatArray = NDArray[np.float64]

DEFECT, DRIFT, COVERED = "defect", "drift", "defect_covers"
"""Keys of the evidence: see :class:`service.dynamics.defect.evidence.ResidualEvidence`."""
PARTS_PER_PIECE = 128
"""Number of parts of a piece, where compiled code does not settle whole ones."""
MAX_PIECES_CUT = 64
"""Pieces that are cut so: more are short enough."""


def with_claim_raised(body: RigidBody, potential: Potential, motion: Motion) -> Motion:
    """Return ``motion`` with its defect and drift in the evidence, and claims that are not below these.

    A motion without a function of time has no residual, and one whose claim is not finite claims nothing.
    """
    residual = residual_evidence(
        body, potential, motion.dense, motion.energy, is_planar=motion.window is not None
    )
    if residual is None:
        return motion
    dense, error = with_error_raised(motion.dense, motion.error, residual)
    return replace(motion, evidence={**motion.evidence, **evidence_items(residual)}, dense=dense, error=error)


def residual_evidence(
    body: RigidBody, potential: Potential, dense: DenseOutput, energy: Estimate, *, is_planar: bool
) -> ResidualEvidence | None:
    """Return the residual of a function of time; None if it has not the six variables, or claims nothing."""
    if dense.columns != COLUMNS or not isfinite(dense.error):
        return None
    residual = None
    if is_planar and not is_plain():
        # The compiler is loaded only where it is needed.
        from workers.solvers.compiled.residual.residual import kept_claim  # noqa: PLC0415

        residual = kept_claim(body, potential, dense, dense.error, energy)
        if residual is None and dense.coefficients.shape[1] > 1 and len(dense.breaks) <= MAX_PIECES_CUT:
            # It cuts a piece a few times only: beside a narrow feature the long ones of a draft too seldom.
            residual = kept_claim(body, potential, _cut(dense), dense.error, energy)
    if residual is None:
        residual = check_residual(body, potential, dense, dense.error, energy, is_planar=is_planar)
    return residual


def _cut(dense: DenseOutput) -> DenseOutput:
    """Return the same function of time in PARTS_PER_PIECE times as many pieces."""
    degree = dense.coefficients.shape[1] - 1
    shares = np.arange(PARTS_PER_PIECE)[:, None] / PARTS_PER_PIECE
    x = 2.0 * shares - 1.0 + (1.0 + chebyshev_points(degree)) / PARTS_PER_PIECE
    values = chebyshev.chebvander(x, degree) @ dense.coefficients[:, None]
    coefficients = chebyshev_series(values.reshape(-1, degree + 1, values.shape[-1]))
    starts = dense.breaks[:-1, None] + np.diff(dense.breaks)[:, None] * shares[:, 0]
    return replace(dense, breaks=np.append(starts.ravel(), dense.breaks[-1]), coefficients=coefficients)


def evidence_items(residual: ResidualEvidence) -> dict[str, float]:
    """Return the residual as items of the evidence."""
    return {DEFECT: residual.defect, DRIFT: residual.drift, COVERED: residual.settled}


def with_error_raised(
    dense: DenseOutput, error: float, residual: ResidualEvidence
) -> tuple[DenseOutput, float]:
    """Return the function of time, and the error of samples, with claims not below the residual."""
    if residual.error == dense.error:
        return dense, error
    return replace(dense, error=largest((dense.error, residual.error))), largest((error, residual.error))


def with_samples_raised(body: RigidBody, potential: Potential, motion: Motion) -> Motion:
    """Return a planar ``motion`` with the claim of its samples raised as far as their own integrals demand.

    For samples that are not those of its function of time.
    """
    if not isfinite(motion.error):
        return motion
    if not is_plain():
        from workers.solvers.compiled.residual.residual import samples_keep_claim  # noqa: PLC0415

        if samples_keep_claim(body, potential, motion.samples, motion.error, motion.energy):
            return motion
    error = check_samples(body, potential, motion.samples, motion.error, motion.energy)
    return replace(motion, error=largest((motion.error, error)))


ENERGY_BITS = 128
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
    from workers.solvers.compiled.integrals import further_drifts_of_many  # noqa: PLC0415

    ((value, drift),) = further_drifts_of_many({0: integral}, samples[None])
    return integral_drift(integral, samples) if np.isnan(drift) else (float(value), float(drift))


def _potential_energies(potential: Potential, samples: FloatArray) -> FloatArray:
    """Return V from balls, or what they round to: large terms that cancel are no drift of the motion."""
    found = np.full(len(samples), np.nan)
    if not is_plain():
        from workers.solvers.compiled.integrals import energies_at  # noqa: PLC0415

        found = energies_at(potential, samples)
    left = np.flatnonzero(np.isnan(found))
    if len(left):
        with ctx.workprec(ENERGY_BITS):
            found[left] = [float(V) for V in potential.value_balls(samples[left, 3:].tolist())]
    return found


def _largest(departures: FloatArray) -> float:
    return float(np.abs(departures).max(initial=0.0))
