"""Departures of the integrals along many motions: arrays of samples in, arrays of drifts out."""

from collections.abc import Mapping
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.further_integrals import FurtherIntegral
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from workers.solvers.compiled.evaluation.program import Program, make_program, rest_of, rests_of
from workers.solvers.compiled.integrals.drifts import energy_drifts, further_drifts, potential_energies

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ENERGY, GEOMETRIC, AREAS = range(3)
"""Columns of what :func:`drifts_of_many` returns."""


def energies_at(potential: Potential, samples: FloatArray) -> FloatArray:
    """Return V at ``samples`` (n, 6), the doubles that its balls round to; NaN where that is not known."""
    out = np.full(len(samples), np.nan)
    try:
        tape = potential.tape
    except NoClosedFormError:
        return out
    program, constants = make_program(tape)
    states = np.ascontiguousarray(samples, dtype=np.float64)
    potential_energies(program.code, program.result, constants, rests_of(tape, constants), states, out)
    return out


def drifts_of_many(
    body: RigidBody,
    program: Program,
    constants: FloatArray,
    rests: FloatArray,
    energies: FloatArray,
    samples: FloatArray,
    wanted: IntArray,
) -> FloatArray:
    """Return the largest departures of the three integrals of planar motions, shape (sets, 3).

    ``constants`` of the program and their ``rests`` are (sets, constants), ``samples`` (sets, n, 6), finite.
    The numbers are those of :func:`workers.solvers.evidence.drifts_of`; those of motions that are not
    ``wanted``, and energies of which twice the digits do not tell every double, are NaN.
    """
    out = np.full((len(samples), 3), np.nan)
    moments = np.array([float(body.A), 0.0 if body.B is None else float(body.B), float(body.C)])
    energy_drifts(
        program.code,
        program.result,
        constants,
        rests,
        moments,
        # Also where they are a column of others: one type of arguments is compiled.
        np.ascontiguousarray(energies),
        np.ascontiguousarray(samples),
        wanted,
        out,
    )
    return out


def further_drifts_of_many(integrals: Mapping[int, FurtherIntegral], samples: FloatArray) -> FloatArray:
    """Return each motion's integral at its first sample, and its largest departure, shape (sets, 2).

    ``integrals`` are those of some sets of ``samples`` (sets, n, 6), by their places; the others are NaN. The
    numbers are those of :func:`service.dynamics.further_integrals.integral_drift`, or NaN as those of
    :func:`drifts_of_many`. Cubic ones are NaN too: no motion of a sweep in blocks has one.
    """
    out = np.full((len(samples), 2), np.nan)
    numbers, row = np.zeros((len(samples), 10)), list[float]()
    last: FurtherIntegral | None = None
    for place, each in integrals.items():
        # Neighbours often share one.
        if each is not last:
            last, row = each, [part for number in _numbers(each) for part in _parts(number)]
        numbers[place] = row
    wanted = np.array([place for place, each in integrals.items() if not each.is_cubic], dtype=np.int64)
    further_drifts(numbers, np.ascontiguousarray(samples), wanted, out)
    return out


def _numbers(integral: FurtherIntegral) -> tuple[Fraction, ...]:
    C = integral.C
    return integral.a / C, integral.b / C, integral.c1 / C, integral.c2 / C, integral.b1 / C


def _parts(number: Fraction) -> tuple[float, float]:
    known = nearest_double(number)
    return known, rest_of(number, known)
