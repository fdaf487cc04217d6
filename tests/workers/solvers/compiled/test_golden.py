from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx

from service.dynamics.problem import PlanarMotion, StartAtRest
from tests.support.golden import GOLDEN
from tests.support.planar import body, formula
from workers.solvers.compiled.solve import LASTING_PERIOD_ERROR, solve_spectral

RATIONAL = ("G1", "G2", "G4", "G6")
NU_1 = PlanarMotion(None, nu=Fraction(1))


def solve(golden, tier):
    rigid_body = body(golden.body["A"], golden.body["C"])
    a = golden.potential.get("a")
    potential = formula(f"{a}*g1" if a is not None else golden.potential["expression"], rigid_body)
    lambda_, nu = golden.motion.get("lambda"), golden.motion.get("nu")
    motion = PlanarMotion(
        None if lambda_ is None else Fraction(lambda_),
        None if nu is None else Fraction(nu),
        start=StartAtRest(-1) if "start" in golden.motion else None,
    )
    return rigid_body, solve_spectral(rigid_body, potential, motion, tier=tier)


def error_of(golden, motion):
    times = np.array(list(golden.states), dtype=float)
    expected = np.array([[row[0], "0", *row[1:]] for row in golden.states.values()], dtype=float)
    return float(np.abs(motion.sample(times) - expected).max()), motion.error_at(times)


@pytest.mark.parametrize("tier", ["draft", "standard"])
@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden.name)
def test_states_are_the_golden_ones(golden, tier):
    _, motion = solve(golden, tier)
    actual, claimed = error_of(golden, motion)
    # What the tiers promise over ten units of time.
    assert actual <= claimed + 1e-16 <= (1e-10 if tier == "standard" else 1e-6)


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden.name)
def test_energies_are_the_golden_ones(golden):
    rigid_body, motion = solve(golden, "standard")
    energy = motion.energy(rigid_body)
    assert abs(energy.value - float(golden.energy)) <= energy.error <= 1e-10


@pytest.mark.parametrize("golden", [g for g in GOLDEN if g.name in RATIONAL], ids=lambda golden: golden.name)
def test_the_high_tier_has_every_digit(golden):
    _, motion = solve(golden, "high")
    actual, claimed = error_of(golden, motion)
    # Roundings of a time of about half a period and of numbers of size 1.
    assert actual <= 2.5e-15
    assert actual <= claimed <= 5e-14
    # Means of rates with roundings of 2^-104, times what P has lost at places next to its ends.
    assert off(motion.period, golden.period) <= min(1e-29, motion.period.error)


def off(period, golden, trips=1):
    """Return how far hi + lo is from so many times a number of 32 digits, relatively."""
    with ctx.workprec(200):
        return float(abs((arb(period.hi) + arb(period.lo)) / (trips * arb(golden)) - 1))


SEPARATRIX = {
    # S1: the highest rest point meets the equator; half a period each.
    4: ("11.638532474857046576440278424317", "11.638885132792138979913441573607"),
    8: ("20.349310886348759051770962717948", "20.349310953129807035130065835465"),
    12: ("29.059913042594031986693570834465", "29.059913042603861616946205069781"),
}
POLE = {
    # S2: the pole is reached in infinite time; a1 = 1e-k and a1 = -1e-k.
    4: ("11.871480718662403458321120528318", "11.871233934728635386542107047566"),
    8: ("21.0816977143871641020186920200503660", "21.081697666682919875681085871596"),
    12: ("30.292038062514761072759494624699", "30.292038062507688063243866818557"),
}


def critical():
    with ctx.workprec(400):
        return Fraction(int(((1 + arb(5).sqrt()) / 4 * 10**80).floor().unique_fmpz()), 10**80)


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("digits", SEPARATRIX)
def test_periods_next_to_the_separatrix_have_all_digits(digits, side):
    rigid_body = body(2, 1)
    coefficient = critical() * (1 + (-1) ** side * Fraction(1, 10**digits))
    motion = solve_spectral(
        rigid_body, formula(f"-g1 + ({coefficient})*(g1^2-g2^2)", rigid_body), NU_1, tier="high"
    )
    assert motion.ends == (("pole", "rest"), ("pole", "equator"))[side]
    # The golden numbers have 32 digits.
    assert off(motion.period, SEPARATRIX[digits][side], trips=2) <= 1e-30
    assert motion.error_at(np.zeros(1)) <= 1e-12


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("digits", POLE)
def test_periods_next_to_a_pole_that_is_not_passed_have_all_digits(digits, side):
    rigid_body = body(2, 1)
    a = (-1) ** side * Fraction(1, 10**digits)
    motion = solve_spectral(rigid_body, formula(f"({a})*g1 - (g1^2-g2^2)", rigid_body), NU_1, tier="high")
    assert motion.ends == (("rest", "equator"), ("pole", "equator"))[side]
    # 31 digits are given of one of them; the kernel that keeps a motion without its roots claims fewer, of a
    # period that is good for 1e8 of them.
    claimed = 1e-30 if motion.loop.by_roots else motion.period.error
    assert (
        off(motion.period, POLE[digits][side], trips=2) <= claimed <= LASTING_PERIOD_ERROR * motion.period.hi
    )


@pytest.mark.parametrize(
    ("nu", "half"),
    [
        # S6: Bobylev and Steklov's motion for tiny and huge nu.
        ("1e-6", "3.7081489309960855602505391838343"),
        ("1e-12", "3.7081493546023202303253035889675"),
        ("1e6", "0.0044428829381550340848122695044803"),
    ],
)
def test_periods_for_extreme_nu(nu, half):
    rigid_body = body(2, 1)
    motion = solve_spectral(
        rigid_body, formula("-g1", rigid_body), PlanarMotion(None, nu=Fraction(nu)), tier="high"
    )
    # hi + lo has 2^-106, the golden numbers 32 digits.
    assert off(motion.period, half, trips=2) <= 1e-30


def test_a_shrinking_window_keeps_its_period():
    # S3: c1 = 5/4 (1 - 1e-6) next to the stable equilibrium; one trip is the whole period.
    rigid_body = body(2, 1)
    coefficient = Fraction(5, 4) * (1 - Fraction(1, 10**6))
    potential = formula(f"-g1 + 1/(20*g3^2) + ({coefficient})*(g1^2-g2^2)", rigid_body)
    motion = solve_spectral(rigid_body, potential, NU_1, tier="high")
    assert motion.ends == ("rest", "rest")
    assert off(motion.period, "3.2232083834488599112487521787543") <= 1e-30
