"""Numbers that a sweep keeps of a motion beside its columns, with the numbers of a single job.

Integrals are measured along each motion; stability and orientation are computed point by point.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.further_integrals import FurtherIntegral, find_further_integrals, integral_drift
from service.dynamics.numerics import printed_error
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import Problem
from service.dynamics.solution.dense_output import Advance
from service.schemas.sweep.sweep import DRIFT_NUMBERS, NUMBERS, keeps_further
from workers.solvers.compiled.frame import make_frame
from workers.solvers.compiled.integrals import drifts_of_many, further_drifts_of_many
from workers.solvers.compiled.records import Records
from workers.solvers.compiled.solve import Batch, solve_batch
from workers.solvers.evidence import drifts_of
from workers.solvers.orientation.advance import estimate
from workers.solvers.orientation.by_doubles import advances_by_doubles
from workers.solvers.stability.by_doubles import Perturbed
from workers.sweeping.parameters.templates import Group
from workers.sweeping.planar.doubles import logarithms_of
from workers.sweeping.planar.potentials import Side

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


Sign = Literal[1, -1]

DRIFTS = ("energy", "geometric", "areas")
"""Integrals that every motion has."""


class KeptIntegrals:
    """The numbers that one sweep keeps of the integrals."""

    def __init__(self, body: RigidBody, keep: Sequence[str]) -> None:
        self._body = body
        self.keeps_drifts = not DRIFT_NUMBERS.isdisjoint(keep)
        self._keeps_further = keeps_further(keep)
        self.names = tuple(name for name in keep if name.startswith("invariants."))
        self._known: tuple[Potential, Sign] | None = None
        self._further: tuple[FurtherIntegral, ...] = ()

    def along(
        self,
        group: Group,
        sign_of_g1: Sign,
        energies: FloatArray,
        samples: FloatArray,
        wanted: IntArray,
        potential_at: Callable[[int], Potential],
    ) -> dict[str, FloatArray]:
        """Return the numbers of the ``wanted`` motions of a group by their names, NaN of the others.

        ``samples`` have the shape (motions, n, 6); ``potential_at`` returns the potential of a motion. Where
        twice the digits do not tell a number, the functions of a single job do.
        """
        numbers: dict[str, FloatArray] = {}
        if self.keeps_drifts:
            drifts = self._drifts(group, energies, samples, wanted, potential_at)
            numbers |= {f"invariants.{name}.drift": drifts[:, k] for k, name in enumerate(DRIFTS)}
        if self._keeps_further:
            numbers |= self._further_drifts(sign_of_g1, samples, wanted, potential_at)
        none = np.full(len(samples), np.nan)
        return {name: numbers.get(name, none) for name in self.names}

    def _drifts(
        self,
        group: Group,
        energies: FloatArray,
        samples: FloatArray,
        wanted: IntArray,
        potential_at: Callable[[int], Potential],
    ) -> FloatArray:
        assert group.rests is not None
        drifts = drifts_of_many(self._body, group.program, group.rows, group.rests, energies, samples, wanted)
        for n in wanted[np.isnan(drifts[wanted, 0])].tolist():
            own = drifts_of(self._body, potential_at(n), samples[n], float(energies[n]), is_planar=True)
            drifts[n] = own.energy, own.geometric, own.areas
        return drifts

    def _further_drifts(
        self, sign: Sign, samples: FloatArray, wanted: IntArray, potential_at: Callable[[int], Potential]
    ) -> dict[str, FloatArray]:
        integrals: dict[int, FurtherIntegral] = {}
        for n in wanted.tolist():
            # There is one at most.
            for integral in self._further_of(potential_at(n), sign):
                integrals[n] = integral
        values = further_drifts_of_many(integrals, samples)
        columns: dict[str, FloatArray] = {}
        for n, integral in integrals.items():
            if np.isnan(values[n, 1]):
                values[n] = integral_drift(integral, samples[n])
            for k, name in enumerate((f"invariants.{integral.name}", f"invariants.{integral.name}.drift")):
                columns.setdefault(name, np.full(len(samples), np.nan))[n] = values[n, k]
        return columns

    def _further_of(self, potential: Potential, sign: Sign) -> tuple[FurtherIntegral, ...]:
        known = self._known
        if known is None or known[0] is not potential or known[1] != sign:
            self._known = potential, sign
            self._further = find_further_integrals(self._body, potential, g1_sign=sign)
        return self._further


OUTPUTS = frozenset(name for name in NUMBERS if name.partition(".")[0] in ("stability", "precession"))
LEAST_AXIS_SINE, MOST_TURN_RADIANS = 1e-3, 1e4
"""Sine of the angle between an axis and the vertical, and |ω| times the period: beyond them a job may find
that the attitude is not resolved, and single jobs decide."""


@dataclass(frozen=True, slots=True)
class KeptOutputs:
    """The outputs beyond the integrals that a sweep asks for."""

    problem: Problem

    @property
    def are_any(self) -> bool:
        """Tell whether there are any."""
        return not {"orientation", "stability"}.isdisjoint(self.problem.outputs)

    def along(
        self, side: Side, group: Group, chosen: Sequence[fmpq], starts: FloatArray | None
    ) -> "OutputsOfGroup | None":
        """Return what works them out for the points of a group, on the curves of these λ².

        ``starts`` are the sizes of g1 at which the motions start, if they vary. None if it cannot be done.
        """
        frame = make_frame(self.problem.body, side.motion)
        if frame is None:
            return None
        loops = frame.loops(logarithms_of(chosen))
        if starts is not None:
            loops["size_of_g1"] = starts
        return OutputsOfGroup(self.problem, group, loops)


@dataclass(frozen=True, slots=True)
class OutputsOfGroup:
    """The outputs of points with one program."""

    problem: Problem
    group: Group
    loops: Records

    def of_point(self, n: int, B: Fraction | None) -> dict[str, float] | None:
        """Return the numbers of the group's point n, for a body with this B; None if a job must decide."""
        outputs: dict[str, float] = {}
        constants, loop = self.group.rows[n], self.loops[n : n + 1]
        if "stability" in self.problem.outputs:
            numbers = self._stability(constants, loop, B)
            if numbers is None:
                return None
            outputs |= numbers
        if "orientation" in self.problem.outputs:
            numbers = self._precession(constants, loop)
            if numbers is None:
                return None
            outputs |= numbers
        errors = {f"{name}.error": value for name, value in outputs.items() if f"{name}.error" in outputs}
        return {**outputs, **{name: printed_error(value, outputs[name]) for name, value in errors.items()}}

    def _stability(self, constants: FloatArray, loop: Records, B: Fraction | None) -> dict[str, float] | None:
        body: RigidBody = self.problem.body
        if B is None:
            return None
        perturbed = Perturbed((body.A, B, body.C), self.group.program, self.problem.tolerance)
        stability, _ = perturbed.assess(constants, loop)
        if stability is None:
            return None
        trusted = stability.trusted_time
        return {
            "stability.trace": stability.trace,
            "stability.trace.error": stability.error,
            "stability.exponent": stability.exponent,
            "stability.exponent.error": stability.exponent_error,
            "stability.trusted_time": math.nan if trusted is None else trusted,
        }

    def _precession(self, constants: FloatArray, loop: Records) -> dict[str, float] | None:
        run = solve_batch(Batch(self.group.program, constants[None, :], loop, "standard"))
        orbit, about = run.loops[0], run.found[0]
        is_plain = min(float(orbit["z"]), float(orbit["g"])) >= LEAST_AXIS_SINE
        if not (about["panels"] and is_plain and about["largest"] * about["period"] <= MOST_TURN_RADIANS):
            return None
        one = three = estimate(Advance())
        if orbit["rotates"]:
            # The sign of s g1 g3 is that of −p g1.
            sense = int(np.sign(orbit["sense"] * orbit["direction"] * orbit["sign1"]))
            advances = advances_by_doubles(loop, sense)
            if advances is None:
                return None
            one, three = map(estimate, advances)
        return {
            "precession.psi1": one.value,
            "precession.psi1.error": one.error,
            "precession.psi3": three.value,
            "precession.psi3.error": three.error,
        }
