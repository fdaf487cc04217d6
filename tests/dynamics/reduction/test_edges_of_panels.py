"""A window is found once, wherever the panels end on which the radicand is resolved.

V = Q F(γ₂) with Q = A γ₁² + C γ₃² has the energy 0 at every λ: p² > 0 exactly where F < 0.
With F = (γ₂ − δ)² − ε² that is |γ₂ − δ| < ε. The critical point between is next to the
equator, an edge of panels, and so flat that it is looked for in balls, from both of them.
"""

from fractions import Fraction

from flint import arb, ctx

from service.dynamics.formula.algebras.ball import ball
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.windows import find_windows
from tests.support.effort import each_once
from tests.support.planar import body, formula

DOUBLE = body(2, 1)
CLOSE = 2.0**-100
"""The reduction works in 160 bits; next to a critical value of 1e-24 a root has some 120 of them."""


@each_once(
    sign=[1, -1],
    size=["1e-3", "3e-4", "9e-5", "1e-5", "1e-8"],
    half_width=["1/100", "1e-3", "2e-4", "1e-5", "1e-7", "1e-12"],
)
def test_one_window_stays_one(half_width, size, sign):
    epsilon, delta = Fraction(half_width), sign * Fraction(size)
    potential = formula("(2*g1^2 + g3^2)*((g2 - d)^2 - e^2)", DOUBLE, {"d": delta, "e": epsilon})
    (window,) = find_windows(DOUBLE, potential, PlanarMotion(Fraction(1, 2)))
    (arc,) = window.arcs
    with ctx.workprec(200):
        for v, g2 in ((arc.lower, delta + epsilon), (arc.upper, delta - epsilon)):
            # On the equator itself γ₂/cos v is 0/0.
            found = arc.loop.point(v).g2 if g2 else arb.pi() / 2 - v
            assert abs(found - ball(g2)).upper() < CLOSE


def test_a_document_that_once_had_a_window_without_width():
    text = "(A*g1^2 + C*g3^2)*(k + u*g2 + v*g2^2 + w*g2^3 + s*cos(4*g2)) + b*abs(g1)^(3/2) + c*abs(g3)^(-6)"
    numbers = {
        "k": "-8831.949815089072",
        "s": "1.317",
        "u": "-3.263",
        "v": "-0.713",
        "w": "-0.188",
        "b": "1381/10000",
        "c": "373/2500",
    }
    rigid_body = body("158/25", "79/50")
    potential = formula(text, rigid_body, {name: Fraction(value) for name, value in numbers.items()})
    (window,) = find_windows(rigid_body, potential, PlanarMotion(Fraction("0.2409"), g3_sign=-1))
    assert window.g2[0] < window.g2[1]
