"""Enclosures where V1 stays an integral, against quadratures without series and without the loop."""

from fractions import Fraction

import mpmath as mp
import pytest
from flint import acb, arb, ctx

from service.dynamics.potentials.families.written import general_potential
from service.dynamics.problem import PlanarMotion, StartAtEquator
from service.dynamics.reduction.geometry.loop import make_loop
from tests.support.effort import seldom
from tests.support.planar import body
from tests.support.witnesses.general_motion import GeneralMotion
from workers.solvers.choose import enclose
from workers.solvers.complex_plane.angular_part import AngularSeries
from workers.solvers.errors import CertifiedUnavailableError

DIGITS, BITS = 26, 73
FUNCTIONS = {
    "-w^(3/7)": lambda w: -(w ** (mp.mpf(3) / 7)),
    "-exp(-w)": lambda w: -mp.exp(-w),
    "w*log(w)": lambda w: w * mp.log(w),
    "exp(-w)": lambda w: mp.exp(-w),
    "-log(2+w)": lambda w: -mp.log(2 + w),
    "2+sqrt(w)": lambda w: 2 + mp.sqrt(w),
}


def number(value: Fraction) -> mp.mpf:
    return mp.mpf(value.numerator) / value.denominator


def witness(F, A, C, size=Fraction(1), G=lambda _: mp.mpf(0)) -> GeneralMotion:
    return GeneralMotion(FUNCTIONS[F], number(Fraction(A)), number(Fraction(C)), number(size), G)


def printed(value: mp.mpf) -> arb:
    """Return a ball about what mpmath found: its last three digits are not trusted."""
    return arb(mp.nstr(value, DIGITS)) + arb(0, float(abs(value)) * 10.0 ** (3 - DIGITS))


@pytest.mark.parametrize(
    ("F", "A", "C"),
    [("-exp(-w)", 1, 2), *seldom(("-w^(3/7)", 2, 1), ("w*log(w)", "3/2", 1), ("-w^(3/7)", 1, 7))],
)
def test_V1_and_its_slope_on_the_curve(F, A, C):
    rigid_body = body(A, C)
    with mp.workdps(DIGITS), ctx.workprec(128):
        exact = witness(F, A, C)
        potential = general_potential(rigid_body, F, "0", {})
        loop = make_loop(rigid_body, potential, PlanarMotion(Fraction(1)))
        series = AngularSeries(loop, potential.pieces[0].angular, BITS)

        def V(log_sigma: mp.mpf) -> mp.mpf:
            # Primed axes have the larger moment first.
            Z, G = mp.mpf(loop.Z.str(40, radius=False)), mp.mpf(loop.G.str(40, radius=False))
            alpha = number(loop.alpha)
            places = G * mp.exp(alpha * log_sigma), Z * mp.exp(log_sigma)
            return exact.V(*(places[::-1] if loop.mirrored else places))

        for log_sigma in (mp.mpf("-0.03"), mp.mpf("-2.3")):
            at = arb(mp.nstr(log_sigma, 40))
            found = series.value(at)
            assert found.overlaps(printed(V(log_sigma)))
            # As narrow as was asked, with what sums of a hundred balls lose.
            assert found.rad() < arb(2) ** (8 - BITS) * (1 + abs(found).upper())
            # dV1/dv is cot v dV1/d log σ; the difference of sixth order leaves less than 1e-18.
            step = mp.mpf("0.0001")
            weights = ((1, 45), (2, -9), (3, 1))
            slope = sum(k * (V(log_sigma + j * step) - V(log_sigma - j * step)) for j, k in weights) / (
                60 * step
            )
            assert abs(series.slope(at, arb(1)) - printed(slope)) < arb("1e-14")
            # A region about the place contains what is at it, and at places beside it.
            region = series.value(acb(arb(at.mid(), 0.01), arb(0, 0.01)))
            assert region.contains(acb(found))
            assert region.overlaps(acb(series.value(acb(at, arb("0.009")))))


