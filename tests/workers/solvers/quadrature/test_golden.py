from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.motion import COLUMNS
from service.dynamics.potentials.families.coefficients import gravity_potential
from service.dynamics.potentials.families.written import general_potential
from service.dynamics.problem import PlanarMotion, StartAtRest
from service.dynamics.solution.dense_output import Period
from tests.support.golden import GOLDEN, Golden
from tests.support.planar import body, formula, planar
from tests.support.solving import solve_planar


def solve(golden: Golden):
    rigid_body = body(golden.body["A"], golden.body["C"])
    if golden.potential["type"] == "gravity":
        potential = gravity_potential(Fraction(golden.potential["a"]), Fraction(0), Fraction(0))
    else:
        potential = formula(golden.potential["expression"], rigid_body)
    lambda_, nu = golden.motion.get("lambda"), golden.motion.get("nu")
    motion = PlanarMotion(
        None if lambda_ is None else Fraction(lambda_),
        None if nu is None else Fraction(nu),
        start=StartAtRest(-1) if "start" in golden.motion else None,
    )
    return solve_planar(planar(rigid_body, potential, motion, tuple(golden.states)))


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden.name)
def test_states_are_the_golden_ones(golden):
    motion = solve(golden)
    expected = np.array([[row[0], "0", *row[1:]] for row in golden.states.values()], dtype=float)
    actual = np.abs(motion.samples - expected).max()
    assert motion.samples.shape == (len(golden.states), len(COLUMNS))
    # A few roundings of numbers of size 1, and of t = 10 reduced by the period: measured 2e-15 at most.
    assert actual <= 1e-14
    # The claim covers the actual error without being beside the point.
    assert actual <= motion.error <= 1e-13


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden.name)
def test_periods_are_the_golden_ones_beyond_a_double(golden):
    period = solve(golden).dense.period
    assert isinstance(period, Period)
    gap = Fraction(period.hi) + Fraction(period.lo) - Fraction(golden.period)
    # hi + lo resolves 2^-106; the claim is what the quadrature says of itself.
    assert abs(gap) <= max(Fraction(period.error), Fraction(period.hi) / 2**104)
    assert period.error <= 3e-17 * period.hi


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden.name)
def test_energies_are_the_golden_ones(golden):
    energy = solve(golden).energy
    assert abs(Fraction(energy.value) - Fraction(golden.energy)) <= Fraction(energy.error) + Fraction(
        1, 2**54
    )


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("alpha", "period"),
    [
        ("2", "6.432310535121612579869958267408499"),
        ("3", "9.853280909959509831372235188172033"),
        ("4", "13.36298407186977234524483136555792"),
        ("17/10", "5.42877277657139620106515"),
    ],
)
def test_generalised_bobylev_steklov_periods(alpha, period):
    """V = -|g1|^(2(α-1)/α), λ = 1, through both poles, smooth there or not."""
    rigid_body = body(alpha, 1)
    motion = solve_planar(planar(rigid_body, "-abs(g1)^(2*(A-C)/A)", PlanarMotion(Fraction(1)), (0, 1)))
    found = motion.dense.period
    gap = Fraction(found.hi) + Fraction(found.lo) - Fraction(period)
    # The last number has 24 digits.
    assert abs(gap) <= Fraction(found.error) + Fraction(1, 10**23)
    # The second derivative of V is not bounded about the poles, whatever α.
    assert motion.conventions == ("symmetric_pole_passage",)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("text", "half_period"),
    [
        # Of g1 alone, by AGM in 40 digits: both separatrices, an equilibrium, an inner double root.
        ("-g1 + (1+sqrt(5))/4*(1+1e-4)*(g1^2-g2^2)", "11.638532474857046576440278424317"),
        ("-g1 + (1+sqrt(5))/4*(1-1e-4)*(g1^2-g2^2)", "11.638885132792138979913441573607"),
        ("-g1 + (1+sqrt(5))/4*(1+1e-8)*(g1^2-g2^2)", "20.349310886348759051770962717948"),
        ("-g1 + (1+sqrt(5))/4*(1+1e-12)*(g1^2-g2^2)", "29.059913042594031986693570834465"),
        ("-g1 + (1+sqrt(5))/4*(1-1e-12)*(g1^2-g2^2)", "29.059913042603861616946205069781"),
        ("1e-12*g1 - (g1^2-g2^2)", "30.292038062514761072759494624699"),
        ("-1e-12*g1 - (g1^2-g2^2)", "30.292038062507688063243866818557"),
        ("-g1 + 1/(20*g3^2) + 5/4*(1-1e-6)*(g1^2-g2^2)", "3.2232083834488599112487521787543"),
        ("g1 - (1-1e-8)/(16*g3^2) - (g1^2-g2^2)", "13.86549833483549517550928"),
    ],
)
def test_periods_near_separatrices(text, half_period):
    """T of g1 alone is half the period of the six variables, or all of it between two rest points."""
    rigid_body = body(2, 1)
    potential = formula(text, rigid_body)
    window = 1 if text.startswith("g1 -") else None
    motion = solve_planar(
        planar(rigid_body, potential, PlanarMotion(None, nu=Fraction(1), window=window), (0,))
    )
    trips = 1 if motion.window.ends == ("rest", "rest") else 2
    found = motion.dense.period
    exact = Fraction(found.hi) + Fraction(found.lo)
    gap = abs(exact - trips * Fraction(half_period))
    # The published numbers have at least 25 digits.
    assert gap <= Fraction(found.error) + Fraction(1, 10**22)
    assert found.error <= 1e-15 * found.hi


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("power", "written"), [("-w", "-w*(1 + w)/(1 + w)"), ("-w^2", "-exp(2*log(w))")])
def test_an_angular_part_by_series_is_that_by_hypergeometric_functions(power, written):
    """Where F is not seen to be a power of w, V1 is a series of its integrals along the curve."""
    rigid_body = body(2, 1)
    known, found = (
        solve_planar(
            planar(
                rigid_body, general_potential(rigid_body, F, "0", {}), PlanarMotion(Fraction(1)), (0, 1, 10)
            )
        )
        for F in (power, written)
    )
    assert np.abs(known.samples - found.samples).max() <= known.error + found.error
    assert known.error + found.error < 1e-13
    one, other = known.dense.period, found.dense.period
    assert abs((one.hi - other.hi) + (one.lo - other.lo)) <= one.error + other.error
    # Their roundings are those of two sums of doubles next to 6.
    assert one.error + other.error < 1e-15
