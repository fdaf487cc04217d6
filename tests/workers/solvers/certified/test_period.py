"""The period alone: by the trapezoidal rule on what doubles found, against every other way to it."""

from fractions import Fraction
from itertools import pairwise

import mpmath
import pytest
from flint import arb, ctx
from hypothesis import assume, given, settings

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion, StartAtRest
from service.dynamics.reduction.window import StartingPoint
from service.dynamics.reduction.windows import SeveralWindowsError
from tests.support.admissible import Case, cases, with_periodic_window
from tests.support.effort import examples, seldom
from tests.support.planar import body, formula
from tests.workers.solvers.certified.cases import SEPARATRIX, is_inside, three_terms
from workers.solvers.certified.by_integral import integral_motion, motion_by_integral, periodic_window
from workers.solvers.certified.fourier_time import FourierTime, proven_strip, time_of_turn
from workers.solvers.certified.orbit import is_the_only_one, start_on
from workers.solvers.certified.time_model import make_time_model
from workers.solvers.choose import enclose
from workers.solvers.compiled.family import arc_in_doubles
from workers.solvers.errors import CertifiedUnavailableError, PrecisionNeededError

NOT_EVEN = "(A*g1^2 + C*g3^2)*(g2^2 - 1/2 + g2^3/5)"
ON_4_5 = PlanarMotion(Fraction(4, 5))
DIGITS = 50


def start_from_doubles(rigid_body: RigidBody, potential: Potential, motion: PlanarMotion) -> StartingPoint:
    arc = arc_in_doubles(rigid_body, potential, motion)
    assert arc is not None
    start = start_on(arc, motion)
    assert start is not None
    return start


def period_by_mpmath(alpha: mpmath.mpf) -> mpmath.mpf:
    """Return 2 ∫ dθ / (Q √k), g2 = y = m − h cos θ, for A = α, C = 1, V = Q G(g2): s² = −2 G(y)/(A C)."""
    roots = sorted(
        mpmath.re(root) for root in mpmath.polyroots([mpmath.mpf(1) / 5, 1, 0, -0.5], extraprec=300)
    )
    third, lower, upper = roots
    square, power = mpmath.mpf(16) / 25, 1 / alpha

    def rate(theta: mpmath.mpf) -> mpmath.mpf:
        y = lower * mpmath.cos(theta / 2) ** 2 + upper * mpmath.sin(theta / 2) ** 2
        room = 1 - y * y
        # w = g1² solves w + λ² w^(1/α) = 1 − y²: concave, Newton from the left of its zero in log w.
        log_w = mpmath.log(min(room, (room / square) ** alpha))
        for _ in range(12):
            w, rest = mpmath.exp(log_w), square * mpmath.exp(power * log_w)
            log_w -= (w + rest - room) / (w + power * rest)
        Q = alpha * w + rest
        return 1 / (Q * mpmath.sqrt(2 * (y - third) / (5 * alpha)))

    return 2 * mpmath.quad(rate, [0, mpmath.pi])


@pytest.mark.parametrize("A", ["3", *seldom("5/2", "7/5"), "17/10"])
def test_it_is_that_of_quadrature_by_mpmath(A):
    rigid_body = body(A, 1)
    found = enclose(rigid_body, formula(NOT_EVEN, rigid_body), ON_4_5, [], 128)
    with mpmath.workdps(DIGITS):
        expected = mpmath.nstr(
            period_by_mpmath(mpmath.mpf(rigid_body.A.numerator) / rigid_body.A.denominator), 46
        )
    with ctx.workprec(400):
        # mpmath has 50 digits; 46 are compared, of a number below 10.
        assert bool(abs(found.period - arb(expected)).lower() <= arb("1e-45"))
    assert float(found.period.rad()) < 1e-38


@pytest.mark.parametrize("A", [*seldom("3", "17/10"), "5/2", "7/5"])
def test_more_bits_are_inside_fewer_and_as_narrow_as_asked(A):
    rigid_body = body(A, 1)
    potential = formula(NOT_EVEN, rigid_body)
    periods = [enclose(rigid_body, potential, ON_4_5, [], bits).period for bits in (64, 128, 333)]
    for bits, period in zip((64, 128, 333), periods, strict=True):
        assert bool(period.rad() <= arb(2) ** (8 - bits) * period)
    for outer, inner in pairwise(periods):
        assert is_inside(inner, outer)


