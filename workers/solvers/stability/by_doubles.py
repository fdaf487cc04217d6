"""The stability of periodic planar motions in compiled doubles; apart, since it loads the compiler.

Motions that doubles do not decide are left to balls.

Single jobs and sweeps call this same function: its numbers do not depend on how the motion itself was solved.
"""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from service.dynamics.accuracy import TIER_TOLERANCES
from service.dynamics.body import RigidBody
from service.dynamics.numerics import is_within
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.window import Window
from service.dynamics.solution.dense_output import Period
from workers.solvers.compiled.evaluation.program import Program, make_program
from workers.solvers.compiled.family import is_in_window
from workers.solvers.compiled.frame import make_frame
from workers.solvers.compiled.motion import SpectralMotion
from workers.solvers.compiled.records import Records, new_records
from workers.solvers.compiled.solve import Batch, BatchResult, bounds_of, solve_batch
from workers.solvers.compiled.transverse.turn import ERROR, EXCURSION, LOOKED_AT, SPEED, turn
from workers.solvers.compiled.workspace import WORKSPACE
from workers.solvers.stability.assessment import Stability, assess, verdict_of
from workers.solvers.stability.monodromy import Monodromy

LARGEST_ERROR = TIER_TOLERANCES["standard"]
"""Largest error of a trace, in parts of the larger of itself and 1, where the tolerance is not smaller."""


@dataclass(frozen=True, slots=True)
class Perturbed:
    """The data of Hill's equation beside the curve: the moments, and the program of V."""

    moments: tuple[Fraction, Fraction, Fraction]
    program: Program
    tolerance: float

    def assess(self, constants: np.ndarray, loop: Records) -> tuple[Stability | None, BatchResult]:
        """Return the stability with these constants of the program on the only ``loop``, and its time map.

        None if it is not decided here, to the tolerance: by whether the motion is periodic, by the error of
        the trace, or by a verdict that the error leaves open.
        """
        A, B, C = self.moments
        run = solve_batch(Batch(self.program, constants[None, :], loop, "standard"))
        about = run.found[0]
        if not about["panels"]:
            return None, run
        moments = np.array([float(each) for each in (A, B, C, B - C, A - C, A - B)])
        out = np.empty(8)
        of_potential = self.program.code, self.program.result, self.program.across, constants
        workspace = new_records(WORKSPACE)
        if not turn(*of_potential, run.loops, run.panels, run.found, workspace, moments, out):
            return None, run
        found = Monodromy(
            out[:4].reshape(2, 2), float(out[ERROR]), float(out[EXCURSION]), int(out[LOOKED_AT])
        )
        goal = min(self.tolerance, LARGEST_ERROR) * max(1.0, abs(found.trace))
        is_open = verdict_of(found.trace, found.error) == "marginal"
        if not is_within(found.error, goal) or is_open:
            return None, run
        period = Period(float(about["period"]), 0.0, float(about["period_error"]))
        return assess(found, float(out[SPEED]), period, self.tolerance), run


def stability_by_doubles(
    body: RigidBody, potential: Potential, motion: PlanarMotion, window: Window, tolerance: float
) -> Stability | None:
    """Return the stability of the periodic motion in a window; None if doubles do not decide it.

    Raises
    ------
    MissingMomentError
        The body has no B.
    """
    moments = (body.A, body.require_B("stability"), body.C)
    frame = make_frame(body, motion)
    try:
        program, constants = make_program(potential.tape)
    except NoClosedFormError:
        return None
    if frame is None:
        return None
    found, run = Perturbed(moments, program, tolerance).assess(constants, frame.shared)
    if found is None:
        return None
    about = run.found[0]
    period = Period(float(about["period"]), 0.0, float(about["period_error"]))
    spectral = SpectralMotion(period, run.loops, run.panels, bounds_of(run.found), potential)
    return found if is_in_window(window, spectral) else None
