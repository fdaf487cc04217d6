from fractions import Fraction

import pytest
from flint import acb, arb, ctx

from service.dynamics.problem import PlanarMotion, StartAtRest
from tests.support.golden import GOLDEN
from tests.support.planar import body, formula
from tests.workers.solvers.certified.cases import contains_printed, is_inside
from workers.solvers.certified.by_integral import integral_motion, periodic_window
from workers.solvers.certified.time_model import make_time_model
from workers.solvers.choose import enclose

GENERAL = [golden for golden in GOLDEN if golden.name in ("G10", "G12")]
NOT_EVEN = "(A*g1^2 + C*g3^2)*(g2^2 - 1/2 + g2^3/5)"


@pytest.mark.parametrize("golden", GENERAL, ids=lambda golden: golden.name)
def test_golden_motions_to_all_printed_digits(golden):
    rigid_body = body(golden.body["A"], golden.body["C"])
    start = StartAtRest(-1) if "start" in golden.motion else None
    found = enclose(
        rigid_body,
        formula(golden.potential["expression"], rigid_body),
        PlanarMotion(Fraction(golden.motion["lambda"]), start=start),
        [Fraction(t) for t in golden.states],
        128,
    )
    assert found.method == "integral"
    assert contains_printed(found.period, golden.period)
    assert contains_printed(found.energy, golden.energy)
    for state, (p, r, *gamma) in zip(found.states, golden.states.values(), strict=True):
        for ball, printed in zip(state, (p, "0", r, *gamma), strict=True):
            assert contains_printed(ball, printed)


@pytest.mark.parametrize(
    ("alpha", "printed"),
    [
        (2, "6.432310535121612579869958267408499"),
        (3, "9.853280909959509831372235188172033"),
        (4, "13.36298407186977234524483136555792"),
    ],
)
def test_the_general_bobylev_steklov_motion_passes_poles(alpha, printed):
    # V = −|g1|^{2(α−1)/α} is a polynomial in g3, though its formula has no derivative at the pole.
    rigid_body = body(alpha, 1)
    potential = formula("-abs(g1)^(2*(A-C)/A)", rigid_body)
    times = [Fraction(1), Fraction(5), Fraction(printed)]
    found = enclose(rigid_body, potential, PlanarMotion(Fraction(1)), times, 110, methods=("integral",))
    assert contains_printed(found.period, printed)
    # |g1| bends too sharply at the pole for the way through to be the only one.
    assert found.conventions == ("symmetric_pole_passage",)
    with ctx.workprec(300):
        for state in found.states:
            # p = const.
            assert (state[0] + (arb(2).sqrt() / alpha)).contains(0)
            assert (state[3] - abs(state[5]) ** alpha).contains(0)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("A", "text"), [(3, NOT_EVEN), ("17/10", NOT_EVEN), (4, "-g1*(4*g1^2+3*g3^2) + (4*g1^2+g3^2)/10")]
)
def test_the_period_is_that_of_adaptive_integration(A, text):
    rigid_body = body(A, 1)
    potential, motion = formula(text, rigid_body), PlanarMotion(Fraction(4, 5))
    with ctx.workprec(112):
        made = integral_motion(periodic_window(rigid_body, potential, motion)[1], 80)
        upper = arb.pi() if made.phase.is_even else 2 * arb.pi()
        integral = acb.integral(
            lambda theta, analytic: made.phase.rate(theta, analytic=analytic),
            0,
            upper,
            rel_tol=arb(2) ** -70,
            abs_tol=arb(2) ** -70,
        ).real
        by_pieces = make_time_model(made.phase, ctx.prec).period
        whole = 2 * integral if made.phase.is_even else integral
        assert whole.overlaps(made.period)
        assert whole.overlaps(by_pieces)
        assert whole.rad() < arb(2) ** -60
        assert max(made.period.rad(), by_pieces.rad()) < arb(2) ** -60


@pytest.mark.parametrize("A", [3, "17/10", "5/7"])
def test_the_six_variables_obey_their_laws(A):
    rigid_body = body(A, 1)
    potential = formula(NOT_EVEN, rigid_body)
    times = [Fraction(k, 3) for k in range(12)]
    found = enclose(rigid_body, potential, PlanarMotion(Fraction(11, 10)), times, 64)
    with ctx.workprec(200):
        a = arb(rigid_body.A.numerator) / rigid_body.A.denominator
        for p, q, r, g1, g2, g3 in found.states:
            assert q == 0
            assert (g1 * g1 + g2 * g2 + g3 * g3 - 1).contains(0)
            assert (a * p * g1 + r * g3).contains(0)
            assert (abs(g3) - arb(11) / 10 * (abs(g1).log() / a).exp()).contains(0)
            kinetic = (a * p * p + r * r) / 2
            assert (kinetic + potential.value_ball(g1, g2, g3)).overlaps(found.energy)


def test_more_bits_are_inside_fewer():
    rigid_body = body(3, 1)
    potential = formula(NOT_EVEN, rigid_body)
    times = [Fraction(1), Fraction(1000)]
    coarse, fine = (
        enclose(rigid_body, potential, PlanarMotion(Fraction(4, 5)), times, bits) for bits in (64, 333)
    )
    assert float(fine.period.rad()) <= 2.0**-320
    assert is_inside(fine.period, coarse.period)
    for rows in zip(coarse.states, fine.states, strict=True):
        assert all(is_inside(b, a) for a, b in zip(*rows, strict=True))


def test_radii_are_as_promised_after_1e12_periods():
    rigid_body = body(3, 1)
    potential = formula(NOT_EVEN, rigid_body)
    found = enclose(rigid_body, potential, PlanarMotion(Fraction(4, 5)), [Fraction(6_555_938_133_741)], 64)
    assert all(float(value.rad()) <= 2.0**-56 for value in found.states[0])
