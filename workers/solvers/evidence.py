"""Raises the claimed error of a motion to at least its drifts and its defect."""

from dataclasses import replace
from math import isfinite

from service.dynamics.body import RigidBody
from service.dynamics.bounds import largest
from service.dynamics.defect.evidence import hold_against_equations, hold_samples
from service.dynamics.motion import COLUMNS, Motion
from service.dynamics.potentials.potential import Potential

DEFECT, DRIFT, COVERED = "defect", "drift", "defect_covers"
"""Keys of the evidence: see :class:`service.dynamics.defect.evidence.Shown`."""


def with_claim_shown(body: RigidBody, potential: Potential, motion: Motion) -> Motion:
    """Return ``motion`` with its defect and drift in the evidence, and claims that are not below these.

    A motion without a function of time shows nothing, and one whose claim is not finite claims nothing.
    """
    dense = motion.dense
    if dense.columns != COLUMNS or not isfinite(dense.error):
        return motion
    shown = None
    if motion.window is not None:
        # The compiler is loaded only where it is needed.
        from workers.solvers.compiled.shown.evidence import kept_claim  # noqa: PLC0415

        shown = kept_claim(body, potential, dense, dense.error, motion.energy)
    if shown is None:
        is_planar = motion.window is not None
        shown = hold_against_equations(
            body, potential, dense, dense.error, motion.energy, is_planar=is_planar
        )
    evidence = {**motion.evidence, DEFECT: shown.defect, DRIFT: shown.drift, COVERED: shown.settled}
    motion = replace(motion, evidence=evidence)
    if shown.error == dense.error:
        return motion
    dense = replace(dense, error=largest((dense.error, shown.error)))
    return replace(motion, dense=dense, error=largest((motion.error, shown.error)))


def with_samples_shown(body: RigidBody, potential: Potential, motion: Motion) -> Motion:
    """Return a planar ``motion`` with the claim of its samples raised as far as their own integrals show.

    For samples that are not those of its function of time.
    """
    if not isfinite(motion.error):
        return motion
    from workers.solvers.compiled.shown.evidence import samples_keep_claim  # noqa: PLC0415

    if samples_keep_claim(body, potential, motion.samples, motion.error, motion.energy):
        return motion
    error = hold_samples(body, potential, motion.samples, motion.error, motion.energy)
    return replace(motion, error=largest((motion.error, error)))
