"""The relations of the classical cases: on which of them a state lies, and its distance from the others.

Relations are taken in the client's axes; what is left of them are their residuals.

The distance from a case is that of the state of the case to which Newton's least steps onto its relations
lead. It is never less than the true distance, and for a near state more by a part of its size only.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.classical.bodies import CASES, CONDITION_RELATIVE_ROUNDING, fittings
from service.dynamics.classical.cases import hess, staude
from service.dynamics.classical.placement import Placed, Start, place
from service.dynamics.classical.protocol import Number
from service.dynamics.equations.euler_poisson import areas_integral
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.numerics import is_within
from service.dynamics.problem import ClassicalMotion, Sign

FloatArray = NDArray[np.float64]
States = NDArray[Number]
"""p, q, r, g1, g2, g3, shape (n, 6), complex or balls."""
Residuals = Callable[[States], Mapping[str, NDArray[Number]]]
"""Returns what vanishes on a case, by name, shape (n,) each."""
OfNumbers = Callable[[Callable[[arb], Number]], Residuals]
"""The residuals with constants that a function makes of balls."""

_IMAGINARY_STEP = 1e-40
"""Imaginary step of the derivatives: it loses nothing to cancellation, however small it is."""
_RESIDUAL_BITS = 128
"""Bits of residuals in balls: where slopes nearly vanish, a rounding of doubles would be divided by them."""


@dataclass(frozen=True, slots=True)
class CaseRelations:
    """The relations of a motion, and how many of them are independent."""

    of_numbers: OfNumbers
    rank: int

    def values(self, states: FloatArray) -> dict[str, FloatArray]:
        """Return the residuals by name, shape (n,) each."""
        return {name: np.real(each) for name, each in self.of_numbers(float)(states.astype(complex)).items()}

    def steps(self, states: FloatArray, values: FloatArray | None = None) -> FloatArray:
        """Return the least displacement that satisfies the relations to first order, shape (n, 6).

        Of dependent relations only as many directions are used as are independent on the case itself:
        beside it the others are nearly so, and would make of rounding a long step. ``values`` are residuals
        that are known, shape (n, relations).
        """
        residuals = self.of_numbers(float)
        if values is None:
            values = np.stack(list(self.values(states).values()), axis=1)
        slopes = np.empty((*values.shape, 6))
        for k in range(6):
            shifted = states.astype(complex)
            shifted[:, k] += 1j * _IMAGINARY_STEP
            slopes[:, :, k] = (
                np.stack([np.imag(each) for each in residuals(shifted).values()], axis=1) / _IMAGINARY_STEP
            )
        sizes = np.linalg.norm(slopes, axis=2, keepdims=True)
        sizes = np.where(sizes > 0.0, sizes, 1.0)
        left, widths, right = np.linalg.svd(slopes / sizes, full_matrices=False)
        rank = min(self.rank, widths.shape[1])
        along = np.einsum("nij,ni->nj", left, values / sizes[:, :, 0])[:, :rank] / widths[:, :rank]
        steps: FloatArray = -np.einsum("nj,njk->nk", along, right[:, :rank])
        return steps

    def drifts(self, states: FloatArray) -> dict[str, float]:
        """Return the largest residual of each relation."""
        return {name: float(np.abs(each).max(initial=0.0)) for name, each in self.values(states).items()}

    def distance(self, states: FloatArray, known: float = 0.0) -> float:
        """Return the largest length of :meth:`steps`; NaN if one is not finite.

        Where slopes nearly vanish, roundings of the residuals alone make long steps. Those that are longer
        than ``known`` are therefore found again from residuals in balls, in some 0.05 ms each.
        """
        if not len(states):
            return 0.0
        lengths = np.linalg.norm(self.steps(states), axis=1)
        long = ~(lengths <= known)
        if long.any():
            lengths[long] = np.linalg.norm(self.steps(states[long], self._in_balls(states[long])), axis=1)
        return float(lengths.max())

    def _in_balls(self, states: FloatArray) -> FloatArray:
        """Return the residuals, free of roundings of their own, shape (n, relations)."""
        with ctx.workprec(_RESIDUAL_BITS):
            found = self.of_numbers(lambda number: number)(np.vectorize(arb, otypes=[object])(states))
            return np.stack([each.astype(float) for each in found.values()], axis=1)


def relations_of(placed: Placed) -> CaseRelations:
    """Return the relations of a motion."""
    match placed.case.form:
        case "hess":
            return CaseRelations(partial(_of_hess, placed), 2)
        case "steady":
            return CaseRelations(partial(_of_staude, placed), 5)
    return CaseRelations(partial(_of_loop, placed), 5)


def _of_loop(placed: Placed, number: Callable[[arb], Number]) -> Residuals:
    assert placed.reduced is not None
    reduced = placed.reduced.converted(number)
    speed, strength = number(placed.motion.direction * placed.speed), number(placed.strength)

    def residuals(states: States) -> Mapping[str, NDArray[Number]]:
        columns = list(states.T)
        own = placed.own_state(columns[:3], columns[3:], speed, strength)
        found = dict(reduced.relations(reduced.constants, own))
        return found | ({} if len(found) > 4 else {"|gamma|^2 - 1": unit_length(states)})

    return residuals


def _of_hess(placed: Placed, number: Callable[[arb], Number]) -> Residuals:
    A, _, C = (ball(moment) for moment in placed.fitting.moments)
    frame = placed.fitting.frame
    a, _, c = (ball(x) for x in frame.vector(placed.motion.centre))
    G = (a * a + c * c).sqrt()
    A, C, ex, ez = (number(each) for each in (A, C, a / G, c / G))

    def residuals(states: States) -> Mapping[str, NDArray[Number]]:
        p, _, r = frame.axial(list(states.T)[:3])
        along = hess.momentum_along(A, C, ex, ez, p, r)
        return {"momentum along the centre": along, "|gamma|^2 - 1": unit_length(states)}

    return residuals


def _of_staude(placed: Placed, number: Callable[[arb], Number]) -> Residuals:
    moments = [number(ball(moment)) for moment in placed.fitting.moments]
    centre = [number(ball(x)) for x in placed.motion.centre]

    def residuals(states: States) -> Mapping[str, NDArray[Number]]:
        columns = list(states.T)
        found = dict(staude.relations(moments, centre, columns[:3], columns[3:]))
        return {**found, "|gamma|^2 - 1": unit_length(states)}

    return residuals


def unit_length(states: States) -> NDArray[Number]:
    """Return |γ|² − 1, shape (n,)."""
    lengths: NDArray[Number] = (states[:, 3:] ** 2).sum(axis=1) - 1
    return lengths


Vector = tuple[Fraction, Fraction, Fraction]

ON_CASE_RELATIVE_DISTANCE = 1e-12
"""Distance, relative to the state where that is longer than 1, at which a state lies on a case."""
AREAS = "|areas integral| / |momentum|"
LAST_STEP_RELATIVE_LENGTH = 1e-13
"""Length of a step, relative alike, that leads no farther."""
MAX_NEWTON_STEPS = 40
MAX_RELATIVE_DISTANCE = 10.0
"""A state that is farther from where it started, relative alike, is on the way to nowhere."""


@dataclass(frozen=True, slots=True)
class Nearness:
    """A case that the body has, and a state."""

    case: str
    distance: float | None
    """Distance to the state of the case that was found; None if none was found."""
    relations: Mapping[str, float]
    """The residual of each relation at the state itself."""
    is_on: bool


@dataclass(frozen=True, slots=True)
class Integrable:
    """An integrable case, its conditions as residuals: all are zero where it holds."""

    case: str
    residuals: Mapping[str, float]
    holds: bool


@dataclass(frozen=True, slots=True)
class Classification:
    """The position of a state among the classical and the integrable cases."""

    cases: tuple[Nearness, ...]
    """The cases that the body has, the nearest first; last the cases of which no state was found."""
    integrable: tuple[Integrable, ...]


def classify(body: RigidBody, centre: Vector, omega: Vector, gamma: Vector) -> Classification:
    """Return the classical and the integrable cases of a state of a heavy body; raises MissingMomentError."""
    B = body.require_B("a classification")
    state = np.array([float(x) for x in (*omega, *gamma)])
    found = [
        _nearness(name, known, state) for name in CASES for known in [_relations(name, body, centre)] if known
    ]
    found.sort(key=lambda each: (each.distance is None, each.distance or 0.0))
    return Classification(tuple(found), tuple(_integrable(body, B, centre, state)))


@np.errstate(all="ignore")
def _nearness(name: str, known: list[CaseRelations], state: FloatArray) -> Nearness:
    each = [(_distance(relations, state), relations) for relations in known]
    reached = [(distance, relations) for distance, relations in each if distance is not None]
    distance, relations = min(reached, key=lambda pair: pair[0]) if reached else (None, known[0])
    values = {name: float(value[0]) for name, value in relations.values(state[None]).items()}
    is_on = distance is not None and is_within(distance, ON_CASE_RELATIVE_DISTANCE * _size(state))
    return Nearness(name, distance, values, is_on)


def _size(state: FloatArray) -> float:
    return max(1.0, float(np.linalg.norm(state)))


@np.errstate(all="ignore")
def _distance(relations: CaseRelations, state: FloatArray) -> float | None:
    """Return the distance of the state to which Newton's steps lead; None if they lead nowhere."""
    size, point = _size(state), state
    for _ in range(MAX_NEWTON_STEPS):
        try:
            step = relations.steps(point[None])[0]
        except np.linalg.LinAlgError:
            return None
        point = point + step
        if not is_within(float(np.linalg.norm(point - state)), MAX_RELATIVE_DISTANCE * size):
            return None
        if is_within(float(np.linalg.norm(step)), LAST_STEP_RELATIVE_LENGTH * size):
            return float(np.linalg.norm(point - state))
    return None


