"""What the curve alone decides: whether a way through the poles is the only one."""

from fractions import Fraction

import pytest
from flint import ctx

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import make_loop
from service.dynamics.reduction.windows import REDUCTION_BITS
from tests.support.planar import body, formula


@pytest.mark.parametrize(
    ("A", "text", "unique"),
    [
        (2, "-g1", True),
        (2, "-g1 + (2*g1^2+g3^2)*exp(g2)", True),
        (4, "-g1*(4*g1^2+3*g3^2)", True),
        (3, "-g1", False),  # |g3|^3 is no polynomial
        (4, "-abs(g1)^(3/2)", False),  # the plane motion g1 = r = 0 passes the same state
        (2, "-abs(g1)", False),  # the force jumps
        (2, "-g1 + g3^4/g1", False),  # not defined at the pole
    ],
)
def test_the_way_through_a_pole_is_unique_where_curve_and_field_are_smooth(A, text, unique):
    rigid_body = body(A, 1)
    with ctx.workprec(REDUCTION_BITS):
        loop = make_loop(rigid_body, formula(text, rigid_body), PlanarMotion(Fraction(1)))
        assert loop.is_smooth_at_poles() == unique
