"""Motions in closed form, against golden numbers, other formulas and the quadrature."""

from fractions import Fraction

import mpmath as mp
import numpy as np
import pytest
from flint import arb, ctx

from service.dynamics.potentials.families.coefficients import gravity_potential
from service.dynamics.potentials.recognition import ThreeTerms
from service.dynamics.problem import PlanarMotion, StartAtEquator, StartAtPoint, StartAtRest
from service.dynamics.reduction.window import starting_point
from service.dynamics.reduction.windows import choose_window, find_windows
from tests.support.effort import each_once
from tests.support.golden import GOLDEN
from tests.support.planar import body, formula, planar
from tests.support.solving import solve_planar
from tests.workers.solvers.closed_form.reference import Reference, spread
from workers.solvers.closed_form import make_closed_form, solve_closed_form
from workers.solvers.three_terms import MirrorImage, intervals, make_curve, trip_time

GOLDEN_RATIO = Fraction("1.61803398874989484820458683436563811772030917980576286213544862270526046281890")
"""(1 + √5)/2 to 77 digits: half of it is the c1 of a separatrix at nu = 1, a1 = -1."""


def solve(rigid_body, potential, motion):
    with ctx.workprec(160):
        window = choose_window(find_windows(rigid_body, potential, motion), motion)
        return solve_closed_form(rigid_body, potential, starting_point(window, motion), window)


def three(a1, b1=0, c1=0) -> ThreeTerms:
    return ThreeTerms(Fraction(a1), Fraction(b1), Fraction(c1))


def periodic_interval(terms, nu, C=1):
    curve = make_curve(terms, Fraction(C), arb(nu.numerator) / nu.denominator, 1)
    (found,) = [each for each in intervals(curve) if each.is_periodic]
    return found


@pytest.mark.parametrize(
    "golden", [g for g in GOLDEN if g.name in ("G1", "G2", "G4", "G6")], ids=lambda g: g.name
)
def test_golden_motions(golden):
    rigid_body = body(golden.body["A"], golden.body["C"])
    if golden.potential["type"] == "gravity":
        potential = gravity_potential(Fraction(golden.potential["a"]), Fraction(0), Fraction(0))
    else:
        potential = formula(golden.potential["expression"], rigid_body)
    motion = solve(rigid_body, potential, PlanarMotion(None, nu=Fraction(golden.motion["nu"])))
    expected = np.array([[row[0], "0", *row[1:]] for row in golden.states.values()], dtype=float)
    departure = np.abs(motion.sample(np.array(list(golden.states), dtype=float)) - expected).max()
    # A few roundings of numbers of size 1, and t = 10 reduced by the period.
    assert departure <= 4e-15
    assert departure <= motion.error() <= 2e-14
    gap = abs(Fraction(motion.period.hi) + Fraction(motion.period.lo) - Fraction(golden.period))
    # The golden period is printed to 33 digits or more.
    assert gap <= Fraction(motion.period.error) + Fraction(1, 10**32)
    assert motion.period.error <= 2.0**-104 * motion.period.hi
    with ctx.workprec(128):
        assert abs(motion.interval.curve.energy - arb(golden.energy)) < arb("1e-30")


