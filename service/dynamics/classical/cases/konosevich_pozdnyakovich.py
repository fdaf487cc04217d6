"""Konosevich and Pozdnyakovich 1968: two bodies; p = p0 + s², and q², r² are quartic polynomials in s."""

from flint import arb, fmpq_poly

from service.dynamics.classical.protocol import (
    About,
    ClassicalCase,
    Constants,
    Number,
    Reduced,
    Relations,
    State,
    derivative,
    real_roots,
    value,
)

MINIMAL = (-9568, 118960, -627920, 1823596, -3146990, 3227896, -1822945, 437511)
"""Minimal polynomial of B for A = 1, degree 0 first; the largest of its three real roots has no real
motion."""


def moments() -> tuple[tuple[arb, arb], ...]:
    """Return B and C, for A = 1, of the two bodies."""
    return tuple((B, second(B)) for B in real_roots(fmpq_poly(list(MINIMAL)))[:2])


def second(B: Number) -> Number:
    """Return C."""
    return 4 * (2 * B - 1) / (17 * B - 8)


def reduced(B: Number, C: Number) -> Reduced:
    """Return the motion of a body with A = 1 in x = s, u = q, v = r/s, in the scale u3 = 1."""
    e, f, g, k = 2 * B - 1, 17 * B - 8, 9 * B - 4, 5 * B - 2
    beta, b2 = B - C, (B - 1) ** 2
    p0 = -(e**2) * f**2 * (949 * B**3 - 1908 * B**2 + 1224 * B - 248) / (48 * B**2 * b2 * k * g**2)
    u1 = e**2 * f**2 * (17 * B**2 - 16 * B + 4) * (97 * B**2 - 108 * B + 28) / (16 * B**2 * b2 * k**2 * g**2)
    u2 = e * f * (319 * B**3 - 588 * B**2 + 354 * B - 68) / (24 * B * b2 * k * g)
    u4 = -B * g / (e * f)
    w2 = e**3 * f**2 * (127 * B**3 - 54 * B**2 - 48 * B + 16) / (12 * B**3 * (B - 1) * k * g**2)
    w3 = -2 * e**2 * (3 * B - 2) * f / (B**2 * k)
    w4 = 4 * (B - 1) * e / B
    q1, q2, q3, q4 = (u / (B * beta) for u in (u1, u2, 0 * B + 1, u4))
    v0, v1, v2 = (w / (C * beta) for w in (w2, w3, w4))
    # What is left of the equations of the second and of the third component at s = 0 gives q0 and the energy.
    G2 = (1 - B) * p0 - C * beta * v0 / 2
    q0 = 2 * q1 * (G2 - B * p0) / (3 * C * beta * v1)
    left = beta * (v0 * ((1 - C) * p0 + B * beta * q2 / 2) / 2 + B * beta * v1 * q1 / 16)
    h = left + (p0 * p0 + B * q0) / 2 + p0 * G2
    Q, V = (q0, q1, q2, q3, q4), (v0, v1, v2)
    constants = {"B": B, "C": C, "p0": p0, "h": h, "Q": Q, "V": V, "dQ": derivative(Q), "dV": derivative(V)}
    return Reduced(Q, V, beta / 2, constants, _state, _relations)


def _state(k: Constants, s: Number, u: Number, v: Number) -> State:
    B, C = k["B"], k["C"]
    beta, p, r = B - C, k["p0"] + s * s, s * v
    V = value(k["V"], s)
    T1 = k["h"] - (p * p + B * value(k["Q"], s) + C * s * s * V) / 2
    T2 = u * ((1 - B) * p - C * beta * (V + s * value(k["dV"], s) / 2) / 2)
    T3 = v * (s * (1 - C) * p + B * beta * value(k["dQ"], s) / 4)
    return p, u, r, T1, T2, T3


def _relations(k: Constants, state: State) -> Relations:
    p, q, r, T1, T2, T3 = state
    y = p - k["p0"]
    q0, q1, q2, q3, q4 = k["Q"]
    s = (q * q - q0 - y * (q2 + q4 * y)) / (q1 + q3 * y)
    _, _, _, S1, S2, S3 = _state(k, s, q, r / s)
    return {
        "p - p0 - s^2, s by q^2": s * s - y,
        "r^2 - R(s)": r * r - s * s * value(k["V"], s),
        "gamma along the centre": T1 - S1,
        "gamma along the second axis": T2 - S2,
        "gamma along the third axis": T3 - S3,
    }


CASE = ClassicalCase(
    name="konosevich_pozdnyakovich",
    centre="axis",
    condition=None,
    ratios=moments,
    solutions=2,
    reduce=lambda setting: reduced(setting.B, setting.C),
    example={"A": 1, "a": 1, "solution": 1},
    about=About(
        title="The solutions of Konosevich and Pozdnyakovich",
        author="B. I. Konosevich; E. V. Pozdnyakovich",
        year=1968,
        conditions=("b = c = 0", "B/A is one of two roots of a polynomial of degree 7: body 1 or body 2"),
        real="body 1: B/A = 0.41190..., C/A = 0.70644...; body 2: B/A = 0.70818..., C/A = 0.41233...",
        relations=("p = p0 + s^2", "q^2 and r^2 are quartic polynomials in s"),
        functions="hyperelliptic, genus 2",
        stability="unstable: the largest multiplier is 9.11; of body 2 it is 921",
        source="attribution",
    ),
)