@pytest.mark.parametrize("F", ["-w^(3/7)", "-exp(-w)", "w*log(w)", "-log(2+w)"])
@pytest.mark.parametrize(("A", "C"), [(2, 1), (1, 2)])
def test_about_a_pole_V1_is_enclosed_down_to_it(F, A, C):
    rigid_body = body(A, C)
    with mp.workdps(25), ctx.workprec(128):
        exact = witness(F, A, C)
        potential = general_potential(rigid_body, F, "0", {})
        loop = make_loop(rigid_body, potential, PlanarMotion(Fraction(1)))
        about = AngularSeries(loop, potential.pieces[0].angular, BITS).about_pole(arb(-20))
        if A < C and F != "-exp(-w)":
            # There w grows to infinity, and F with it.
            assert not about.is_finite()
            return
        # V1 at the pole is that of F(w) at the end of w, here 0 or ∞, and differs by less than e^-10.
        assert about.rad() < 1e-4
        for log_sigma in (-20, -23):
            places = [mp.mpf((loop.G * arb(log_sigma * 2).exp()).str(30, radius=False))]
            places.append(mp.mpf((loop.Z * arb(log_sigma).exp()).str(30, radius=False)))
            assert about.overlaps(printed(exact.V(*(places[::-1] if loop.mirrored else places))))


LIBRATIONS = [("exp(-w)", "-4 + g2/3", lambda y: -4 + y / 3, 2, 1)]
LONG_LIBRATIONS = [("2+sqrt(w)", "-6 + g2^3", lambda y: -6 + y**3, 3, 2)]
ROUND = [("-exp(-w)", "0", lambda _: mp.mpf(0), "6/5", 1)]
LONG_ROUND = [
    ("-w^(3/7)", "0", lambda _: mp.mpf(0), 2, 1),
    ("-log(2+w)", "0", lambda _: mp.mpf(0), 3, 2),
    ("w*log(w)", "0", lambda _: mp.mpf(0), "6/5", 1),
]


@pytest.mark.parametrize(
    ("F", "G", "value", "A", "C"), [*LIBRATIONS, *seldom(*ROUND, *LONG_LIBRATIONS, *LONG_ROUND)]
)
def test_motions_are_where_quadratures_find_them(F, G, value, A, C):
    rigid_body = body(A, C)
    with mp.workdps(DIGITS), ctx.workprec(160):
        exact = witness(F, A, C, G=value)
        u = mp.mpf(1) / 4
        t = exact.time_to(u)
        state = exact.north_of(u)
        start = StartAtEquator(-1)
        potential = general_potential(rigid_body, F, G, {})
        asked = [Fraction(mp.nstr(t, DIGITS))]
        found = enclose(rigid_body, potential, PlanarMotion(Fraction(1), start=start), asked, 64)
        assert found.method == "integral"
        assert found.energy.overlaps(printed(exact.energy))
        for ball, true in zip(found.states[0], state, strict=True):
            # The time has an error of its own; speeds are below 10.
            assert ball.overlaps(printed(true) + arb(0, 1e-22))
            assert ball.rad() < 2.0**-56
        # A thousandth of a millionth of a millionth less of λ is another motion, and is told from this one.
        other = witness(F, A, C, Fraction(10**15 - 1, 10**15), value).north_of(u)
        assert not all(
            ball.overlaps(printed(false)) for ball, false in zip(found.states[0], other, strict=True)
        )


def test_a_pole_between_unlike_quadrants_is_refused():
    rigid_body = body(2, 1)
    F = {"pp": "-exp(-w)", "mp": "-exp(-w)", "pm": "-exp(-w) + 0*w^2 - w/7 + w/7", "mm": "-exp(-w)"}
    potential = general_potential(rigid_body, F, "0", {})
    with pytest.raises(CertifiedUnavailableError, match="quadrants"):
        enclose(rigid_body, potential, PlanarMotion(Fraction(1)), [Fraction(1)], 64)


def test_a_rest_that_no_double_tells_from_a_pole_is_refused_at_once():
    # p² changes its sign at |sin v| = e^-680.
    rigid_body = body(1, "101/100")
    potential = general_potential(rigid_body, "-w^(3/7)", "0", {})
    with pytest.raises(CertifiedUnavailableError, match="next to a pole"):
        enclose(rigid_body, potential, PlanarMotion(Fraction(1)), [Fraction(1)], 64)
