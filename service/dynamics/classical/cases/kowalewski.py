"""N. Kowalewski 1908: the centre on the first axis, q² cubic and r² quadratic in p."""

from service.dynamics.classical.protocol import About, ClassicalCase, Number, Reduced, master


def condition(A: Number, B: Number, C: Number, _a: Number, _c: Number) -> Number:
    """Return A C − 9 (A − 2B)(B − C)."""
    return A * C - 9 * (A - 2 * B) * (B - C)


def reduced(B: Number, C: Number) -> Reduced:
    """Return the motion of a body with A = 1, in the scale K = 1."""
    d, e, f = 3 * B - 2, 2 * B - 1, 9 * B - 5
    B2 = B * B
    Q0 = (
        -(d**3)
        * (3 * B - 1)
        * (384 * B2 * B2 - 1112 * B2 * B + 1101 * B2 - 453 * B + 66)
        / (B2 * e**3 * f**2)
    )
    Q1 = -3 * d**2 * (3 * B - 1) * (384 * B2 * B - 624 * B2 + 333 * B - 58) / (B2 * e**2 * f)
    Q2 = d * (168 * B2 - 164 * B + 37) / (B2 * e)
    Q3 = -2 * f / B2
    R0 = -4 * d**3 * (3 * B - 1) / (9 * B2 * e**2)
    R1 = 16 * d**2 * (3 * B - 1) * f / (9 * B2 * e)
    R2 = -4 * f**2 / (9 * B2)
    h = -(d**3) * (3 * B - 1) ** 2 * (384 * B2 * B - 624 * B2 + 305 * B - 40) / (2 * B * e**2 * f**2)
    return master(B, C, (Q0, Q1, Q2, Q3), (R0, R1, R2), h)


CASE = ClassicalCase(
    name="kowalewski",
    centre="axis",
    condition=condition,
    reduce=lambda setting: reduced(setting.B, setting.C),
    example={"A": 1, "B": "5/8", "C": "9/8", "a": 1},
    about=About(
        title="The solution of N. Kowalewski",
        author="N. I. Kowalewski",
        year=1908,
        conditions=("b = c = 0", "A*C = 9*(A - 2*B)*(B - C)"),
        real="10/17 <= B/A < 0.6469380234",
        relations=("q^2 is a cubic polynomial in p", "r^2 is quadratic in p"),
        functions="hyperelliptic, genus 2",
        stability="linearly stable: all multipliers have the absolute value 1",
        source="attribution",
    ),
)
