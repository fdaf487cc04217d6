import numpy as np
import pytest
from flint import arb, ctx

from tests.support.planar import body, formula
from workers.solvers.compiled.evaluation.interpreter import derivative, derivative_with_bound
from workers.solvers.compiled.evaluation.program import make_program
from workers.solvers.compiled.solve_set import new_formula

BODY = body(3, 1)
FORMULAS = [
    "-g1",
    "(3*g1^2+g3^2)*(g2^2-1/2+g2^3/5)",
    "abs(g1)^(4/3)/7 - 2*abs(g3)^(-4)",
    "exp(-g1*g3) + log(abs(g3)) - sin(g1)*cos(g2) + tan(g3/2)",
    "sqrt(1+g1^2)*abs(g3) - g1/(2+g2)",
    "(2+g1)^(g3+g2) + pi*g1^40",
    "16*g1*(8*g1^4+16*g1^2*g3^2+9*g3^4) + 16*g3^6/g1 - g3^8/g1^3",
]


@pytest.mark.parametrize("text", FORMULAS)
def test_the_derivative_is_that_of_balls_within_its_bound(text):
    potential = formula(text, BODY)
    program, constants = make_program(potential.tape)
    worked = new_formula(program.code, program.result, constants)
    points = np.random.default_rng(1).normal(size=(3, 50))
    points /= np.linalg.norm(points, axis=0)
    found = derivative_with_bound(worked, *points, 50)
    together = [part.copy() for part in found]
    for k, (D, ulps) in enumerate(zip(*together, strict=True)):
        with ctx.workprec(200):
            exact = potential.D_ball(*(arb(x) for x in points[:, k].tolist()))
            off = abs(float(arb(D) - exact))
        # First order in the roundings of every operation, none left out.
        assert off <= ulps * 2.0**-53
        # No digit depends on the points that are gone through with it.
        alone = np.ascontiguousarray(points[:, k : k + 1])
        assert derivative(worked, *alone, 1)[0] == D
