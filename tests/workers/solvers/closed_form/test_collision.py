from fractions import Fraction

import pytest
from flint import arb, ctx
from scipy.integrate import quad

from service.dynamics.potentials.recognition import ThreeTerms
from tests.support.planar import body
from tests.support.witnesses.collision import NoCollisionError, collision_time
from workers.solvers.three_terms import RootsUndecidedError, intervals, make_curve


def three(a1, b1=0, c1=0) -> ThreeTerms:
    return ThreeTerms(Fraction(a1), Fraction(b1), Fraction(c1))


@pytest.mark.parametrize(
    ("b1", "printed"),
    [
        ("-1/20", "1.06647559407919763218981408942"),
        ("-1/5", "0.82119911108083424708898369890624"),  # complex roots
    ],
)
def test_golden_times(b1, printed):
    with ctx.workprec(160):
        found = collision_time(three(-1, b1, "-1/2"), body(2, 1), Fraction(1))
        # All printed digits; the last may have been cut off.
        assert abs(found - arb(printed)) < arb(10) ** -len(printed.split(".")[1])
        assert found.rel_accuracy_bits() > 140


CASES = [
    (three(-1, "-1/20", "-1/2"), "1"),
    (three(-1, "-1/5", "-1/2"), "1"),
    (three(1, "-1/50"), "1"),
    (three(0, "-1/5"), "2"),
    (three(1, "-1/50", -1), "1/2"),
    (three(-1, "-1/5", "6/5"), "3"),
]


@pytest.mark.parametrize(("terms", "nu"), CASES)
@pytest.mark.parametrize("C", ["1", "3/2"])
def test_against_a_quadrature(terms, nu, C):
    """x = hi sin²w takes the square root at hi away; 2 sin w cos w hi dw = dx."""
    C, nu = Fraction(C), Fraction(nu)
    curve = make_curve(terms, C, arb(nu.numerator) / nu.denominator, 1)
    lowest = intervals(curve)[0]
    x1, x2, hi, f = (float(value) for value in (curve.x1, curve.x2, lowest.hi, curve.factor))
    constant, linear, quadratic = float(curve.constant), float(curve.linear), float(curve.quadratic)

    def speed(x: float) -> float:
        return (f * (x1 - x) * (x - x2) * -(constant + linear * x + quadratic * x * x)) ** 0.5

    def slowness(y: float) -> float:
        # x = hi (1 − y²) has dx = −2 hi y dy and x' ~ y.
        return 2.0 * hi * y / speed(hi * (1.0 - y * y))

    expected, error = quad(slowness, 0.0, 1.0, epsabs=1e-10, epsrel=1e-10)
    found = collision_time(terms, body(2 * C, C), nu)
    # speed at small y takes differences of numbers of size 1.
    assert abs(float(found) - expected) <= 1e-7 + error


@pytest.mark.parametrize(("terms", "nu"), CASES)
def test_times_add_up(terms, nu):
    """The times from x down, and from x up to the turning point and down, differ by twice the way up."""
    nu, x = Fraction(nu), Fraction(1, 100)
    whole = collision_time(terms, body(2, 1), nu)
    falling = collision_time(terms, body(2, 1), nu, x=x)
    rising = collision_time(terms, body(2, 1), nu, x=x, is_rising=True)
    assert (falling + rising) / 2 - whole in arb(0, "1e-12")
    assert 0 < falling < whole < rising


def test_a_mirror_image_collides_at_the_same_time():
    one = collision_time(three(-1, "-1/20", "-1/2"), body(2, 1), Fraction(1))
    other = collision_time(three(1, "-1/20", "-1/2"), body(2, 1), Fraction(-1))
    assert one.overlaps(other)


@pytest.mark.parametrize("terms", [three(-1), three(-1, "1/20"), three(-1, "1/50", "6/5")])
def test_no_collision(terms):
    with pytest.raises(NoCollisionError):
        collision_time(terms, body(2, 1), Fraction(1))


def test_no_collision_from_beyond_the_turning_point():
    with pytest.raises(NoCollisionError):
        collision_time(three(1, "-1/50", -1), body(2, 1), Fraction(1), x=Fraction(1, 2))


def test_a_double_root_is_not_a_turning_point():
    with pytest.raises(RootsUndecidedError):
        collision_time(three(1, "-1/16", -1), body(2, 1), Fraction(1))
