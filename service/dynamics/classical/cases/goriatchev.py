"""Goriachev 1899: the centre on the first axis, q² biquadratic and r² quadratic in p."""

from service.dynamics.classical.protocol import About, ClassicalCase, Number, Reduced, master


def condition(A: Number, B: Number, C: Number, _a: Number, _c: Number) -> Number:
    """Return A C − 8 (A − 2B)(B − C)."""
    return A * C - 8 * (A - 2 * B) * (B - C)


def reduced(B: Number, C: Number) -> Reduced:
    """Return the motion of a body with A = 1, in the scale K = 1."""
    b = 4 * B - 3
    Q0 = -b * b * (4 * B - 1) * (8 * B - 5) * (8 * B - 3) / (32 * B * B * (2 * B - 1) ** 2)
    Q2 = b * (48 * B * B - 44 * B + 9) / (2 * B * B * (2 * B - 1))
    Q4 = -(16 * B - 9) / (B * B)
    R0 = b * b * (4 * B - 1) * (16 * B - 9) / (32 * B * B * (2 * B - 1))
    R2 = -((16 * B - 9) ** 2) / (16 * B * B)
    h = -b * b * (4 * B - 1) * (64 * B * B - 56 * B + 9) / (32 * B * (2 * B - 1) * (16 * B - 9))
    zero = 0 * B
    return master(B, C, (Q0, zero, Q2, zero, Q4), (R0, zero, R2), h)


CASE = ClassicalCase(
    name="goriatchev",
    centre="axis",
    condition=condition,
    reduce=lambda setting: reduced(setting.B, setting.C),
    example={"A": 1, "B": "61/100", "C": "671/475", "a": 1},
    about=About(
        title="The solution of Goriachev",
        author="D. N. Goriachev",
        year=1899,
        conditions=("b = c = 0", "A*C = 8*(A - 2*B)*(B - C)"),
        real="3/5 <= B/A < 5/8",
        relations=("q^2 is a biquadratic polynomial in p", "r^2 is quadratic in p", "I3 = 0"),
        functions="elliptic",
        stability="linearly stable: all multipliers have the absolute value 1",
        source="attribution",
    ),
)
