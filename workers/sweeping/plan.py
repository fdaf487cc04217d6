"""Finds once what holds for all points of a sweep."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import islice, product
from math import prod
from typing import TYPE_CHECKING

from service.dynamics.errors import DynamicsError
from service.dynamics.problem import PlanarMotion, Problem
from service.dynamics.verdict.proofs.power_sums import is_power_sum
from service.dynamics.verdict.simple_form import is_simplified, simplified
from service.schemas.problem.problem import read_problem
from service.schemas.reading.documents import InvalidProblemError
from service.schemas.sweep.sweep import PLAIN_OUTPUTS, Sweep
from workers.computation.outputs import takes_doubles
from workers.solvers.choose import compiled_tier
from workers.sweeping.parameters.coefficients import coefficients_of
from workers.sweeping.parameters.family import (
    SweepFamily,
    energies_of,
    has_symbol,
    prove_family,
    smooth_poles,
)
from workers.sweeping.planar.records import CompiledPlan, Side

if TYPE_CHECKING:
    from workers.sweeping.planar.by_roots import RationalFamily
    from workers.sweeping.varying_body.block import VaryingPlan

CHECKED_CORNERS = 16
"""Points of a sweep whose formulas are looked at before blocks are planned."""


@dataclass(frozen=True, slots=True)
class Plan:
    """The plan for computing the points of a sweep."""

    sweep: Sweep
    is_judged: bool
    """All potentials of the sweep are proved admissible at once."""
    compiled: CompiledPlan | None
    """None if the points are solved one by one, or by :mod:`.states`."""
    states: bool = False
    """Whether they are motions from any state that kernels solve."""


def make_plan(sweep: Sweep) -> Plan:
    """Return the plan of a sweep.

    Verdicts are hoisted if no axis touches A or C, and the potential is linear in numbers
    that those on the axes make. Compiled doubles take the sweeps that besides

    * vary nothing but the potential's numbers, λ or nu, B, g1 at the start, and the times,
    * ask, by method ``auto``, for no outputs but period, gamma, omega, and the integrals; by the tiers
      ``draft`` and ``standard`` also for the stability, and for the precession without columns,
    * by the tiers ``draft``, ``standard`` and ``high``, or a tolerance that one of them keeps.
    """
    problem, potential = sweep.first_problem, sweep.base["potential"]
    if sweep.are_states:
        return Plan(sweep, is_judged=False, compiled=None, states=True)
    if not isinstance(problem.motion, PlanarMotion) or not isinstance(potential, dict):
        return Plan(sweep, is_judged=False, compiled=None)
    if not _is_solved_as_stated(sweep):
        return Plan(sweep, is_judged=False, compiled=None)
    moves_body = any(axis.varies == "body" for axis in sweep.axes)
    moves_body |= any(axis.varies == "moment" for axis in sweep.axes) and has_symbol(potential, "B")
    axes = tuple(k for k, axis in enumerate(sweep.axes) if axis.varies == "potential")
    paths = tuple(sweep.axes[k].path[1:] for k in axes)
    first = [sweep.axes[k].axis.value(0) for k in axes]
    coefficients = None if moves_body else coefficients_of(problem.body, potential, paths, first)
    if coefficients is None:
        return Plan(sweep, is_judged=False, compiled=None)
    family = prove_family(problem.body, coefficients.document, coefficients.paths)
    if family is None:
        return Plan(sweep, is_judged=False, compiled=None)
    sides = _sides(sweep, problem, problem.motion, family)
    if not _may_be_compiled(sweep, problem) or sides is None:
        return Plan(sweep, is_judged=True, compiled=None)
    curve, start, moment = (
        next((k for k, axis in enumerate(sweep.axes) if axis.varies == kind), None)
        for kind in ("curve", "start", "moment")
    )
    poles = smooth_poles(problem.body, family, problem.motion)
    compiled = CompiledPlan(
        problem,
        potential,
        paths,
        axes,
        coefficients,
        curve,
        start,
        moment,
        _times(sweep),
        sides,
        poles,
    )
    return Plan(sweep, is_judged=True, compiled=compiled)


def _may_be_compiled(sweep: Sweep, problem: Problem, moments: Sequence[str] = ("B",)) -> bool:
    return (
        problem.method == "auto"
        and sweep.has_block_outputs(by_doubles=takes_doubles(problem))
        and compiled_tier(problem) is not None
        and isinstance(problem.motion, PlanarMotion)
        and (problem.wants_series or "invariants" not in problem.outputs)
        and all(
            axis.varies in ("curve", "potential", "start")
            or (axis.path[0] == "body" and axis.path[1] in moments)
            or (axis.varies == "time" and compiled_tier(problem) != "high")
            for axis in sweep.axes
        )
    )


def _sides(
    sweep: Sweep, problem: Problem, motion: PlanarMotion, family: SweepFamily
) -> dict[int, Side] | None:
    """Return the sides the sweep is on.

    None if energies are kept and have no formula there, or if compiled doubles cannot keep the tier.
    """
    is_high = compiled_tier(problem) == "high"
    sides = dict[int, Side]()
    for each in _motions(sweep, motion):
        rational = _rational(problem, family, each) if is_high else None
        sides[each.sign_of_g1] = Side(each, energies_of(problem.body, family, each), rational)
    keeps_energy = any("energy" in name for name in sweep.keep)
    has_all = all(side.energies is not None for side in sides.values())
    return sides if has_all or not keeps_energy else None


def _motions(sweep: Sweep, motion: PlanarMotion) -> list[PlanarMotion]:
    """Return a motion for each sign of g1 that the sweep may have."""
    if motion.nu is not None and any(axis.varies == "curve" for axis in sweep.axes):
        return [replace(motion, nu=Fraction(sign)) for sign in (1, -1)]
    return [motion]


def _rational(problem: Problem, family: SweepFamily, motion: PlanarMotion) -> "RationalFamily | None":
    # The compiler is loaded only where it is needed.
    from workers.sweeping.planar.by_roots import rational_family  # noqa: PLC0415

    return rational_family(problem.body, family, motion)


def _times(sweep: Sweep) -> dict[str, int]:
    return {axis.path[1]: index for index, axis in enumerate(sweep.axes) if axis.varies == "time"}


def _is_solved_as_stated(sweep: Sweep) -> bool:
    """Tell whether no simpler formula is solved in place of that of a point, at the ends of the axes."""
    lengths = [each.axis.length for each in sweep.axes]
    moves = [each.path[0] in ("potential", "body") for each in sweep.axes]
    if sweep.combine == "zip":
        corners = [0, sweep.points - 1]
    else:
        steps = [prod(lengths[k + 1 :]) for k in range(len(lengths))]
        ends = [((0, length - 1) if moved else (0,)) for length, moved in zip(lengths, moves, strict=True)]
        corners = [
            sum(at * step for at, step in zip(corner, steps, strict=True))
            for corner in islice(product(*ends), CHECKED_CORNERS)
        ]
    for index in dict.fromkeys(corners if any(moves) else [0]):
        with suppress(DynamicsError, InvalidProblemError):
            if is_simplified(simplified(read_problem(sweep.document(index)).potential)):
                return False
    return True


def plan_varying(sweep: Sweep) -> "VaryingPlan | None":
    """Return how points are solved in blocks whose bodies or exponents differ; None if they are not.

    The sweep varies the moments, the potential's numbers, λ or nu, and g1 at the start; else it is like those
    that :func:`make_plan` takes, but for the tier ``high`` and what is kept of the integrals.
    """
    problem, potential = sweep.first_problem, sweep.base["potential"]
    motion, tier = problem.motion, compiled_tier(problem)
    if not isinstance(motion, PlanarMotion) or not isinstance(potential, dict) or tier in (None, "high"):
        return None
    if problem.accuracy.measure == "relative":
        return None
    moments = {axis.path[1]: k for k, axis in enumerate(sweep.axes) if axis.path[0] == "body"}
    keeps_integrals = any(name.startswith("invariants.") for name in sweep.keep)
    if (
        not _may_be_compiled(sweep, problem, tuple(moments))
        or not set(problem.outputs) <= PLAIN_OUTPUTS
        or keeps_integrals
        or not set(moments) <= {"A", "B", "C"}
    ):
        return None
    # The compiler is loaded only where it is needed.
    from workers.sweeping.varying_body.block import VaryingPlan  # noqa: PLC0415
    from workers.sweeping.parameters.models import model_of  # noqa: PLC0415

    axes = tuple(k for k, axis in enumerate(sweep.axes) if axis.varies == "potential")
    paths = tuple(sweep.axes[k].path[1:] for k in axes)
    model = model_of(potential, paths, frozenset(moments))
    if model is None or not _is_solved_as_stated(sweep) or not is_power_sum(problem.body, problem.potential):
        return None
    curve, start = (
        next((k for k, axis in enumerate(sweep.axes) if axis.varies == kind), None)
        for kind in ("curve", "start")
    )
    motions: dict[int, PlanarMotion] = {each.sign_of_g1: each for each in _motions(sweep, motion)}
    needs_double = motion.nu is not None or potential.get("type") == "rational"
    return VaryingPlan(
        problem, tier, model, axes, moments, curve, start, _times(sweep), motions, needs_double
    )