@pytest.mark.random_law
@given(cases())
@settings(max_examples=examples(5, 25), deadline=None)
def test_it_is_that_of_pieces_of_time_and_of_windows_found_in_balls(case: Case):
    periodic = with_periodic_window(case)
    assume(periodic is not None)
    problem = periodic.problem()
    with ctx.workprec(128):
        try:
            slow = integral_motion(periodic_window(problem.body, problem.potential, problem.motion)[1], 72)
            fast = motion_by_integral(problem.body, problem.potential, problem.motion, 72, arc_in_doubles)
            by_pieces = make_time_model(slow.phase, ctx.prec).period
        except (CertifiedUnavailableError, PrecisionNeededError):
            # A pole passed without smoothness, or a formula with 0 · |g3|^-n there.
            assume(False)
            raise
        assert fast.period.overlaps(by_pieces)
        assert slow.period.overlaps(by_pieces)
        assert fast.energy.overlaps(slow.energy)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("text", "lambda_"),
    [
        ("-g1*(4*g1^2+3*g3^2) + (4*g1^2+g3^2)/10", "9/10"),
        ("-abs(g1)^(3/2)", "1"),
        ("-abs(g1)^(3/2) - g1^2/5", "2"),
    ],
)
def test_it_is_proven_by_a_strip_through_poles_too(text, lambda_):
    rigid_body = body(4, 1)
    with ctx.workprec(192):
        made = motion_by_integral(
            rigid_body, formula(text, rigid_body), PlanarMotion(Fraction(lambda_)), 136, arc_in_doubles
        )
        strip = proven_strip(made.phase)
        assert made.passes_pole
        assert strip is not None
        found = time_of_turn(made.phase, strip, 136)
        assert found.overlaps(make_time_model(made.phase, ctx.prec).period)
        assert bool(found.rad() < arb(2) ** -130)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("gap", ["1e-3", *seldom("-1e-3", "1e-4", "1e-6"), "-1e-6"])
def test_next_to_a_separatrix_it_is_that_of_elliptic_functions(gap):
    text = f"-g1 + {SEPARATRIX * (1 + Fraction(gap))}*(g1^2-g2^2)"
    one, two = (three_terms(text, methods=(method,)) for method in ("elliptic", "integral"))
    assert one.period.overlaps(two.period)
    assert float(two.period.rad()) < 1e-36


def test_a_window_between_the_places_of_the_scan_is_not_overlooked():
    # The dip is 0.06 wide in y, the places there are 0.2 apart: the compiled solver proves signs on whole
    # panels, and does not settle for the window that the places show.
    rigid_body = body(3, 1)
    text = "(A*g1^2 + C*g3^2)*(g2^2 - 1/2 + g2^3/5 - 3/5*exp(-(100*(g2 - 181/200))^2))"
    potential = formula(text, rigid_body)
    with ctx.workprec(128):
        assert arc_in_doubles(rigid_body, potential, ON_4_5) is None
    with pytest.raises(SeveralWindowsError):
        enclose(rigid_body, potential, ON_4_5, [], 64)


def test_mirror_images_are_one_window():
    rigid_body = body(3, 1)
    potential = formula("(A*g1^2 + C*g3^2)*((g2^2 - 1/4)^2 - 1/50)", rigid_body)
    with ctx.workprec(128):
        starts = [
            start_from_doubles(rigid_body, potential, PlanarMotion(Fraction(4, 5), start=StartAtRest(sign)))
            for sign in (1, -1)
        ]
        north, south = (integral_motion(start, 72) for start in starts)
        assert all(is_the_only_one(start.arc, north.energy) for start in starts)
        assert north.period.overlaps(south.period)
        assert bool(starts[0].v.cos() > 0)
        assert bool(starts[1].v.cos() < 0)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("A", "C", "text", "lambda_"),
    [
        (3, 1, NOT_EVEN, "4/5"),
        ("7/5", 1, NOT_EVEN, "6/5"),
        (1, 3, NOT_EVEN, "4/5"),
        (4, 1, "-g1*(4*g1^2+3*g3^2) + (4*g1^2+g3^2)/10", "9/10"),
    ],
)
def test_one_series_of_time_and_many_pieces_of_it_have_the_same_inverse(A, C, text, lambda_):
    rigid_body = body(A, C)
    with ctx.workprec(128):
        made = motion_by_integral(
            rigid_body, formula(text, rigid_body), PlanarMotion(Fraction(lambda_)), 90, arc_in_doubles
        )
        series, pieces = made.model, make_time_model(made.phase, ctx.prec)
        assert isinstance(series, FourierTime)
        # Turns, poles and the equator are at quarters of the period for some of them.
        times = [made.period * share / 24 for share in range(-30, 60)]
        for t, theta in zip(times, series.phases_at(times), strict=True):
            # A time of whole periods may be the end of one turn or the beginning of the next.
            half = (theta - pieces.phase_at(t)) / 2
            assert half.sin().contains(0)
            # 2^-90 of the period, and a little for the slope.
            assert bool(theta.rad() < arb(2) ** -80)
            slow, fast = made.phase.state(theta), made.phase.state(theta, series.rate(theta))
            assert all(a.overlaps(b) for a, b in zip(slow, fast, strict=True))
            # Far more than is lost next to a turn, where p is a root of what is left of N.
            assert max(float(b.rad()) for b in fast) < 2.0**-70


@pytest.mark.parametrize("half_width", ["1e-60", *seldom("1e-170")])
def test_small_oscillations_take_one_time_however_small(half_width):
    rigid_body = body(3, 1)
    text = "(3*g1^2 + g3^2)*((g2 - 1/3)^2 - e^2)"

    def period(epsilon: str) -> arb:
        potential = formula(text, rigid_body, {"e": epsilon})
        return enclose(rigid_body, potential, PlanarMotion(Fraction(1, 2)), [], 64).period

    # It differs by the square of the width.
    assert period(half_width).overlaps(period("1e-20"))
