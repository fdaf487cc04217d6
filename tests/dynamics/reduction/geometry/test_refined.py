"""A loop that was computed with more bits before is the one that is computed anew, to the last bit."""

from fractions import Fraction

from flint import ctx
from hypothesis import given
from hypothesis import strategies as st

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import make_loop
from tests.support.planar import body, formula


def bits(ball):
    return ball.mid().man_exp(), ball.rad().man_exp()


@given(
    st.sampled_from(["17/10", 2, 3, "1/2"]),
    st.fractions(Fraction(1, 5), 4, max_denominator=100),
    st.sampled_from([160, 320, 640]),
)
def test_refined_loops_are_kept_by_their_precision(moment, size, precision):
    rigid_body = body(moment, 1)
    potential, motion = formula("g1 + g2*g3", rigid_body), PlanarMotion(size)
    with ctx.workprec(128):
        loop = make_loop(rigid_body, potential, motion)
        assert bits(loop.refined().Z) == bits(loop.Z)
    with ctx.workprec(precision):
        fine, anew = loop.refined(), make_loop(rigid_body, potential, motion)
        assert loop.refined() is fine
        assert (bits(fine.Z), bits(fine.G)) == (bits(anew.Z), bits(anew.G))
        at, other = fine.point(anew.Z + 1), anew.point(anew.Z + 1)
        assert bits(at.P) == bits(other.P)
    with ctx.workprec(128):
        assert bits(loop.refined().Z) != bits(fine.Z)
