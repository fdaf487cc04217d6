"""Finds once what holds for all points of a sweep."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

from service.dynamics.problem import PlanarMotion, Problem, StartAtPoint
from service.schemas.sweep.sweep import Sweep, SweepAxis
from workers.solvers.planar.choose import compiled_tier
from workers.sweeping.energies import Energies, energies_of
from workers.sweeping.family import Path, Poles, SweepFamily, prove_family, smooth_poles

_CURVE_FIELDS = ("lambda", "nu")
_PLAIN_OUTPUTS = {"period", "gamma", "omega"}


@dataclass(frozen=True, slots=True)
class Side:
    """The motions with one sign of g1; λ differs from point to point."""

    motion: PlanarMotion
    energies: Energies | None


@dataclass(frozen=True, slots=True)
class Quick:
    """The data for solving points in compiled doubles."""

    problem: Problem
    """The first point's."""
    potential: Mapping[str, object]
    """The base's."""
    paths: tuple[Path, ...]
    """Of the numbers in the potential that vary."""
    places: tuple[int, ...]
    """Of their axes, in the same order."""
    curve_place: int | None
    """Of the axis of λ or nu."""
    sides: Mapping[int, Side]
    """By the sign of g1."""
    family: SweepFamily
    poles: Poles | None


@dataclass(frozen=True, slots=True)
class Plan:
    """How the points of a sweep are computed."""

    sweep: Sweep
    is_judged: bool
    """All potentials of the sweep are proved admissible at once."""
    quick: Quick | None
    """None if the points are solved one by one."""


def make_plan(sweep: Sweep) -> Plan:
    """Return the plan of a sweep.

    Verdicts are hoisted if no axis touches the body, and those that touch the
    potential do so linearly. Compiled doubles take the sweeps that besides

    * vary nothing but the potential's numbers and λ or nu,
    * ask, by method ``auto``, for no outputs but period, gamma and omega,
    * by the tier ``draft`` or a tolerance looser than that of ``standard``,
    * and do not start at a given g1.
    """
    problem, potential = sweep.first_problem, sweep.base["potential"]
    moves_body = any(axis.path[0] == "body" for axis in sweep.axes)
    if moves_body or not isinstance(problem.motion, PlanarMotion) or not isinstance(potential, dict):
        return Plan(sweep, is_judged=False, quick=None)
    paths = tuple(axis.path[1:] for axis in sweep.axes if _is_of_potential(axis))
    family = prove_family(problem.body, potential, paths)
    if family is None:
        return Plan(sweep, is_judged=False, quick=None)
    sides = _sides(sweep, problem, problem.motion, family)
    if not _is_quick(sweep, problem) or sides is None:
        return Plan(sweep, is_judged=True, quick=None)
    places = tuple(k for k, axis in enumerate(sweep.axes) if _is_of_potential(axis))
    curve_place = next((k for k, axis in enumerate(sweep.axes) if _is_of_curve(axis)), None)
    poles = smooth_poles(problem.body, family, problem.motion)
    quick = Quick(problem, potential, paths, places, curve_place, sides, family, poles)
    return Plan(sweep, is_judged=True, quick=quick)


def _is_quick(sweep: Sweep, problem: Problem) -> bool:
    return (
        problem.method == "auto"
        and set(problem.outputs) <= _PLAIN_OUTPUTS
        and compiled_tier(problem) in ("draft", "standard")
        and isinstance(problem.motion, PlanarMotion)
        and not isinstance(problem.motion.start, StartAtPoint)
        and all(_is_of_curve(axis) or _is_of_potential(axis) for axis in sweep.axes)
    )


def _sides(
    sweep: Sweep, problem: Problem, motion: PlanarMotion, family: SweepFamily
) -> dict[int, Side] | None:
    """Return the sides the sweep is on, None if energies are kept and have no formula there."""
    motions = [motion]
    if motion.nu is not None and any(_is_of_curve(axis) for axis in sweep.axes):
        motions = [replace(motion, nu=Fraction(sign)) for sign in (1, -1)]
    sides: dict[int, Side] = {
        each.sign_of_g1: Side(each, energies_of(problem.body, family, each)) for each in motions
    }
    keeps_energy = any(name.startswith("energy") for name in sweep.keep)
    has_all = all(side.energies is not None for side in sides.values())
    return sides if has_all or not keeps_energy else None


def _is_of_potential(axis: SweepAxis) -> bool:
    return axis.path[0] == "potential"


def _is_of_curve(axis: SweepAxis) -> bool:
    return len(axis.path) == 2 and axis.path[0] == "motion" and axis.path[1] in _CURVE_FIELDS
