"""Where the formula is even in the axis that changes its sign at the poles, one half of the loop says all."""

from fractions import Fraction

import pytest
from flint import ctx

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction import arcs_of_loop
from service.dynamics.reduction.arcs_of_loop import is_even
from service.dynamics.reduction.geometry.loop import make_loop
from service.dynamics.reduction.structure import proved_half
from service.dynamics.reduction.windows import REDUCTION_BITS
from tests.support.admissible import sampled_cases
from tests.support.planar import body, formula

Q = "(A*g1^2+C*g3^2)"
EVEN = [
    *(((2, 1), "-g1", Fraction(n, 7), 1) for n in (1, 5, 7, 20)),
    ((2, 1), "-g1+1/(20*g3^2)", Fraction(1), -1),
    ((2, 1), f"-{Q}*(g2^2-1/3)^2*exp(g2)", Fraction(1), 1),
    ((1, "17/10"), f"{Q}*(g2^2-1/2)", Fraction(6, 5), 1),
    (("17/10", 1), f"{Q}*(g2^2-1/2)*exp(g2)", Fraction(6, 5), 1),
    ((2, 1), f"-{Q}*sqrt(g2-1/10)", Fraction(1), 1),
    *(((case.A, case.C), case.text, case.motion.lambda_, 1) for case in sampled_cases(12, 3)),
]


def balls(half):
    zeros = [(zero.v.mid().man_exp(), zero.v.rad().man_exp(), zero.kind) for zero in half.zeros]
    return zeros, half.signs, half.first_pole, half.last_pole, half.slow


@pytest.mark.one_in(4)
@pytest.mark.parametrize(("moments", "text", "lambda_", "g3_sign"), EVEN)
def test_the_mirror_image_is_the_other_half_to_the_last_bit(moments, text, lambda_, g3_sign):
    rigid_body = body(*moments)
    potential = formula(text, rigid_body)
    with ctx.workprec(REDUCTION_BITS):
        loop = make_loop(rigid_body, potential, PlanarMotion(lambda_))
        assert is_even(loop)
        half = proved_half(loop, g3_sign)
        assert half.slow == ()
        image = arcs_of_loop._mirror_half(loop, half, g3_sign, scan_of_nothing)
        assert balls(image) == balls(proved_half(loop, -g3_sign))


def scan_of_nothing(*given):
    raise AssertionError("the half is looked at again")


def test_a_formula_that_is_not_even_has_two_different_halves():
    rigid_body = body(2, 1)
    potential = formula("-g1 + (2*g1^2+g3^2)*g3*0 + g1*g3/1000000", rigid_body)
    with ctx.workprec(REDUCTION_BITS):
        loop = make_loop(rigid_body, potential, PlanarMotion(Fraction(1)))
        half = proved_half(loop, 1)
        with pytest.raises(AssertionError, match="looked at again"):
            arcs_of_loop._mirror_half(loop, half, 1, scan_of_nothing)
