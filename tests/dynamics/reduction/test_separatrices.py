"""What is called a separatrix is proved to be one; a gap, however narrow, makes it none."""

import pytest
from flint import arb, ctx

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.arcs_of_loop import PassageUndecidedError
from service.dynamics.reduction.root_finding.gap import SeparatrixUndecidedError
from service.dynamics.reduction.windows import find_windows
from tests.support.planar import body, formula

GENERAL = ("17/10", 1)
Q = "(A*g1^2+C*g3^2)"


def kinds(text, moments=(2, 1), motion=None):
    rigid_body = body(*moments)
    found = find_windows(rigid_body, formula(text, rigid_body), motion or PlanarMotion(1))
    return sorted(window.kind for window in found)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("text", "moments", "expected"),
    [
        # On the equator, where the golden ratio is; a transcendental factor changes nothing.
        ("-g1+(1+sqrt(5))/4*(g1^2-g2^2)", (2, 1), ["separatrix"]),
        ("pi*(-g1+(1+sqrt(5))/4*(g1^2-g2^2))", (2, 1), ["separatrix"]),
        (f"{Q}*(g2^4-g2^2/4)*exp(g2^2)", GENERAL, ["separatrix"]),
        (f"{Q}*(g2^4-g2^2/4)", (1, "17/10"), ["separatrix"]),
        # Where g2 is rational, and a root of a small polynomial; of higher order.
        (f"-{Q}*(g2-1/3)^2", GENERAL, ["separatrix"] * 2),
        (f"-{Q}*(g2^2-1/3)^2*exp(g2)", (2, 1), ["separatrix"] * 3),
        (f"{Q}*(g2-2/7)^3", GENERAL, ["separatrix"]),
        (f"{Q}*(g2+2/7)^6", GENERAL, ["equilibrium"]),
        # Where g1 is rational: between a collision and an oscillation.
        ("g1-1/16/g3^2-(g1^2-g2^2)", (2, 1), ["collision", "separatrix"]),
    ],
)
def test_zeros_of_even_order_are_proved(text, moments, expected):
    assert sorted(set(kinds(text, moments))) == sorted(set(expected))


@pytest.mark.parametrize("n", [50, 300, 700, 3000, 40_000])
def test_a_gap_on_the_equator_is_told_from_none(n):
    """The body turns back before the equator, or passes it; at exp(-700) doubles end."""
    for sign, end in (("+", "rest"), ("-", "equator")):
        rigid_body = body(2, 1)
        text = f"-g1+(1+sqrt(5))/4*(1{sign}exp(-{n}))*(g1^2-g2^2)"
        (window,) = find_windows(rigid_body, formula(text, rigid_body), PlanarMotion(1))
        assert window.kind == "periodic"
        assert window.ends == ("pole", end)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("n", [300, 1000, 5000])
def test_a_gap_off_the_equator_is_told_from_none(n):
    well = f"((g2-1/3)^2-exp(-{n}))"
    hill = f"((g2-1/3)^2+exp(-{n}))"
    assert kinds(f"{Q}*{well}", GENERAL) == ["periodic"]
    assert kinds(f"{Q}*{hill}", GENERAL) == []
    # Both sides of it, and one way through.
    assert len(kinds(f"-{Q}*{well}", GENERAL)) == 2
    assert len(kinds(f"-{Q}*{hill}", GENERAL)) == 1


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    "text",
    [
        # Zero, but no algebraic identity says so; below what is computed; a gap of higher order, which
        # bounds see only where it is written as an even power.
        "-g1+(1+sqrt(5))/4*(1+exp(-9)*(exp(2)-exp(1)^2))*(g1^2-g2^2)",
        "-g1+(1+sqrt(5))/4*(1+exp(-900000))*(g1^2-g2^2)",
        f"-{Q}*((g2-1/3)^3*(g2-1/3)+exp(-3000))",
    ],
)
def test_what_is_neither_proved_nor_told_is_refused_by_name(text):
    with pytest.raises(SeparatrixUndecidedError, match=r"separatrix, or its period|any time"):
        kinds(text)


def test_a_gap_of_higher_order_is_settled_by_bounds_that_see_it():
    """p² is Q times a fourth power and something positive: there is no zero, and the poles are not passed."""
    assert kinds(f"-{Q}*((g2-1/3)^4+exp(-3000))") == ["pole"]


@pytest.mark.parametrize("n", [300, 390, 600, 1500])
def test_the_ends_of_a_gap_far_below_what_is_known_of_the_zeros_are_found(n):
    """The well has two ends, exp(-n) from its middle, where p² changes its sign: no zeros of order two."""
    rigid_body = body(*GENERAL)
    text = f"{Q}*((g2-1/3)^2-exp(-{2 * n}))"
    (window,) = find_windows(rigid_body, formula(text, rigid_body), PlanarMotion(1))
    assert (window.kind, window.ends) == ("periodic", ("rest", "rest"))
    (arc,) = window.arcs
    (near,) = arc.slow
    with ctx.workprec(8 * n):
        loop = arc.loop.refined()
        heights = [loop.point(v).g2 - arb(1) / 3 for v in (arc.upper, arc.lower)]
        reach = arb(-n).exp()
        # g2 falls as v grows; the places are as good as the parabola, and reach is told to 64 bits of it.
        for found, expected in zip(heights, (-reach, reach), strict=True):
            assert abs(found / expected - 1) < 1e-15
        assert abs(near.v - (arc.lower + arc.upper) / 2) < 1e-15 * near.reach


@pytest.mark.parametrize("jump", ["1e-8", "1e-30", "exp(-200)", "exp(-2000)"])
def test_two_limits_at_a_pole_are_told_apart(jump):
    assert kinds(f"-g1*(1+{jump}*abs(g3)/g3)") == ["pole"]
    # Even in g3, or with a difference that dies out, there is one.
    assert kinds(f"-g1*(1+{jump}*abs(g3)/abs(g3))") == ["periodic"]
    assert kinds(f"-g1*(1+{jump}*abs(g3)*g3)") == ["periodic"]
    assert kinds(f"-g1*(1+{jump}*g3)") == ["periodic"]


def test_two_limits_that_cannot_be_told_apart_are_refused_by_name():
    with pytest.raises(PassageUndecidedError, match="one limit"):
        kinds("-g1*(1+exp(-9000)*abs(g3)/g3)")


def test_two_limits_at_a_pole_of_a_mirrored_body_are_told_apart():
    motion = PlanarMotion(1)
    assert kinds("-g3*(1+1e-8*abs(g1)/g1)", (1, 2), motion) == ["pole"]
    assert kinds("-g3", (1, 2), motion) == ["periodic"]