TRIPS = [
    # Two separatrices near which motions go to a rest point or through the equator.
    (three(-1, 0, GOLDEN_RATIO / 2 * (1 + Fraction("1e-4"))), "1", "11.638532474857046576440278424317"),
    (three(-1, 0, GOLDEN_RATIO / 2 * (1 - Fraction("1e-4"))), "1", "11.638885132792138979913441573607"),
    (three(-1, 0, GOLDEN_RATIO / 2 * (1 + Fraction("1e-8"))), "1", "20.349310886348759051770962717948"),
    (three(-1, 0, GOLDEN_RATIO / 2 * (1 - Fraction("1e-8"))), "1", "20.349310953129807035130065835465"),
    (three(-1, 0, GOLDEN_RATIO / 2 * (1 + Fraction("1e-12"))), "1", "29.059913042594031986693570834465"),
    (three(-1, 0, GOLDEN_RATIO / 2 * (1 - Fraction("1e-12"))), "1", "29.059913042603861616946205069781"),
    # The pole reached in infinite time.
    (three("1e-4", 0, -1), "1", "11.871480718662403458321120528318"),
    (three("-1e-4", 0, -1), "1", "11.871233934728635386542107047566"),
    (three("1e-8", 0, -1), "1", "21.08169771438716410201869202005"),
    (three("-1e-8", 0, -1), "1", "21.081697666682919875681085871596"),
    (three("1e-12", 0, -1), "1", "30.292038062514761072759494624699"),
    (three("-1e-12", 0, -1), "1", "30.292038062507688063243866818557"),
    # A stable equilibrium, a separatrix of collisions.
    (three(-1, "1/20", Fraction(5, 4) * (1 - Fraction("1e-6"))), "1", "3.2232083834488599112487521787543"),
    (three(1, -(1 - Fraction("1e-4")) / 16, -1), "1", "8.311505408414688543587259"),
    (three(1, -(1 - Fraction("1e-8")) / 16, -1), "1", "13.86549833483549517550928"),
    # 2π/√k at the equilibrium itself, from which T departs by 2.3 e.
    (three(-1, "1/20", Fraction(5, 4) * (1 - Fraction("1e-33"))), "1", "3.2232060536528824315284202729299"),
    # Halves of periods found by integration in 220-bit floats.
    (three(-1), "1.3", "3.0652157255635"),
    (three(-1, 0, "6/5"), "1", "3.48500079744721"),
    # Very small and very large nu.
    (three(-1), "1e-6", "3.7081489309960855602505391838343"),
    (three(-1), "1e-12", "3.7081493546023202303253035889675"),
    (three(-1), "1e6", "0.0044428829381550340848122695044803"),
    (three(-1), "1e12", "0.0000044428829381583662470158"),
]


@pytest.mark.parametrize(("terms", "nu", "printed"), TRIPS)
def test_times_of_a_trip_to_all_printed_digits(terms, nu, printed):
    with ctx.workprec(256):
        found = trip_time(periodic_interval(terms, Fraction(nu)))
        assert found.rel_accuracy_bits() > 150
        # One unit of the last printed digit: it may have been cut off instead of rounded.
        assert abs(found - arb(printed)) < arb(10) ** -len(printed.split(".")[1])


CASES = [
    (three(-1), "1"),
    (three(-1), "1e-6"),
    (three(-1), "1e6"),
    (three(-1, "1/20"), "1"),
    (three(-1, "1/20"), "20"),
    (three(-1, "1e-8"), "1"),
    (three(-1, "1/50", "6/5"), "1"),
    (three(-1, "1/50", "-6/5"), "7/3"),
    (three(-1, 0, "6/5"), "1"),
    (three(-1, 0, "-6/5"), "1/2"),
    (three(1, "1/9", -3), "1"),
    *[(terms, nu) for terms, nu, _ in TRIPS[:15]],
]


@pytest.mark.one_in(4)
@pytest.mark.parametrize(("terms", "nu"), CASES)
def test_error_bounds_the_departure_from_another_formula(terms, nu):
    nu = Fraction(nu)
    with ctx.workprec(512):
        interval = periodic_interval(terms, nu)
        motion = make_closed_form(interval, MirrorImage(1, 1, 1), arb.pi() / 2)
    with mp.workdps(60):
        other = Reference(terms, 1, nu, (interval.lo_end, interval.hi_end))
        times = spread(motion.period.hi, 41)
        departure = other.departure(times, motion.sample(times))
    assert departure <= motion.error()
    # Not only large: all roundings hardly ever add up where the slope is steepest, which 50 leaves room for.
    assert motion.error() <= 50.0 * max(departure, 2.0**-53 * np.abs(motion.sample(times)).max())


STARTS = [
    None,
    StartAtEquator(-1),
    StartAtRest(-1),
    StartAtPoint(Fraction(3, 10), 1, 1),
    StartAtPoint(Fraction(3, 10), -1, 1),
    StartAtPoint(Fraction(3, 10), 1, -1),
    StartAtPoint(Fraction(3, 10), -1, -1),
]
TYPES = {
    ("pole", "equator"): "-{s}*g1",
    ("rest", "equator"): "-{s}*g1 + 1/(20*g3^2)",
    ("rest", "rest"): "-{s}*g1 + 1/(50*g3^2) + 6/5*(g1^2-g2^2)",
    ("pole", "rest"): "-{s}*g1 + 6/5*(2*g1^2+g3^2)",
}
MIRRORS = [(1, 1), (1, -1), (-1, 1)]


