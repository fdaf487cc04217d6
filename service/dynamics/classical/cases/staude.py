"""Staude 1894: steady rotations about the vertical; any body, any centre."""

from collections.abc import Sequence

from flint import arb

from service.dynamics.classical.protocol import About, ClassicalCase, Number, Relations


def cone(moments: Sequence[Number], centre: Sequence[Number], g: Sequence[Number]) -> Number:
    """Return what vanishes on Staude's cone of axes."""
    (A, B, C), (a, b, c), (x, y, z) = moments, centre, g
    return a * (B - C) * y * z + b * (C - A) * z * x + c * (A - B) * x * y


def torques(
    moments: Sequence[Number], centre: Sequence[Number], g: Sequence[Number]
) -> tuple[tuple[Number, Number, Number], tuple[Number, Number, Number]]:
    """Return K and N: the rotation w g is steady if w² K + N = 0."""
    (A, B, C), (a, b, c), (x, y, z) = moments, centre, g
    return ((B - C) * y * z, (C - A) * z * x, (A - B) * x * y), (c * y - b * z, a * z - c * x, b * x - a * y)


def relations(
    moments: Sequence[Number], centre: Sequence[Number], omega: Sequence[Number], g: Sequence[Number]
) -> Relations:
    """Return what vanishes in steady rotations: the rates of all six variables."""
    (A, B, C), (a, b, c), (p, q, r), (x, y, z) = moments, centre, omega, g
    return {
        "A*p'": (B - C) * q * r + c * y - b * z,
        "B*q'": (C - A) * r * p + a * z - c * x,
        "C*r'": (A - B) * p * q + b * x - a * y,
        "g1'": r * y - q * z,
        "g2'": p * z - r * x,
        "g3'": q * x - p * y,
    }


def spin_squared(moments: Sequence[arb], centre: Sequence[arb], g: Sequence[arb]) -> arb | None:
    """Return w² of the axis g of the cone, negative if −g is the one; None if every w will do.

    Not a number if none will.
    """
    K, N = torques(moments, centre, g)
    # Exact zeros, of an axis that is given by exact numbers, are exact here.
    if all(k == 0 for k in K):
        return None if all(n == 0 for n in N) else arb("nan")
    return -sum((k * n for k, n in zip(K, N, strict=True)), arb(0)) / sum((k * k for k in K), arb(0))


CASE = ClassicalCase(
    name="staude",
    centre="any",
    condition=None,
    form="steady",
    parameters={
        "gamma": "the direction of the axis, of any length, on the cone a*(B-C)*g2*g3 + b*(C-A)*g3*g1 +"
        " c*(A-B)*g1*g2 = 0; null for one component that then follows. That of both ends is taken for which"
        " the spin is real, which is one for every direction of the cone",
        "spin": "only about a principal axis that holds the centre: the rate of rotation, any number",
        "direction": "-1 for the rotation the other way; 1 if left out",
    },
    example={
        "A": 3,
        "B": 2,
        "C": "3/2",
        "a": 1,
        "b": "1/2",
        "c": "1/4",
        "gamma": [1, -1, None],
    },
    about=About(
        title="The steady rotations of Staude",
        author="O. Staude",
        year=1894,
        conditions=("none: any body, any centre",),
        real="every direction of the cone, at one of its two ends",
        relations=("omega = w*gamma, constant", "gamma on Staude's cone"),
        functions="constant",
        stability="linearly stable: no eigenvalue has a real part",
        source="proved",
    ),
)