def _relations(name: str, body: RigidBody, centre: Vector) -> list[CaseRelations]:
    """Return the relations of each motion of a case that the body has; empty if it has none."""
    case, moments = CASES[name], (body.A, body.B, body.C)
    motion = ClassicalMotion(name, centre)
    try:
        if name == "bobylev_steklov" or case.form != "loop":
            first = fittings(motion, moments, allow_unphysical=True)[0]
            placed = Placed(first, motion, _NOWHERE, None, None, _ONE, _ONE)
            return [_of_bobylev_and_steklov(placed) if case.form == "loop" else relations_of(placed)]
        placed = place(motion, moments, allow_unphysical=True)
    except DynamicsError:
        return []
    directions: tuple[Sign, ...] = (1, -1)
    return [relations_of(replace(placed, motion=replace(motion, direction=each))) for each in directions]


def _of_bobylev_and_steklov(placed: Placed) -> CaseRelations:
    """Return the relations without the constants, which belong to each motion."""
    frame = placed.fitting.frame

    def of_numbers(number: Callable[[arb], Number]) -> Residuals:
        C, a = number(ball(placed.fitting.moments[2])), number(ball(frame.vector(placed.motion.centre)[0]))

        def residuals(states: States) -> Mapping[str, NDArray[Number]]:
            columns = list(states.T)
            p, q, r = frame.axial(columns[:3])
            g3 = frame.vector(columns[3:])[2]
            return {"q": q, "a*g3 - C*p*r": a * g3 - C * p * r, "|gamma|^2 - 1": unit_length(states)}

        return residuals

    return CaseRelations(of_numbers, 3)