@each_once(ends=list(TYPES), g1_sign__g3_sign=MIRRORS)
def test_every_start_and_mirror_image_is_that_of_the_quadrature(ends, g1_sign, g3_sign):
    rigid_body = body(2, 1)
    potential = formula(TYPES[ends].format(s=f"({g1_sign})"), rigid_body)
    for start in STARTS:
        if (isinstance(start, StartAtEquator) and ends[1] != "equator") or (
            isinstance(start, StartAtRest) and "rest" not in ends
        ):
            continue
        if isinstance(start, StartAtPoint):
            start = StartAtPoint(g1_sign * start.g1, start.g2_sign, start.s_sign)
        motion = PlanarMotion(None, nu=Fraction(g1_sign), g3_sign=g3_sign, start=start)
        compare_with_quadrature(rigid_body, potential, motion)


@pytest.mark.parametrize(
    ("text", "motion"),
    [
        ("-2*g3", PlanarMotion(Fraction(9, 10), g1_sign=-1, start=StartAtPoint(Fraction(-1, 5), -1, -1))),
        ("2*g3", PlanarMotion(Fraction(9, 10), g3_sign=-1)),
        ("-2*g3 + 1/(30*g1^2)", PlanarMotion(Fraction(9, 10), g1_sign=-1)),
        ("-2*g3 + 2*(2*g3^2+g1^2)", PlanarMotion(Fraction(2), start=StartAtRest(-1))),
    ],
)
def test_bodies_with_the_axes_exchanged(text, motion):
    rigid_body = body(1, 2)
    compare_with_quadrature(rigid_body, formula(text, rigid_body), motion)


def compare_with_quadrature(rigid_body, potential, motion):
    found = solve(rigid_body, potential, motion)
    other = solve_planar(planar(rigid_body, potential, motion)).dense
    gap = abs(
        Fraction(found.period.hi)
        + Fraction(found.period.lo)
        - Fraction(other.period.hi)
        - Fraction(other.period.lo)
    )
    assert gap <= Fraction(found.period.error) + Fraction(other.period.error)
    times = np.linspace(0.0, found.period.hi, 23)
    assert np.abs(found.sample(times) - other(times)).max() <= found.error() + other.error_at(times)
    # At a passage the smaller of g1 and g3 is a rounding of the time: T · 2^-52.
    at_pole = np.abs(found.sample(found.passages)[:, 4])
    assert np.all(np.abs(at_pole - 1.0) <= 1e-15)
    assert len(found.passages) == (2 if found.interval.lo_end == "pole" else 0)


def test_rest_is_exact():
    rigid_body = body(2, 1)
    potential = formula("-g1 + 6/5*(g1^2-g2^2)", rigid_body)
    found = solve(rigid_body, potential, PlanarMotion(None, nu=Fraction(1)))
    assert np.all(found.sample(np.array([0.0]))[0, :3] == 0.0)


@pytest.mark.parametrize(
    ("text", "nu"),
    [
        ("-g1 + g1*g3/10", 1),  # not admissible
        ("g2*(2*g1^2+g3^2) - 2*(2*g1^2+g3^2)", 1),  # admissible, not of the three terms
        ("-g1 + 1/(20*g3^2) + 5/4*(g1^2-g2^2)", 1),  # an equilibrium
        ("-g1 - 1/(20*g3^2)", 1),  # a collision
    ],
)
def test_what_has_no_closed_form(text, nu):
    rigid_body = body(2, 1)
    potential = formula(text, rigid_body)
    motion = PlanarMotion(None, nu=Fraction(nu), window=0)
    windows = find_windows(rigid_body, potential, motion)
    with ctx.workprec(160):
        start = starting_point(windows[0], motion) if windows[0].kind != "equilibrium" else None
        assert solve_closed_form(rigid_body, potential, start, windows[0]) is None
