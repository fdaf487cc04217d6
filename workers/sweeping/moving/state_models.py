"""Bodies and potentials of motions from any state whose potential has numbers on axes, without its documents.

Points that share a template (:mod:`.templates`) share the operations of their formula and of its gradient;
the constants are put in as numbers. They are those that a document's formula leads to, to the last bit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.problem import Problem
from service.schemas.sweep.sweep import Sweep
from workers.solvers.compiled.general.records import Models
from workers.solvers.integration.compiled import moments_of
from workers.solvers.integration.errors import UnsupportedFormulaError
from workers.solvers.integration.interface import neighbour_of
from workers.solvers.integration.programs import SharedGradient, shared_gradient
from workers.sweeping.moving.models import model_of
from workers.sweeping.moving.templates import Key, Model, MomentsOfPoint, Template, shared_template

FloatArray = NDArray[np.float64]

MOST_TEMPLATES = 64


@dataclass(frozen=True, slots=True)
class Shared:
    """The program and the gradients that points of one structure share."""

    template: Template
    own: SharedGradient
    other: SharedGradient
    """With the constants that rounded ones might as well have been."""


@dataclass(frozen=True, slots=True)
class PointConstants:
    """The constants of one point."""

    shared: Shared
    constants: Sequence[float]
    slopes: Sequence[float]
    other_slopes: Sequence[float]


class SharedModels:
    """Finds the constants of points of one sweep."""

    def __init__(self, model: Model, problem: Problem) -> None:
        self._model, self._body = model, problem.body
        body = problem.body
        B = None if body.B is None else fmpq(body.B.numerator, body.B.denominator)
        self._moments = MomentsOfPoint(
            fmpq(body.A.numerator, body.A.denominator), B, fmpq(body.C.numerator, body.C.denominator)
        )
        self._shared: dict[Key, Shared | None] = {}

    @staticmethod
    def of(sweep: Sweep, problem: Problem) -> "SharedModels | None":
        """Return that of a sweep; None where a body varies, or a potential has no model."""
        potential = sweep.base["potential"]
        axes = [axis.path for axis in sweep.axes if axis.path[0] == "potential"]
        has_bodies = any(axis.path[0] == "body" for axis in sweep.axes)
        if not axes or has_bodies or not isinstance(potential, dict):
            return None
        model = model_of(potential, [path[1:] for path in axes], frozenset())
        return None if model is None else SharedModels(model, problem)

    def row(self, numbers: Sequence[fmpq]) -> PointConstants | None:
        """Return the constants of the potential with these numbers on its axes; None: read its document."""
        values = self._model.values(self._moments, numbers)
        if values is None:
            return None
        key = self._model.key(values)
        if key not in self._shared and len(self._shared) < MOST_TEMPLATES:
            self._shared[key] = self._new(numbers)
        shared = self._shared.get(key)
        if shared is None:
            return None
        exact = shared.template.numbers(values)
        constants = shared.template.row(exact)
        if not shared.template.is_of(constants):
            return None
        given = [None if number is None else Fraction(int(number.p), int(number.q)) for number in exact]
        slopes, other = shared.own.constants(given), shared.other.constants(given)
        if slopes is None or other is None:
            return None
        return PointConstants(shared, constants, slopes, other)

    def models(self, rows: Sequence[PointConstants]) -> Models:
        """Return the models of points of one structure."""
        shared = rows[0].shared
        gradient, count = shared.own.gradient, len(rows)
        own, other = (moments_of(self._body, rounding) for rounding in (nearest_double, neighbour_of))
        return Models(
            shared.template.program.code,
            shared.template.program.result,
            gradient.code,
            gradient.gradient,
            gradient.registers,
            np.array([row.constants for row in rows]).reshape(count, -1),
            np.array([row.slopes for row in rows]).reshape(count, -1),
            np.array([row.other_slopes for row in rows]).reshape(count, -1),
            np.tile(own, (count, 1)),
            np.tile(other, (count, 1)),
        )

    def _new(self, numbers: Sequence[fmpq]) -> Shared | None:
        template = shared_template(self._model, self._moments, numbers)
        probes = self._model.probes(self._moments, numbers)
        if template is None or probes is None:
            return None
        tapes = probes[0][1], probes[1][1]
        try:
            own, other = (shared_gradient(tapes, rounding) for rounding in (nearest_double, neighbour_of))
        except UnsupportedFormulaError:
            return None
        if own is None or other is None or not _are_alike(own, other):
            return None
        return Shared(template, own, other)


def _are_alike(one: SharedGradient, other: SharedGradient) -> bool:
    """Tell whether two programs are the same but for constants."""
    first, second = one.gradient, other.gradient
    return (
        first.registers == second.registers
        and len(first.constants) == len(second.constants)
        and np.array_equal(first.code, second.code)
        and np.array_equal(first.gradient, second.gradient)
    )
