"""Planar motions with their attitude, in few words."""

from fractions import Fraction

import numpy as np

from service.dynamics.equations.orientation import (
    PRECESSION,
    QUATERNION,
    orientation_columns,
)
from service.dynamics.problem import PlanarMotion, TimePeriods
from tests.laws.test_quadrature_against_integration import ROWS, motion_of
from tests.support.planar import body, formula, planar
from tests.support.solving import solve_planar

THREE = TimePeriods(Fraction(3), 61)
PRECESSIONS = {
    # Δψ1 of the full period through both poles, A = 2C: two quadratures of 40 digits.
    "1/10": "5.5120364721307221375370458444",
    "3/10": "4.90615247386710676772089883",
    "1": "3.61050523508724966610354854487",
    "2": "2.50524535133020938452501058026",
    "10": "0.620644992774347028932194165871",
}


def solved(A, C, text, motion, tolerance=1e-10):
    rigid_body = body(A, C, "3/2")
    return solve_planar(planar(rigid_body, formula(text, rigid_body), motion, THREE, tolerance=tolerance))


def through_poles(nu="1", *, text="-g1", **asked):
    return solved(2, 1, text, PlanarMotion(None, Fraction(nu), **asked))


def quaternion_at(orientation, times):
    columns = orientation_columns(orientation.dense, np.asarray(times, dtype=float))
    return np.stack([columns[name] for name in QUATERNION], axis=1)


def sums(orientation):
    """What the angles gain over the stored period, by their own series."""
    end = dict(zip(orientation.dense.columns, orientation.dense.coefficients[-1].sum(axis=0), strict=True))
    return {name: end[name] for name in PRECESSION}


def solved_row(name):
    _, (A, B, C), potential, asked, _, _ = next(row for row in ROWS if row[0] == name)
    rigid_body = body(A, C, B)
    V = formula(potential, rigid_body)
    return rigid_body, V, solve_planar(planar(rigid_body, V, motion_of(asked), THREE))
