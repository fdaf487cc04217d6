"""The reduced motion as formulas, against the derivative of the potential, which they do without."""

from fractions import Fraction

import pytest
from flint import ctx

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.potentials.families.written import expression_potential
from service.dynamics.reduction.formulas import reduced_motion
from service.dynamics.verdict.verdict import decide

CASES = [
    ("2", "1", "-g1 + 1/(20*g3^2)"),
    ("2", "1", "-2*g1 + 6/5*(g1^2 - g2^2) + 3/10*(2*g1^2 + g3^2)*g2^3"),
    ("4", "2", "-g1 + 1/g3^2"),
    ("3", "1", "abs(g1)^(4/3)*(-1) + (3*g1^2 + g3^2)*g2^4"),
    ("4", "1", "g1*(4*g1^2 + 3*g3^2) + (4*g1^2 + g3^2)*g2"),
    ("1", "2", "-g3 + (g1^2 + 2*g3^2)/3"),
]


@pytest.mark.parametrize(("A", "C", "text"), CASES)
@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, 1), (1, -1, -1), (-1, -1, -1)])
def test_p_and_the_speed_are_those_that_the_force_asks_for(
    A: str, C: str, text: str, signs: tuple[int, int, int]
) -> None:
    # s² = D/((A − C) A C g1 g3), p = −C g3 s and dg1/dt = A g1 g2 s: without h, with the derivative D of V.
    body = RigidBody(Fraction(A), None, Fraction(C))
    potential = expression_potential(text, {}, body)
    verdict = decide(body, potential)
    quadrant = "".join("p" if sign > 0 else "m" for sign in (signs[0], signs[2]))
    h = verdict.energy_formula or (verdict.energy_formulas or {})[quadrant]
    found = reduced_motion(
        body, potential.tree, parse(h), g1_sign=signs[0], g2_sign=signs[1], g3_sign=signs[2]
    )
    in_nu = body.A == 2 * body.C
    names = ("g1", "nu" if in_nu else "lambda")
    balls = BallAlgebra()
    with ctx.workprec(160):
        # A point of the curve with |g1| = 27/125, which has a rational cube root, and λ or |ν| = 4/5.
        x, curve = Fraction(27, 125), Fraction(4, 5)
        g1, size = balls.constant(signs[0] * x), balls.constant(curve)
        inputs = (g1, balls.constant(signs[0] * curve) if in_nu else size)
        squares = {
            name: compile_tape(tree, names).evaluate(balls, inputs)
            for name, tree in (
                ("g3", found.curve),
                ("p", found.p_squared),
                ("speed", found.speed_squared),
            )
        }
        g3 = signs[2] * squares["g3"].sqrt()
        g2 = signs[1] * (1 - g1 * g1 - g3 * g3).sqrt()
        D = potential.D_ball(g1, g2, g3)
        moments = balls.constant((body.A - body.C) * body.A * body.C)
        s_squared = D / (moments * g1 * g3)
        p_squared = (balls.constant(body.C) * g3) ** 2 * s_squared
        speed_squared = (balls.constant(body.A) * g1 * g2) ** 2 * s_squared
        # Both are enclosures of the same numbers, of 160 bits.
        assert p_squared.is_finite()
        assert p_squared.overlaps(squares["p"])
        assert speed_squared.overlaps(squares["speed"])
        assert p_squared.rad() < 1e-40
        assert squares["p"].rad() < 1e-40
