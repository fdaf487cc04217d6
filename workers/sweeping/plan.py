"""Finds once what holds for all points of a sweep, or for all with the same numbers on some axes.

Verdicts are hoisted if no axis touches A or C, and the potential is linear in numbers that those on the axes
make. Where windows, bodies, or numbers in which no potential is linear vary, points with the same ones make a
slice: a sweep over the other axes with a verdict of its own. What is left, if it is sums of powers, is judged
point by point (:mod:`.planar.potentials`).
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import islice, product

from service.dynamics.errors import DynamicsError
from service.dynamics.problem import PlanarMotion, Problem
from service.dynamics.verdict.proofs.power_sums import is_power_sum
from service.dynamics.verdict.simple_form import is_simplified, simplified
from service.schemas.problem.problem import read_problem
from service.schemas.reading.documents import InvalidProblemError, with_values
from service.schemas.sweep.sweep import FEW, PLAIN_OUTPUTS, Sweep, SweepAxis, json_number
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
from workers.sweeping.parameters.models import model_of
from workers.sweeping.parameters.templates import Templates
from workers.sweeping.planar.potentials import FamilyPotentials, JudgedPotentials, RowPlan, Side

CHECKED_CORNERS = 16
"""Points of a sweep whose formulas are looked at before rows are planned."""
OWN_PLAN_POINTS = 100
"""Points from which on a plan for those with the same body and exponents is cheaper than one for each."""


@dataclass(frozen=True, slots=True)
class Plan:
    """The plan for computing the points of a sweep, or of a slice of it."""

    sweep: Sweep
    is_judged: bool = False
    """All potentials are proved admissible at once."""
    rows: RowPlan | None = None
    """None if the points are solved one by one, or by :mod:`.states`."""
    states: bool = False
    """Whether they are motions from any state that kernels solve."""


def make_plan(sweep: Sweep, numbering: Sequence[int] | None = None) -> Plan:
    """Return the plan of a sweep whose potentials are proved at once.

    Compiled doubles take the sweeps that besides

    * vary nothing but the potential's numbers, λ or nu, B, g1 at the start, and the times,
    * ask, by method ``auto``, for no outputs but period, gamma, omega, and the integrals; by the tiers
      ``draft`` and ``standard`` also for the stability, and for the precession without columns,
    * by the tiers ``draft``, ``standard`` and ``high``, or a tolerance that one of them keeps.

    ``numbering`` are the indices of its axes in the sweep that it is a slice of.
    """
    problem, potential = sweep.first_problem, sweep.base["potential"]
    motion = problem.motion
    if sweep.are_states:
        return Plan(sweep, states=True)
    if (
        not isinstance(motion, PlanarMotion)
        or not isinstance(potential, dict)
        or not _is_solved_as_stated(sweep)
    ):
        return Plan(sweep)
    moves_body = any(axis.varies == "body" for axis in sweep.axes)
    moves_body |= any(axis.varies == "moment" for axis in sweep.axes) and has_symbol(potential, "B")
    numbered = dict(enumerate(sweep.axes) if numbering is None else zip(numbering, sweep.axes, strict=True))
    varying = _varying(numbered)
    paths, first = tuple(varying.values()), [numbered[k].axis.value(0) for k in varying]
    coefficients = None if moves_body else coefficients_of(problem.body, potential, paths, first)
    family = (
        None
        if coefficients is None
        else prove_family(problem.body, coefficients.document, coefficients.paths)
    )
    if coefficients is None or family is None:
        return Plan(sweep)
    sides = _sides(sweep, problem, motion, family)
    if not _may_be_compiled(sweep, problem) or sides is None:
        return Plan(sweep, is_judged=True)
    poles = smooth_poles(problem.body, family, motion)
    model = model_of(coefficients.document, coefficients.paths, frozenset())
    if model is None:
        return Plan(sweep, is_judged=True)
    potentials = FamilyPotentials(problem, potential, varying, coefficients, Templates(model), poles)
    return Plan(sweep, is_judged=True, rows=_rows(problem, numbered, potentials, sides))


def plan_judged(sweep: Sweep) -> RowPlan | None:
    """Return the plan of points that are judged one by one; None if there is none.

    The sweep varies the moments, the potential's numbers, λ or nu, and g1 at the start; else it is like those
    that :func:`make_plan` takes, but for the tier ``high`` and what is kept of the integrals.
    """
    problem, potential = sweep.first_problem, sweep.base["potential"]
    motion, tier = problem.motion, compiled_tier(problem)
    moments = {axis.path[1]: k for k, axis in enumerate(sweep.axes) if axis.path[0] == "body"}
    if (
        not isinstance(motion, PlanarMotion)
        or not isinstance(potential, dict)
        or tier == "high"
        or not _may_be_compiled(sweep, problem, tuple(moments))
        or not set(problem.outputs) <= PLAIN_OUTPUTS
        or any(name.startswith("invariants.") for name in sweep.keep)
        or not set(moments) <= {"A", "B", "C"}
    ):
        return None
    numbered = dict(enumerate(sweep.axes))
    axes = _varying(numbered)
    model = model_of(potential, tuple(axes.values()), frozenset(moments))
    if model is None or not _is_solved_as_stated(sweep) or not is_power_sum(problem.body, problem.potential):
        return None
    needs_double = motion.nu is not None or potential.get("type") == "rational"
    potentials = JudgedPotentials(problem, model, tuple(axes), moments, needs_double=needs_double)
    sides = {int(each.sign_of_g1): Side(each) for each in _motions(sweep, motion)}
    return replace(_rows(problem, numbered, potentials, sides), moment_axis=None)


def _rows(
    problem: Problem,
    axes: Mapping[int, SweepAxis],
    potentials: FamilyPotentials | JudgedPotentials,
    sides: Mapping[int, Side],
) -> RowPlan:
    curve, start, moment = (
        next((k for k, axis in axes.items() if axis.varies == kind), None)
        for kind in ("curve", "start", "moment")
    )
    times = {axis.path[1]: k for k, axis in axes.items() if axis.varies == "time"}
    tier = compiled_tier(problem)
    assert tier is not None
    return RowPlan(problem, tier, potentials, curve, start, moment, times, sides)


def _varying(axes: Mapping[int, SweepAxis]) -> dict[int, tuple[str, ...]]:
    """Return the paths of the numbers in the potential that vary, by the indices of their axes."""
    return {k: axis.path[1:] for k, axis in axes.items() if axis.varies == "potential"}


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
    sides = dict[int, Side]()
    for each in _motions(sweep, motion):
        rational = None
        if compiled_tier(problem) == "high":
            # The compiler is loaded only where it is needed.
            from workers.sweeping.planar.by_roots import rational_family  # noqa: PLC0415

            rational = rational_family(problem.body, family, each)
        sides[each.sign_of_g1] = Side(each, energies_of(problem.body, family, each), rational)
    keeps_energy = any("energy" in name for name in sweep.keep)
    has_all = all(side.energies is not None for side in sides.values())
    return sides if has_all or not keeps_energy else None


def _motions(sweep: Sweep, motion: PlanarMotion) -> list[PlanarMotion]:
    """Return a motion for each sign of g1 that the sweep may have."""
    if motion.nu is not None and any(axis.varies == "curve" for axis in sweep.axes):
        return [replace(motion, nu=Fraction(sign)) for sign in (1, -1)]
    return [motion]


def _is_solved_as_stated(sweep: Sweep) -> bool:
    """Tell whether no simpler formula is solved in place of that of a point, at the ends of the axes."""
    lengths = [each.axis.length for each in sweep.axes]
    moves = [each.path[0] in ("potential", "body") for each in sweep.axes]
    if sweep.combine == "zip":
        corners = [0, sweep.points - 1]
    else:
        steps = [math.prod(lengths[k + 1 :]) for k in range(len(lengths))]
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


def outer_axes(sweep: Sweep, least: int = 1) -> tuple[int, ...] | None:
    """Return the axes whose numbers slices have in common; None if no slice would go in rows.

    They are those of windows and signs, which have few values, those of the body, and those of the potential
    too if it takes that: but not those where a slice of a grid has fewer than ``least`` points.
    """
    few = tuple(k for k, each in enumerate(sweep.axes) if each.path in FEW)
    is_grid = sweep.combine == "grid"
    of_body = tuple(k for k, each in enumerate(sweep.axes) if each.path[0] == "body" and each.path[1] != "B")
    others = tuple(k for k, each in enumerate(sweep.axes) if each.path[0] in ("body", "potential"))
    for more in dict.fromkeys(((), of_body, others) if is_grid else ((),)):
        outer = (*few, *more)
        inner = math.prod(each.axis.length for k, each in enumerate(sweep.axes) if k not in outer)
        if not outer or (more and inner < least):
            continue
        first = plan_of_slice(sweep, outer, [sweep.axes[k].axis.value(0) for k in outer])
        if first is not None and first.rows is not None:
            return outer
    return None


def plan_of_slice(sweep: Sweep, outer: Sequence[int], numbers: Sequence[Fraction]) -> Plan | None:
    """Return the plan of a slice by its ``numbers``; None if its first point is no problem."""
    fixed = {sweep.axes[k].path: json_number(number) for k, number in zip(outer, numbers, strict=True)}
    inner = [k for k in range(len(sweep.axes)) if k not in outer]
    slice_ = replace(
        sweep,
        base=with_values(sweep.base, dict(fixed)),
        axes=tuple(sweep.axes[k] for k in inner),
        combine=sweep.combine if inner else "grid",
    )
    try:
        slice_ = replace(slice_, first_problem=read_problem(slice_.document(0)))
    except (DynamicsError, InvalidProblemError):
        return None
    return make_plan(slice_, inner)
