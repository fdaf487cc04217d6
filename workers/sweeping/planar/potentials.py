"""The potentials at the points of a sweep: proved at once, or judged one by one.

Potentials of one body that are linear in the numbers that vary share a proof (:mod:`.family`) and, but for
numbers that shorten their formula, a program. Where A, C or an exponent varies no proof holds for all points.
But if the potential is a sum of powers, its compatibility equation is decided exactly at each in a few
multiplications of ratios (:mod:`.power_sums`), which finds the energy too; points of one structure share a
program, whose exponents are data like its constants.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from flint import arb, ctx, fmpq
from numpy.typing import NDArray

from service.dynamics.body import MAX_MOMENT_RATIO, RigidBody
from service.dynamics.formula.algebras.monomials import NotAMonomialSumError, as_fmpq, as_fraction
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion, Problem, Times
from service.dynamics.reduction.geometry.loop import make_loop
from service.dynamics.reduction.windows import REDUCTION_BITS
from service.dynamics.verdict.proofs.power_sums import CurveEnergy, Judgement, judge_power_sum, number_of
from service.schemas.problem.trusted import potential_of
from service.schemas.reading.documents import Part, with_values
from service.schemas.sweep.sweep import json_number
from workers.solvers.compiled.frame import Bodies, loops_of
from workers.solvers.compiled.solve import Tier
from workers.solvers.units import Units
from workers.sweeping.parameters.coefficients import Coefficients
from workers.sweeping.parameters.family import Energies, Path, Poles, rounded
from workers.sweeping.parameters.points import SweptPoints, are_numbers
from workers.sweeping.parameters.templates import (
    SHORTENING,
    Constants,
    Group,
    Model,
    MomentsOfPoint,
    Templates,
    double_of,
    grouped,
)
from workers.sweeping.planar.doubles import (
    INADMISSIBLE,
    INVALID,
    BlockResult,
    Sampling,
    logarithms_of,
    sweep_loops,
    sweep_sets,
)
from workers.sweeping.planar.exclusions import have_no_motion_at, sums_have_no_motion

if TYPE_CHECKING:
    from workers.sweeping.planar.by_roots import RationalFamily

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

MOST_NUMBER_BITS = 1000
"""Largest size of a number in a potential, in bits: what is made of such ones keeps the limits of
formulas."""
_ONE = fmpq(1)


@dataclass(frozen=True, slots=True)
class Side:
    """The motions with one sign of g1; λ differs from point to point."""

    motion: PlanarMotion
    energies: Energies | None = None
    """Energies of potentials that are proved at once."""
    rational: "RationalFamily | None" = None
    """The potentials as sums of powers, at the tier ``high`` alone, which is for these."""


@dataclass(frozen=True, slots=True)
class Request:
    """The question about the points of a group."""

    side: Side
    squares: Sequence[fmpq]
    """Their λ²."""
    units: Units
    sampling: Sampling
    """In these units, as the times are."""
    tier: Tier
    start_axis: int | None
    """Index of the axis of g1 at the start, if it varies."""
    times: Sequence[Times] | None
    """The times of each, where they vary."""


class FamilyPotentials:
    """Potentials of one body that are proved at once."""

    def __init__(
        self,
        problem: Problem,
        document: Mapping[str, object],
        axes: Mapping[int, Path],
        coefficients: Coefficients,
        templates: Templates,
        poles: Poles | None,
    ) -> None:
        """Take the potential of the first point, and the ``axes`` that vary numbers in it, by their index."""
        self.problem, self.document, self.axes = problem, document, axes
        self.coefficients, self.templates, self.poles = coefficients, templates, poles

    def at(self, points: SweptPoints) -> "FamilyOfBlock":
        """Return those at the points of a block."""
        return FamilyOfBlock(self, points)


class FamilyOfBlock:
    """The potentials of a family at the points of a block."""

    def __init__(self, family: FamilyPotentials, points: SweptPoints) -> None:
        self._family, self._points = family, points
        self._body, self._moments = family.problem.body, MomentsOfPoint.of(family.problem.body)
        self._parameters = points.parameters(family.coefficients, tuple(family.axes))
        self.usable = are_numbers(self._parameters.doubles)

    def refused(self) -> Mapping[str, Sequence[int]]:
        """Return the points so far that certainly end with an error, by its code."""
        return {}

    def groups(self, indices: IntArray, *, has_rests: bool) -> list[Group]:
        """Return points by their programs, with ``rests`` if they are asked for.

        Points without a program, or of which it is not known that they are admissible, are left out.
        """
        templates, doubles = self._family.templates, self._parameters.doubles
        order, groups = templates.model.order, list[Group]()
        # Those whose signs are alike mostly share a template, and its constants are doubles that are known.
        left, generic = indices, indices[~np.isin(doubles[indices], SHORTENING).any(axis=1)]
        signs = np.sign(doubles[generic])
        for pattern in [] if order is None or has_rests else np.unique(signs, axis=0):
            alike = generic[(signs == pattern).all(axis=1)]
            first = self._constants(int(alike[0]))
            if first is not None and first.template.is_shared:
                rows, are_own = first.template.rows(doubles[alike][:, order])
                groups.append(Group(first.template, rows[are_own], alike[are_own]))
                left = np.setdiff1d(left, alike[are_own])
        found = {index: self._constants(index) for index in left.tolist()}
        known = {index: constants for index, constants in found.items() if constants is not None}
        return [each for each in [*groups, *grouped(known, has_rests=has_rests)] if len(each.indices)]

    def _constants(self, index: int) -> Constants | None:
        numbers, templates = self._parameters.exact(index), self._family.templates
        values = templates.model.values(self._moments, numbers)
        return None if values is None else templates.at(self._moments, numbers, values)

    def body(self, index: int) -> RigidBody:
        """Return the body of a point."""
        return self._body

    def potential(self, index: int) -> Potential:
        """Return the potential of a point."""
        family = self._family
        return potential_of(self._document(index), self._body) if family.axes else family.problem.potential

    def solve(self, group: Group, request: Request) -> BlockResult | None:
        """Solve the points of a group; None if motions of their kind are not solved here."""
        body, side, is_high = request.units.body(self._body), request.side, request.tier == "high"
        sizes = self._points.sizes(request.start_axis, group.indices)
        result = sweep_sets(
            body,
            side.motion,
            group.program,
            group.rows,
            request.squares,
            request.sampling,
            request.tier,
            sizes,
            request.times,
            group.rests if is_high else None,
        )
        if result is None or side.rational is None or not is_high:
            return result
        # The compiler is loaded only where it is needed.
        from workers.sweeping.planar.by_roots import sweep_by_roots  # noqa: PLC0415

        left = np.flatnonzero(~result.is_kept)
        indices, at, starts = group.indices[left], request.start_axis, None
        if at is not None:
            starts = [abs(as_fraction(self._points.exact(at, index))) for index in indices.tolist()]
        squares = [request.squares[index] for index in left.tolist()]
        family = replace(side.rational, body=body)
        return result.with_others(
            left, sweep_by_roots(family, self._exact(indices), squares, request.sampling, starts)
        )

    def energies(self, group: Group, side: Side, squares: Sequence[fmpq]) -> FloatArray:
        """Return energies and bounds of their errors as jobs have them, shape (points, 2), NaN in doubt."""
        assert side.energies is not None
        return np.array(side.energies.rounded(self._exact(group.indices), squares)).reshape(-1, 2)

    def are_smooth(self, group: Group, side: Side, passing: BoolArray) -> BoolArray:
        """Tell for the points ``passing`` a pole whether they need no convention there."""
        poles, parameters = self._family.poles, self._parameters.doubles[group.indices]
        return ~passing if poles is None else ~passing | poles.are_plain(parameters)

    def have_no_motion(self, group: Group, side: Side, rest: IntArray, squares: Sequence[fmpq]) -> BoolArray:
        """Tell which of the ``rest`` of a group, on the curves of these λ², are proved to have no motion."""
        return have_no_motion_at(self._body, side.motion, group, rest, squares)

    def _exact(self, indices: IntArray) -> list[list[fmpq]]:
        return [self._parameters.exact(index) for index in indices.tolist()]

    def _document(self, index: int) -> Part:
        family = self._family
        values = {
            path: json_number(as_fraction(self._points.exact(axis, index)))
            for axis, path in family.axes.items()
        }
        return with_values(family.document, dict(values))


class JudgedPotentials:
    """Potentials that are judged one by one, each with its body."""

    def __init__(
        self,
        problem: Problem,
        model: Model,
        axes: Sequence[int],
        moments: Mapping[str, int],
        *,
        needs_double: bool,
    ) -> None:
        """Take the first problem, and the axes of the model's numbers and of A, B and C, by their index.

        ``needs_double``: there is the curve, or the potential, for A = 2C only.
        """
        self._body, self._model, self._axes, self._moments = problem.body, model, axes, moments
        self._needs_double = needs_double
        self._templates = Templates(model)
        self._last: tuple[object, StatedPoint | str | None] = None, None

    def at(self, points: SweptPoints) -> "JudgedOfBlock":
        """See FamilyPotentials.at."""
        return JudgedOfBlock(self, points)

    def stated(self, points: SweptPoints, index: int) -> "StatedPoint | str | None":
        """Return what a point states, or the code of its refusal; None: left to a single job."""
        moments = self._moments_at(points, index)
        if not self._is_body(moments) or (self._needs_double and moments.A != 2 * moments.C):
            return INVALID
        numbers = points.exact_row(index, self._axes)
        # On a grid neighbours often differ in λ alone.
        key = moments, numbers
        if self._last[0] != key:
            self._last = key, self._judged(moments, numbers)
        return self._last[1]

    def _moments_at(self, points: SweptPoints, index: int) -> MomentsOfPoint:
        body, axes = self._body, self._moments
        A = points.exact(axes["A"], index) if "A" in axes else as_fmpq(body.A)
        C = points.exact(axes["C"], index) if "C" in axes else as_fmpq(body.C)
        if "B" in axes:
            return MomentsOfPoint(A, points.exact(axes["B"], index), C)
        return MomentsOfPoint(A, None if body.B is None else as_fmpq(body.B), C)

    def _is_body(self, moments: MomentsOfPoint) -> bool:
        """Tell whether there is such a body, and planar motions of it."""
        A, B, C = moments
        if A <= 0 or C <= 0 or A == C or A > MAX_MOMENT_RATIO * C or C > MAX_MOMENT_RATIO * A:
            return False
        if B is None:
            return True
        return B > 0 and (self._body.allow_unphysical or abs(A - C) <= B <= A + C)

    def _judged(self, moments: MomentsOfPoint, numbers: list[fmpq]) -> "StatedPoint | str | None":
        values = self._model.values(moments, numbers)
        if values is None or any(value.height_bits() > MOST_NUMBER_BITS for value in values):
            return None
        constants = self._templates.at(moments, numbers, values)
        if constants is None:
            return None
        known = [number for number in constants.exact if number is not None]
        try:
            judgement = judge_power_sum(moments.A, moments.C, constants.template.tape, known)
        except NotAMonomialSumError:
            return None
        energy = judgement.energy
        if energy is None:
            return INADMISSIBLE if judgement.is_refuted else None
        if any(energy.is_positive):
            # Where the potential has no value is told by single jobs.
            return None
        return StatedPoint(self._model, moments, numbers, values, constants, judgement, energy)


@dataclass(frozen=True, slots=True)
class StatedPoint:
    """The numbers that a point states, with its program and its verdict."""

    model: Model
    moments: MomentsOfPoint
    numbers: list[fmpq]
    values: list[fmpq]
    constants: Constants
    judgement: Judgement
    found: CurveEnergy

    def potential(self) -> Potential:
        """Return the potential."""
        return self.model.potential(self.moments, self.numbers)

    def energy(self, square: fmpq, motion: PlanarMotion) -> tuple[float, float]:
        """Return the energy on the curve of λ², and the bound of its error, as a job has them."""
        total, largest = arb(0), max(map(abs, map(float, self.values)), default=0.0)
        with ctx.workprec(REDUCTION_BITS):
            for term in self.found.terms:
                half = term.power / 2
                power = arb(square ** int(half.p)) if half.q == 1 else arb(square) ** arb(half)
                value = arb(term.coefficient) * power
                if term.constants:
                    value *= number_of(term.constants)
                if (term.odd_first and motion.sign_of_g1 < 0) != (term.odd_third and motion.g3_sign < 0):
                    value = -value
                total, largest = total + value, max(largest, abs(float(value)))
            return rounded(total, largest)


class JudgedOfBlock:
    """The potentials at the points of a block, each judged by itself."""

    def __init__(self, potentials: JudgedPotentials, points: SweptPoints) -> None:
        self._potentials, self._points = potentials, points
        self._stated: dict[int, StatedPoint] = {}
        self._refused: dict[str, list[int]] = {}
        self.usable = np.ones(points.count, dtype=np.bool_)

    def refused(self) -> Mapping[str, Sequence[int]]:
        """See FamilyOfBlock.refused."""
        return self._refused

    def groups(self, indices: IntArray, *, has_rests: bool) -> list[Group]:
        """See FamilyOfBlock.groups; there are no rests."""
        for index in indices.tolist():
            stated = self._potentials.stated(self._points, index)
            if isinstance(stated, str):
                self._refused.setdefault(stated, []).append(index)
            elif stated is not None:
                self._stated[index] = stated
        members = [index for index in indices.tolist() if index in self._stated]
        return grouped({index: self._stated[index].constants for index in members})

    def body(self, index: int) -> RigidBody:
        """See FamilyOfBlock.body."""
        return self._stated[index].moments.body()

    def potential(self, index: int) -> Potential:
        """See FamilyOfBlock.potential."""
        return self._stated[index].potential()

    def solve(self, group: Group, request: Request) -> BlockResult | None:
        """See FamilyOfBlock.solve."""
        motion, unit = request.side.motion, fmpq(4) ** request.units.k
        loops = loops_of(_bodies(self._of(group.indices), unit), motion, logarithms_of(request.squares))
        if loops is None:
            return None
        sizes = self._points.sizes(request.start_axis, group.indices)
        return sweep_loops(
            motion, group.program, group.rows, loops, request.sampling, request.tier, sizes, request.times
        )

    def energies(self, group: Group, side: Side, squares: Sequence[fmpq]) -> FloatArray:
        """See FamilyOfBlock.energies."""
        return np.array(
            [
                each.energy(square, side.motion)
                for each, square in zip(self._of(group.indices), squares, strict=True)
            ]
        )

    def are_smooth(self, group: Group, side: Side, passing: BoolArray) -> BoolArray:
        """See FamilyOfBlock.are_smooth."""
        smooth, stated = np.ones(len(passing), dtype=np.bool_), self._of(group.indices)
        with ctx.workprec(REDUCTION_BITS):
            for n in np.flatnonzero(passing).tolist():
                each = stated[n]
                smooth[n] = make_loop(each.moments.body(), each.potential(), side.motion).is_smooth_at_poles()
        return smooth

    def have_no_motion(self, group: Group, side: Side, rest: IntArray, squares: Sequence[fmpq]) -> BoolArray:
        """See FamilyOfBlock.have_no_motion."""
        stated = self._of(group.indices[rest])
        loops = loops_of(_bodies(stated), side.motion, logarithms_of(squares))
        if loops is None:
            return np.zeros(len(rest), dtype=np.bool_)
        judged = [(each.moments, each.judgement) for each in stated]
        return sums_have_no_motion(judged, loops, side.motion)

    def _of(self, indices: IntArray) -> list[StatedPoint]:
        return [self._stated[index] for index in indices.tolist()]


def _bodies(stated: Sequence[StatedPoint], unit: fmpq = _ONE) -> Bodies:
    """Return the bodies of these points with their moments in a unit."""
    alpha, factor, mirrored = [], [], []
    for each in stated:
        A, C = each.moments.A, each.moments.C
        is_mirrored = A < C
        if is_mirrored:
            A, C = C, A
        alpha.append(double_of(A / C))
        factor.append(double_of(C / ((A - C) * A * unit)))
        mirrored.append(is_mirrored)
    return Bodies(np.array(alpha), np.array(factor), np.array(mirrored))


@dataclass(frozen=True, slots=True)
class RowPlan:
    """The data that points of a sweep, or of a slice, have in common; axes are told by their index."""

    problem: Problem
    """The first point's."""
    tier: Tier
    potentials: FamilyPotentials | JudgedPotentials
    curve_axis: int | None
    """λ or nu."""
    start_axis: int | None
    """g1 at the start."""
    moment_axis: int | None
    """B, on which planar motions do not depend."""
    time_axes: Mapping[str, int]
    """The times, by their names."""
    sides: Mapping[int, Side]
    """The sides by the sign of g1."""
