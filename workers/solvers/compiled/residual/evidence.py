"""Holds functions of time and samples that keep their claims against the equations, by compiled code.

What breaks a bound, and what these bounds do not settle, is left to :mod:`service.dynamics.defect.evidence`,
which says by how much a claim is too small: here no claim is ever changed.
"""

from math import inf, isfinite

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.defect.evidence import MIN_TRUNCATION, TRUNCATION_SHARE, ResidualEvidence
from service.dynamics.equations.euler_poisson import moments_of
from service.dynamics.identity_cache import IdentityCache
from service.dynamics.motion import Estimate
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.solution.dense_output import DenseOutput
from workers.solvers.compiled.evaluation.program import make_program
from workers.solvers.compiled.records import Equations
from workers.solvers.compiled.residual.nodes import HIGHEST_DEGREE, in_lanes
from workers.solvers.compiled.residual.residual import hold, samples_are_explained

FloatArray = NDArray[np.float64]

SKIPPED_SHARE = 1e-12
"""Share of the time, next to poles, on which forces may have no bound."""


def kept_claim(
    body: RigidBody, potential: Potential, dense: DenseOutput, claim: float, energy: Estimate
) -> ResidualEvidence | None:
    """Return what a planar ``dense`` shows if that is within ``claim``; None if it is not settled."""
    degree = dense.coefficients.shape[1] - 1
    equations = _equations(body, potential)
    if equations is None or not 0 < degree <= HIGHEST_DEGREE or dense.breaks[0] != 0.0:
        return None
    goal = max(TRUNCATION_SHARE * claim, MIN_TRUNCATION * float(np.abs(dense.coefficients).max(initial=1.0)))
    for skipped in (0.0, SKIPPED_SHARE):
        is_kept, defect, drift = hold(
            equations,
            dense.breaks,
            in_lanes(dense.coefficients),
            degree + 1,
            goal,
            inf,
            True,
            claim,
            _reference(energy),
            energy.error,
            skipped,
        )
        if is_kept or isfinite(defect):
            return ResidualEvidence(defect, drift, 1.0 - skipped, claim) if is_kept else None
    return None


def samples_keep_claim(
    body: RigidBody, potential: Potential, samples: FloatArray, claim: float, energy: Estimate
) -> bool:
    """Say whether the integrals of planar ``samples``, shape (n, 6), are explained by an error ``claim``."""
    equations = _equations(body, potential)
    if equations is None:
        return False
    return samples_are_explained(
        equations, np.ascontiguousarray(samples), claim, _reference(energy), energy.error
    )


def _equations(body: RigidBody, potential: Potential) -> Equations | None:
    try:
        program, constants = make_program(potential.tape)
    except NoClosedFormError:
        return None
    return Equations(program.gradient, constants, _moments_of(body))


def _moments(body: RigidBody) -> FloatArray:
    return np.array([float(each) for each in moments_of(body)])


_moments_of = IdentityCache(_moments)


def _reference(energy: Estimate) -> FloatArray:
    """Return the integrals of a planar motion: its energy, 0 and 1."""
    return np.array([energy.value, 0.0, 1.0])
