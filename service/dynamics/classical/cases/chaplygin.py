"""Chaplygin 1904: the centre on the first axis, p = s³; at s = 0 the body is at rest for an instant."""

from service.dynamics.classical.protocol import (
    About,
    ClassicalCase,
    Constants,
    Number,
    Reduced,
    Relations,
    State,
)


def condition(A: Number, B: Number, C: Number, _a: Number, _c: Number) -> Number:
    """Return 9A² − 18A(B + C) + 32BC."""
    return 9 * A * A - 18 * A * (B + C) + 32 * B * C


def reduced(B: Number, C: Number) -> Reduced:
    """Return the motion of a body with A = 1 in x = s, u = q/s, v = r/s, in the scale alpha = 1."""
    U4 = B * (C - 1) / (2 * B - 1)
    W4 = -C * (B - 1) / (2 * C - 1)
    W0 = 3 * (2 * B - 3) * (2 * B - 1) ** 2 * (16 * B - 9) / (8 * B * B * (5 * B - 3))
    beta, zero, one = B - C, 0 * B, 0 * B + 1
    U = (one / (B * beta), zero, zero, zero, U4 / (B * beta))
    V = (W0 / (C * beta), zero, zero, zero, W4 / (C * beta))
    constants = {"B": B, "C": C, "U4": U4, "W4": W4, "W0": W0}
    return Reduced(U, V, beta / 3, constants, _state, _relations)


def _state(k: Constants, s: Number, u: Number, v: Number) -> State:
    B, C, U4, W4, W0 = k["B"], k["C"], k["U4"], k["W4"], k["W0"]
    s2 = s * s
    s4 = s2 * s2
    p, q, r = s2 * s, s * u, s * v
    T1 = -(p * p + B * q * q + C * r * r) / 2
    return p, q, r, T1, u * ((1 - B - W4) * s4 - W0 / 3), v * ((1 - C + U4) * s4 + (0 * C + 1) / 3)


def _relations(k: Constants, state: State) -> Relations:
    # Written in what is smooth at s = 0 too, where q, r and p vanish: s² by p and q, and v by T3.
    B, C, U4, W4, W0 = k["B"], k["C"], k["U4"], k["W4"], k["W0"]
    p, q, r, T1, T2, T3 = state
    beta = B - C
    s2 = B * beta * q * q - U4 * p * p
    s4 = s2 * s2
    second, third = (1 - B - W4) * s4 - W0 / 3, (1 - C + U4) * s4 + (0 * C + 1) / 3
    v = T3 / third
    length = W0 * W0 / (9 * B * beta) + W0 / (9 * C * beta)
    return {
        "energy": T1 + (p * p + B * q * q + C * r * r) / 2,
        "gamma along the third axis": C * beta * v * v - W0 - W4 * s4,
        "p by p^(2/3)": p * v - r * s2,
        "gamma along the second axis": r * T2 - q * v * second,
        "|gamma|^2 - 1": (T1 * T1 + T2 * T2 + T3 * T3) / length - 1,
    }


CASE = ClassicalCase(
    name="chaplygin",
    centre="axis",
    condition=condition,
    reduce=lambda setting: reduced(setting.B, setting.C),
    example={"A": 1, "B": "31/20", "C": "189/316", "a": 1},
    about=About(
        title="The solution of Chaplygin",
        author="S. A. Chaplygin",
        year=1904,
        conditions=("b = c = 0", "9*A^2 - 18*A*(B + C) + 32*B*C = 0"),
        real="3/2 < B/A <= 1.5965002340823 (beyond it no body has these moments)",
        relations=("q^2 and r^2 are polynomials in p^(2/3)", "I3 = 0", "the energy is 0"),
        functions="hyperelliptic, genus 2",
        stability="unstable: the largest multiplier is 5.42",
        source="attribution",
    ),
)
