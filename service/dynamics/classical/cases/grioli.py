"""Grioli 1947: regular precession about an axis that is not vertical; the centre in a principal plane."""

from service.dynamics.classical.protocol import (
    About,
    ClassicalCase,
    Constants,
    Number,
    Reduced,
    Relations,
    State,
)


def condition(A: Number, B: Number, C: Number, a: Number, c: Number) -> Number:
    """Return a²(B − C) − c²(A − B)."""
    return a * a * (B - C) - c * c * (A - B)


def reduced(B: Number, C: Number, ex: Number, ez: Number) -> Reduced:
    """Return the motion of a body with A = 1, n = 1, centre along (ex, 0, ez), in x = cos ψ, v = sin ψ."""
    one, zero = 0 * B + 1, 0 * B
    constants = {"ex": ex, "ez": ez, "J": 1 + C - B, "D": (1 - C) * ex * ez}
    return Reduced((one,), (one, zero, -one), one, constants, _state, _relations)


def _state(k: Constants, cos: Number, _u: Number, sin: Number) -> State:
    ex, ez, J, D = k["ex"], k["ez"], k["J"], k["D"]
    # T in the directions e, f1 = (ez, 0, -ex) and f2 = (0, 1, 0).
    along, first = -D * cos, J * cos - D * sin * sin
    second = J * sin + D * sin * cos
    return ex + cos * ez, sin, ez - cos * ex, along * ex + first * ez, second, along * ez - first * ex


def _relations(k: Constants, state: State) -> Relations:
    ex, ez = k["ex"], k["ez"]
    p, q, r, T1, T2, T3 = state
    cos = p * ez - r * ex
    _, _, _, S1, S2, S3 = _state(k, cos, cos, q)
    return {
        "spin about the centre": p * ex + r * ez - 1,
        "angular velocity squared": p * p + q * q + r * r - 2,
        "gamma along the first axis": T1 - S1,
        "gamma along the second axis": T2 - S2,
        "gamma along the third axis": T3 - S3,
    }


CASE = ClassicalCase(
    name="grioli",
    centre="plane",
    condition=condition,
    reduce=lambda setting: reduced(setting.B, setting.C, setting.ex, setting.ez),
    example={"A": 3, "C": "3/2", "a": "7/5", "c": 1},
    about=About(
        title="The regular precession of Grioli",
        author="G. Grioli",
        year=1947,
        conditions=("b = 0", "a^2*(B - C) = c^2*(A - B)"),
        real="all bodies: B is between A and C",
        relations=("the component of omega along the centre is n", "|omega|^2 = 2*n^2"),
        functions="elementary",
        stability="linearly stable: all multipliers have the absolute value 1",
        source="proved",
    ),
)