def _integrable(body: RigidBody, B: Fraction, centre: Vector, state: FloatArray) -> list[Integrable]:
    size = float(sum(abs(c) for c in centre))
    found = [Integrable("euler", {"|centre|": size}, size == 0.0)]
    moments = (body.A, B, body.C)
    momentum = float(np.linalg.norm([float(m) * w for m, w in zip(moments, state[:3], strict=True)]))
    areas = abs(float(areas_integral(body, state[None, :3], state[None, 3:])[0]))
    for name, ratio in (("lagrange", None), ("kovalevskaya", 2), ("goriachev_chaplygin", 4)):
        best = min(
            (_of_axis(moments, centre, k, ratio, is_on_axis=ratio is None) for k in range(3)),
            key=lambda left: sum(left.values()),
        )
        if name == "goriachev_chaplygin":
            best[AREAS] = areas / momentum if momentum > 0.0 else 0.0
        holds = all(
            is_within(left, ON_CASE_RELATIVE_DISTANCE if key == AREAS else CONDITION_RELATIVE_ROUNDING)
            for key, left in best.items()
        )
        found.append(Integrable(name, best, holds))
    return found


def _of_axis(
    moments: Vector, centre: Vector, axis: int, ratio: int | None, *, is_on_axis: bool
) -> dict[str, float]:
    """Return what is left of the conditions with ``axis`` as the axis of symmetry of the body."""
    i, j = (k for k in range(3) if k != axis)
    length = sum((c * c for c in centre), Fraction(0))
    equal = abs(moments[i] - moments[j]) / (moments[i] + moments[j])
    astray = centre[i] ** 2 + centre[j] ** 2 if is_on_axis else centre[axis] ** 2
    found = {
        "difference of two moments": float(equal),
        "centre off its place": float(astray / length) ** 0.5 if length else 0.0,
    }
    if ratio is not None:
        found["their ratio to the third"] = abs(float(moments[i] / (ratio * moments[axis]) - 1))
    return found


_ZERO = (Fraction(0), Fraction(0), Fraction(0))
_NOWHERE = Start(_ZERO, _ZERO)
_ONE = arb(1)
