from fractions import Fraction

import pytest
from flint import ctx

from service.dynamics.problem import PlanarMotion, StartAtEquator, StartAtPoint, StartAtRest
from tests.support.golden import GOLDEN
from tests.support.planar import body, formula
from tests.workers.solvers.certified.cases import (
    SEPARATRIX,
    contains_printed,
    is_inside,
    overlap,
    three_terms,
)
from workers.solvers.choose import enclose

ELLIPTIC = [golden for golden in GOLDEN if golden.name in ("G1", "G2", "G4", "G6")]


@pytest.mark.parametrize("golden", ELLIPTIC, ids=lambda golden: golden.name)
def test_golden_motions_to_all_printed_digits(golden):
    text = golden.potential.get("expression") or f"{golden.potential['a']}*g1"
    found = three_terms(
        text, nu=golden.motion["nu"], times=golden.states, A=golden.body["A"], C=golden.body["C"]
    )
    assert (found.method, found.conventions) == ("elliptic", ())
    assert contains_printed(found.period, golden.period)
    assert contains_printed(found.energy, golden.energy)
    for state, (p, r, *gamma) in zip(found.states, golden.states.values(), strict=True):
        for ball, printed in zip(state, (p, "0", r, *gamma), strict=True):
            assert contains_printed(ball, printed)


EXTREMES = [
    # Next to a separatrix, where the motion stays long at the equator.
    (
        f"-g1 + {SEPARATRIX * (1 + Fraction('1e-4'))}*(g1^2-g2^2)",
        1,
        2,
        "11.638532474857046576440278424317",
    ),
    (
        f"-g1 + {SEPARATRIX * (1 - Fraction('1e-4'))}*(g1^2-g2^2)",
        1,
        2,
        "11.638885132792138979913441573607",
    ),
    (
        f"-g1 + {SEPARATRIX * (1 - Fraction('1e-8'))}*(g1^2-g2^2)",
        1,
        2,
        "20.349310953129807035130065835465",
    ),
    (
        f"-g1 + {SEPARATRIX * (1 + Fraction('1e-12'))}*(g1^2-g2^2)",
        1,
        2,
        "29.059913042594031986693570834465",
    ),
    (
        f"-g1 + {SEPARATRIX * (1 - Fraction('1e-12'))}*(g1^2-g2^2)",
        1,
        2,
        "29.059913042603861616946205069781",
    ),
    # Next to one at the pole.
    ("1e-4*g1 - (g1^2-g2^2)", 1, 2, "11.871480718662403458321120528318"),
    ("-1e-8*g1 - (g1^2-g2^2)", 1, 2, "21.081697666682919875681085871596"),
    ("-1e-12*g1 - (g1^2-g2^2)", 1, 2, "30.292038062507688063243866818557"),
    # Next to an equilibrium.
    ("-g1 + 1/(20*g3^2) + 5/4*(1-1e-6)*(g1^2-g2^2)", 1, 1, "3.2232083834488599112487521787543"),
    # Next to a separatrix between oscillation and collision.
    ("g1 - (1-1e-4)/16/g3^2 - (g1^2-g2^2)", 1, 2, "8.311505408414688543587259"),
    # Extreme curves.
    ("-g1", "1e-6", 2, "3.7081489309960855602505391838343"),
    ("-g1", "1e-12", 2, "3.7081493546023202303253035889675"),
    ("-g1", "1e6", 2, "0.0044428829381550340848122695044803"),
    ("-g1", "1e12", 2, "0.0000044428829381583662470158"),
]
"""Potential, nu, trips in a period, time of a trip."""


@pytest.mark.parametrize(("text", "nu", "trips", "printed"), EXTREMES)
def test_times_of_a_trip_at_the_extremes_to_all_printed_digits(text, nu, trips, printed):
    window = 1 if "16/g3^2" in text else None
    found = three_terms(text, nu=nu, window=window)
    with ctx.workprec(300):
        assert contains_printed(found.period / trips, printed)
    assert found.method == "elliptic"


