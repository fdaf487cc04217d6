"""Finds once what holds for all points of a sweep."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING

from service.dynamics.problem import PlanarMotion, Problem
from service.schemas.sweep.sweep import Sweep, SweepAxis
from workers.solvers.planar.choose import compiled_tier
from workers.sweeping.coefficients import Coefficients, coefficients_of
from workers.sweeping.energies import Energies, energies_of
from workers.sweeping.family import Path, Poles, SweepFamily, has_symbol, prove_family, smooth_poles
from workers.sweeping.integrals import keeps_further

if TYPE_CHECKING:
    from workers.sweeping.by_roots import RationalFamily

_CURVE_FIELDS = ("lambda", "nu")
_START, _MOMENT = ("motion", "start", "g1"), ("body", "B")
_PLAIN_OUTPUTS = {"period", "gamma", "omega", "invariants"}


@dataclass(frozen=True, slots=True)
class Side:
    """The motions with one sign of g1; λ differs from point to point."""

    motion: PlanarMotion
    energies: Energies | None
    rational: "RationalFamily | None" = None
    """The potentials as sums of powers, at the tier ``high`` alone, which is for these."""


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
    coefficients: Coefficients
    """What these numbers make, in which the potential is linear."""
    curve_place: int | None
    """Of the axis of λ or nu."""
    start_place: int | None
    """Of the axis of g1 at the start."""
    moment_place: int | None
    """Of the axis of B, on which planar motions do not depend."""
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

    Verdicts are hoisted if no axis touches A or C, and the potential is linear in numbers
    that those on the axes make. Compiled doubles take the sweeps that besides

    * vary nothing but the potential's numbers, λ or nu, B, and g1 at the start,
    * ask, by method ``auto``, for no outputs but period, gamma, omega, and the integrals,
    * by the tiers ``draft``, ``standard`` and ``high``, or a tolerance that one of them keeps.
    """
    problem, potential = sweep.first_problem, sweep.base["potential"]
    if not isinstance(problem.motion, PlanarMotion) or not isinstance(potential, dict):
        return Plan(sweep, is_judged=False, quick=None)
    moves_body = any(axis.path[0] == "body" for axis in sweep.axes if axis.path != _MOMENT)
    moves_body |= any(axis.path == _MOMENT for axis in sweep.axes) and has_symbol(potential, "B")
    places = tuple(k for k, axis in enumerate(sweep.axes) if _is_of_potential(axis))
    paths = tuple(sweep.axes[k].path[1:] for k in places)
    first = [sweep.axes[k].axis.value(0) for k in places]
    coefficients = None if moves_body else coefficients_of(problem.body, potential, paths, first)
    if coefficients is None:
        return Plan(sweep, is_judged=False, quick=None)
    family = prove_family(problem.body, coefficients.document, coefficients.paths)
    if family is None:
        return Plan(sweep, is_judged=False, quick=None)
    sides = _sides(sweep, problem, problem.motion, family)
    if not _is_quick(sweep, problem) or sides is None:
        return Plan(sweep, is_judged=True, quick=None)
    curve, start, moment = (
        next((k for k, axis in enumerate(sweep.axes) if is_it(axis)), None)
        for is_it in (_is_of_curve, _is_of_start, _is_of_moment)
    )
    poles = smooth_poles(problem.body, family, problem.motion)
    quick = Quick(problem, potential, paths, places, coefficients, curve, start, moment, sides, family, poles)
    return Plan(sweep, is_judged=True, quick=quick)


def _is_quick(sweep: Sweep, problem: Problem) -> bool:
    return (
        problem.method == "auto"
        and set(problem.outputs) <= _PLAIN_OUTPUTS
        and compiled_tier(problem) is not None
        and isinstance(problem.motion, PlanarMotion)
        and not (keeps_further(sweep.keep) and any(map(_is_of_moment, sweep.axes)))
        and (problem.wants_series or "invariants" not in problem.outputs)
        and all(
            _is_of_curve(axis) or _is_of_potential(axis) or _is_of_start(axis) or _is_of_moment(axis)
            for axis in sweep.axes
        )
    )


def _sides(
    sweep: Sweep, problem: Problem, motion: PlanarMotion, family: SweepFamily
) -> dict[int, Side] | None:
    """Return the sides the sweep is on.

    None if energies are kept and have no formula there, or if compiled doubles cannot keep the tier.
    """
    motions = [motion]
    if motion.nu is not None and any(_is_of_curve(axis) for axis in sweep.axes):
        motions = [replace(motion, nu=Fraction(sign)) for sign in (1, -1)]
    is_high = compiled_tier(problem) == "high"
    sides = dict[int, Side]()
    for each in motions:
        rational = _rational(problem, family, each) if is_high else None
        sides[each.sign_of_g1] = Side(each, energies_of(problem.body, family, each), rational)
    keeps_energy = any("energy" in name for name in sweep.keep)
    has_all = all(side.energies is not None for side in sides.values())
    return sides if has_all or not keeps_energy else None


def _rational(problem: Problem, family: SweepFamily, motion: PlanarMotion) -> "RationalFamily | None":
    # The compiler is loaded only where it is needed.
    from workers.sweeping.by_roots import rational_family  # noqa: PLC0415

    return rational_family(problem.body, family, motion)


def _is_of_potential(axis: SweepAxis) -> bool:
    return axis.path[0] == "potential"


def _is_of_curve(axis: SweepAxis) -> bool:
    return len(axis.path) == 2 and axis.path[0] == "motion" and axis.path[1] in _CURVE_FIELDS


def _is_of_start(axis: SweepAxis) -> bool:
    return axis.path == _START


def _is_of_moment(axis: SweepAxis) -> bool:
    return axis.path == _MOMENT
