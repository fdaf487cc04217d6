"""What the tests of the paper compute with: exact derivatives and the service's operators."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import sympy

from service.dynamics.body import RigidBody
from service.dynamics.equations.compatibility import energy_on_curve, pde_residual
from service.dynamics.equations.euler_poisson import StateRates, euler_poisson_rhs
from service.dynamics.formula.algebras.symbolic import sympy_expression
from service.dynamics.potentials.potential import Potential

A, B, C, ALPHA = sympy.symbols("A B C alpha", positive=True)
G1, G3, NU = sympy.symbols("g1 g3 nu", positive=True)
G2 = sympy.Symbol("g2", real=True)
GAMMA = (G1, G2, G3)
RHO = G1**2 + G3**2
Q = A * G1**2 + C * G3**2

Number: TypeAlias = sympy.Expr | int
"""SymPy's own, or a Python integer, which they mix with exactly."""


# The general V = Q (J + G(g2)). Of its integral J one derivative is known: that along g1 d_3 - g3 d_1,
# which keeps g1² + g3², so that only the upper limit moves: it is F/Q² times that of Q.
GENERAL_F, _J, _J1, _G, _G_SLOPE = sympy.symbols("F J J1 G G_SLOPE")
_J3 = (GENERAL_F / Q**2 * (G1 * Q.diff(G3) - G3 * Q.diff(G1)) + G3 * _J1) / G1
GENERAL_V = Q * (_J + _G)
GENERAL_GRADIENT = (
    Q.diff(G1) * (_J + _G) + Q * _J1,
    Q * _G_SLOPE,
    Q.diff(G3) * (_J + _G) + Q * _J3,
)


def gradient(V: sympy.Expr, power_1: Number = 0, power_3: Number = 0) -> list[sympy.Expr]:
    """Return the gradient of V g1^power_1 g3^power_3, divided by that monomial."""
    return [V.diff(G1) + power_1 * V / G1, V.diff(G2), V.diff(G3) + power_3 * V / G3]


def L(
    V: sympy.Expr, first: Number = A, third: Number = C, power_1: Number = 0, power_3: Number = 0
) -> sympy.Expr:
    """Return the service's L(V g1^power_1 g3^power_3), divided by that monomial: a rational function."""
    slopes = gradient(V, power_1, power_3)
    rows = [gradient(slope, power_1, power_3) for slope in slopes]
    return pde_residual(first, third, GAMMA, slopes, rows)


def H(
    V: sympy.Expr, first: Number = A, third: Number = C, power_1: Number = 0, power_3: Number = 0
) -> sympy.Expr:
    """Return the service's H[V g1^power_1 g3^power_3], divided by that monomial."""
    return energy_on_curve(first, third, GAMMA, V, gradient(V, power_1, power_3))


def is_zero(expression: sympy.Expr) -> bool:
    """Say whether a rational function, free of floating-point numbers, is identically zero."""
    expression = expression + sympy.Integer(0)
    assert not expression.has(sympy.Float)
    return bool(sympy.fraction(sympy.together(expression))[0].expand() == 0)


def symbolic(potential: Potential) -> sympy.Expr:
    """Return what the service's potential computes as an expression in GAMMA."""
    return sympy_expression(potential.tape, GAMMA)


def series_2f1(degree: int, a: Number, b: Number, c: Number, z: sympy.Expr) -> sympy.Expr:
    """Return Gauss's series 2F1(a, b; c; z) up to z^degree, where a or b ends it."""
    total = term = sympy.Integer(1)
    for j in range(degree):
        term = term * (a + j) * (b + j) / ((c + j) * (j + 1)) * z
        total += term
    assert is_zero((a + degree) * (b + degree)), "the series does not end there"
    return total


def printed_rates(
    moments: Sequence[Number], slope: Sequence[Number], omega: Sequence[Number], gamma: Sequence[Number]
) -> tuple[list[Number], list[Number]]:
    """Return ((A p', B q', C r'), gamma') solved from equations (1) and (2) as printed."""
    A, B, C = moments
    (p, q, r), (g1, g2, g3), (V1, V2, V3) = omega, gamma, slope
    first = [
        g2 * V3 - g3 * V2 - (C - B) * q * r,
        g3 * V1 - g1 * V3 - (A - C) * p * r,
        g1 * V2 - g2 * V1 - (B - A) * p * q,
    ]
    return first, [r * g2 - q * g3, p * g3 - r * g1, q * g1 - p * g2]


def service_rates(
    rigid_body: RigidBody, potential: Potential, omega: Sequence[float], gamma: Sequence[float]
) -> StateRates:
    """Return the service's right-hand sides at one state."""
    return euler_poisson_rhs(rigid_body, potential, np.array(omega, float), np.array(gamma, float))