# A gap of 1e-12 to a separatrix, a libration of 1e-3 about an equilibrium, one next to a collision.
@pytest.mark.parametrize(("text", "nu", "trips", "printed"), [EXTREMES[3], EXTREMES[8], EXTREMES[9]])
def test_the_integral_bears_the_extremes_too(text, nu, trips, printed):
    window = 1 if "16/g3^2" in text else None
    found = three_terms(text, nu=nu, window=window, methods=("integral",))
    with ctx.workprec(300):
        assert contains_printed(found.period / trips, printed)
    assert found.method == "integral"


STARTS = {
    "-g1": (StartAtEquator(-1), StartAtPoint(Fraction(1, 3), -1, 1)),
    "-g1 + 1/(20*g3^2)": (StartAtEquator(-1), StartAtRest(-1), StartAtPoint(Fraction(1, 3), 1, -1)),
    "-g1 + 6/5*(g1^2-g2^2)": (StartAtRest(1), StartAtRest(-1), StartAtPoint(Fraction(1, 5), -1, -1)),
    "-g1 + 1/(50*g3^2) + 6/5*(g1^2-g2^2)": (None, StartAtRest(-1), StartAtPoint(Fraction(1, 5), -1, 1)),
}


@pytest.mark.parametrize(
    ("text", "start", "g3_sign"),
    [
        (text, start, sign)
        for text, starts in STARTS.items()
        for sign, start in zip((1, -1, -1), starts, strict=False)
    ],
)
def test_the_integral_gives_the_same_motion(text, start, g3_sign):
    # Every kind of interval, start and side: the two share no formula but that of the potential.
    times = (0, Fraction(1, 3), 2, 100)
    one, two = (
        three_terms(text, times=times, bits=64, start=start, g3_sign=g3_sign, methods=methods)
        for methods in (("elliptic", "integral"), ("integral",))
    )
    assert (one.method, two.method) == ("elliptic", "integral")
    assert overlap(one, two)


def test_the_axes_may_be_exchanged_and_g1_negative():
    rigid_body, motion = body(1, 2), {"lambda_": Fraction(3, 2), "g1_sign": -1, "g3_sign": 1}
    potential = formula("-2*g3 + 1/(30*g1^2)", rigid_body)
    one, two = (
        enclose(
            rigid_body, potential, PlanarMotion(**motion), [Fraction(1), Fraction(9)], 64, methods=methods
        )
        for methods in (("elliptic", "integral"), ("integral",))
    )
    assert (one.method, two.method) == ("elliptic", "integral")
    assert overlap(one, two)


def test_more_bits_are_inside_fewer():
    times = (0, Fraction(22, 7), 1000)
    coarse, middle, fine = (
        three_terms("-g1 + 1/(20*g3^2)", times=times, bits=bits) for bits in (64, 128, 333)
    )
    for outer, inner in ((coarse, middle), (middle, fine)):
        assert is_inside(inner.period, outer.period)
        for rows in zip(outer.states, inner.states, strict=True):
            assert all(is_inside(b, a) for a, b in zip(*rows, strict=True))


@pytest.mark.parametrize("bits", [64, 128, 333])
def test_radii_are_as_promised_even_after_1e12_periods(bits):
    found = three_terms("-g1 + 1/(20*g3^2)", times=(0, 1, 6_340_077_937_232), bits=bits)
    allowed = 2.0 ** (8 - bits)
    assert float(found.period.rad()) <= allowed * float(found.period)
    assert all(float(value.rad()) <= allowed for state in found.states for value in state)


def test_the_motion_repeats_after_its_period_and_returns_from_rest():
    # A state at a time known to 2^-400 only: the enclosures must still meet.
    period = three_terms("-g1 + 1/(20*g3^2)", bits=333).period
    mantissa, exponent = period.mid().man_exp()
    one = Fraction(int(mantissa)) * Fraction(2) ** int(exponent)
    found = three_terms("-g1 + 1/(20*g3^2)", times=(1, 1 + one, 1 + 1000 * one), bits=64)
    for later in found.states[1:]:
        assert all(a.overlaps(b) for a, b in zip(found.states[0], later, strict=True))
