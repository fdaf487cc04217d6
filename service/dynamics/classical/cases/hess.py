"""Hess 1890: no momentum along the centre.

The centre is on the normal of a circular section of the gyration ellipsoid.

With x = |M|² the motion is one of a pendulum, elliptic in time, and the angle φ of the momentum in the
circular section satisfies an equation of Riccati:

    x'² = 4 (x (G² − (h − x/2B)²) − G² l²),   φ' = −k sqrt(x) cos φ − G l/x,   k = (a c/G²)(1/A − 1/C).

With l = 0 the momentum m = ±sqrt(x) itself is the coordinate: it passes through zero.
"""

from flint import arb

from service.dynamics.classical.protocol import (
    About,
    ClassicalCase,
    Coefficients,
    Constants,
    Number,
    Reduced,
    Relations,
    State,
)


def condition(A: Number, B: Number, C: Number, a: Number, c: Number) -> Number:
    """Return A a²(B − C) − C c²(A − B)."""
    return A * a * a * (B - C) - C * c * c * (A - B)


def momentum_along(A: Number, C: Number, a: Number, c: Number, p: Number, r: Number) -> Number:
    """Return A a p + C c r, which is zero for ever if it is once."""
    return A * a * p + C * c * r


def reduced(B: Number, G: Number, h: Number, areas: Number) -> Reduced:
    """Return the motion of x = |M|² with v = x'/2, or, without areas, that of m with v = m'."""
    zero, one = 0 * G, 0 * G + 1
    if areas == 0:
        V: Coefficients = (G * G - h * h, zero, h / B, zero, -one / (4 * B * B))
        return Reduced((one,), V, one, {}, _none, _no_relations)
    V = (-G * G * areas * areas, G * G - h * h, h / B, -one / (4 * B * B))
    return Reduced((one,), V, 2 * one, {}, _none, _no_relations)


def _none(_k: Constants, _x: Number, _u: Number, _v: Number) -> State:
    raise NotImplementedError("the state needs the angle of the momentum as well")


def _no_relations(_k: Constants, _state: State) -> Relations:
    return {}


def angle_rate(A: arb, C: arb, a: arb, c: arb) -> arb:
    """Return k."""
    return a * c / (a * a + c * c) * (1 / A - 1 / C)


CASE = ClassicalCase(
    name="hess",
    centre="plane",
    condition=condition,
    form="hess",
    parameters={
        "omega": "[p, q, r] at time 0, any numbers with A*a*p + C*c*r = 0; null for p or r,"
        " which then follows",
        "gamma": "[g1, g2, g3] at time 0, of length 1 within 1e-12",
    },
    example={
        "A": 3,
        "C": "3/2",
        "a": 1,
        "c": 1,
        "omega": ["3/10", "7/10", None],
        "gamma": ["3/5", "12/25", "16/25"],
    },
    about=About(
        title="The solution of Hess",
        author="W. Hess",
        year=1890,
        conditions=("b = 0", "A*a^2*(B - C) = C*c^2*(A - B)"),
        real="all bodies: B is between A and C; all energies and areas",
        relations=("A*a*p + C*c*r = 0",),
        functions="elliptic, and a Riccati equation over them",
        stability="unstable: an integration of the six equations leaves the case exponentially",
        source="proved",
    ),
)
