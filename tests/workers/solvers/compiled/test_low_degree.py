"""Which potentials are sums of low powers: of the others alone the series of the time map are proved."""

import pytest

from tests.support.planar import body, formula
from workers.solvers.compiled.evaluation.curve import is_of_low_degree
from workers.solvers.compiled.evaluation.program import make_program
from workers.solvers.compiled.solve_set import new_formula

BODY = body(2, 1)


def is_low(text: str) -> bool:
    program, constants = make_program(formula(text, BODY).tape)
    return bool(is_of_low_degree(new_formula(*program[:3], constants)))


@pytest.mark.parametrize(
    "text",
    [
        "-g1",
        "-g1 + 1/(20*g3^2)",
        "(A*g1^2+C*g3^2)*(g2^2-1/2+g2^3/5) - abs(g1)^(4/3)/3 + 1/(200*g3^4)",
        "16*g1*(8*g1^4+16*g1^2*g3^2+9*g3^4) + 16*g3^6/g1 - g3^8/g1^3",
        "-g1 + (g1 - g2)^2",
        "g1*exp(1/7) + sin(2)^3/(g3^2*(1 + exp(1/2)^pi))",
    ],
)
def test_sums_of_low_powers_are(text):
    assert is_low(text)


@pytest.mark.parametrize(
    "text",
    [
        "(2*g1^2+g3^2)*exp(-10^6*(g2-3/10)^2)",
        "(2*g1^2+g3^2)/(1+10^6*(g2-3/10)^2)",
        "(2*g1^2+g3^2)*(1-(g2-3/10)^2)^1000",
        "(2*g1^2+g3^2)*abs(g2-1/3)",
        "(2*g1^2+g3^2)*((g2-3/10)^2+1e-6)^(1/2)",
        "(2*g1^2+g3^2)/g2^2",
        "(2*g1^2+g3^2)*exp(1/7*g2)",
        "g3^2*((1-g2^2)^4)^4",
    ],
)
def test_what_may_have_a_narrow_feature_is_not(text):
    assert not is_low(text)
