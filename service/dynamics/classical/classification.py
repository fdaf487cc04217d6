"""The classical or integrable cases on which a state lies, and its distance from the others.

The distance from a case is that of the state of the case to which Newton's least steps onto its relations
lead. It is never less than the true distance, and for a near state more by a part of its size only.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.bounds import is_within
from service.dynamics.classical.bodies import fittings
from service.dynamics.classical.catalogue import CASES
from service.dynamics.classical.conditions import ROUNDING
from service.dynamics.classical.place import place
from service.dynamics.classical.placed import Placed, Start, ball
from service.dynamics.classical.reduced import Number
from service.dynamics.classical.relations import CaseRelations, Residuals, States, relations_of, unit_length
from service.dynamics.equations.euler_poisson import areas_integral
from service.dynamics.errors import DynamicsError
from service.dynamics.problem import ClassicalMotion, Sign

FloatArray = NDArray[np.float64]
Vector = tuple[Fraction, Fraction, Fraction]

ON_CASE = 1e-12
"""Distance, relative to the state where that is longer than 1, at which a state lies on a case."""
AREAS = "|areas integral| / |momentum|"
SETTLED = 1e-13
"""Length of a step, relative alike, that leads no farther."""
MOST_STEPS = 40
LONGEST = 10.0
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
    is_on = distance is not None and is_within(distance, ON_CASE * _size(state))
    return Nearness(name, distance, values, is_on)


def _size(state: FloatArray) -> float:
    return max(1.0, float(np.linalg.norm(state)))


@np.errstate(all="ignore")
def _distance(relations: CaseRelations, state: FloatArray) -> float | None:
    """Return the distance of the state to which Newton's steps lead; None if they lead nowhere."""
    size, point = _size(state), state
    for _ in range(MOST_STEPS):
        try:
            step = relations.steps(point[None])[0]
        except np.linalg.LinAlgError:
            return None
        point = point + step
        if not is_within(float(np.linalg.norm(point - state)), LONGEST * size):
            return None
        if is_within(float(np.linalg.norm(step)), SETTLED * size):
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
        holds = all(is_within(left, ON_CASE if key == AREAS else ROUNDING) for key, left in best.items())
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
