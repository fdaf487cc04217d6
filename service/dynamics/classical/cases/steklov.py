"""Steklov 1899: the centre on the first axis, q² and r² quadratic in p with two terms; any moments."""

from service.dynamics.classical.protocol import About, ClassicalCase, Number, Reduced, master


def reduced(B: Number, C: Number) -> Reduced:
    """Return the motion of a body with A = 1, in the scale h = 1: it is real only for h > 0."""
    beta, D = B - C, 2 * B * C - 2 * B - 2 * C + 1
    zero, one = 0 * B, 0 * B + 1
    Q = (2 * (2 * C - 1) / (beta * D), zero, (C - 1) / (beta * (2 * B - 1)))
    R = (-2 * (2 * B - 1) / (beta * D), zero, -(B - 1) / (beta * (2 * C - 1)))
    return master(B, C, Q, R, one)


CASE = ClassicalCase(
    name="steklov",
    centre="axis",
    condition=None,
    reduce=lambda setting: reduced(setting.B, setting.C),
    example={"A": 1, "B": "9/10", "C": "2/5", "a": 1},
    about=About(
        title="The solution of Steklov",
        author="V. A. Steklov",
        year=1899,
        conditions=("b = c = 0",),
        real="exactly one of B and C is below A/2, and neither is A",
        relations=("q^2 and r^2 are linear in p^2", "g2 is a multiple of p*q, g3 of p*r", "I3 = 0"),
        functions="elliptic",
        stability="linearly stable; with B = 6/5 unstable, the largest multiplier is 5.13",
        source="attribution",
    ),
)
