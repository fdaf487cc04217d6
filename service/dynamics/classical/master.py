"""The cases with the centre on the first axis and q² = Q(p), r² = R(p): what Q and R determine.

With A = 1, β = B − C and |centre| γ = T,

    T1 = h − (p² + B Q + C R)/2,   T2 = q ((1−B) p − C β R'/2),   T3 = r ((1−C) p + B β Q'/2),   p' = β q r.
"""

from service.dynamics.classical.reduced import (
    Coefficients,
    Constants,
    Number,
    Reduced,
    Relations,
    State,
    derivative,
    value,
)


def master(B: Number, C: Number, Q: Coefficients, R: Coefficients, h: Number) -> Reduced:
    """Return the reduced motion with x = p, u = q, v = r."""
    constants = {"B": B, "C": C, "h": h, "Q": Q, "R": R, "dQ": derivative(Q), "dR": derivative(R)}
    return Reduced(Q, R, B - C, constants, _state, _relations)


def _state(k: Constants, p: Number, q: Number, r: Number) -> State:
    B, C = k["B"], k["C"]
    beta = B - C
    T1 = k["h"] - (p * p + B * value(k["Q"], p) + C * value(k["R"], p)) / 2
    T2 = q * ((1 - B) * p - C * beta * value(k["dR"], p) / 2)
    T3 = r * ((1 - C) * p + B * beta * value(k["dQ"], p) / 2)
    return p, q, r, T1, T2, T3


def _relations(k: Constants, state: State) -> Relations:
    p, q, r, T1, T2, T3 = state
    _, _, _, S1, S2, S3 = _state(k, p, q, r)
    return {
        "q^2 - Q(p)": q * q - value(k["Q"], p),
        "r^2 - R(p)": r * r - value(k["R"], p),
        "gamma along the centre": T1 - S1,
        "gamma along the second axis": T2 - S2,
        "gamma along the third axis": T3 - S3,
    }
