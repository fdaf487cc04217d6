from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx, fmpq

from service.dynamics.formula.parameters import bind
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import VARIABLES
from service.dynamics.motion import COLUMNS
from service.dynamics.problem import PlanarMotion, StartAtEquator, TimeList
from tests.support.planar import body, formula
from workers.solvers.compiled.evaluation.program import make_program
from workers.solvers.compiled.solve import solve_spectral
from workers.sweeping.planar.doubles import Sampling, sweep_sets

DOUBLE = body(2, 1)
TIMES = np.linspace(-7.0, 23.0, 101)
MOTIONS = [
    (body(2, 1), "-g1", PlanarMotion(None, nu=Fraction(1))),
    (body(2, 1), "-g1 + 1/(20*g3^2)", PlanarMotion(None, nu=Fraction(1))),
    (body(3, 1), "(3*g1^2+g3^2)*(g2^2-1/2+g2^3/5)", PlanarMotion(Fraction(4, 5))),
    (body(3, 5), "(A*g1^2+C*g3^2)*(g2^2-1/2)", PlanarMotion(Fraction(4, 5))),
]


def solve(rigid_body, text, motion, tier="standard"):
    found = solve_spectral(rigid_body, formula(text, rigid_body), motion, tier=tier)
    assert found is not None
    return found


@pytest.mark.parametrize(("rigid_body", "text", "motion"), MOTIONS)
def test_the_motion_backwards_starts_with_the_other_sign_of_s(rigid_body, text, motion):
    forth = solve(rigid_body, text, motion)
    back = solve(
        rigid_body,
        text,
        PlanarMotion(motion.lambda_, motion.nu, start=StartAtEquator(-1)),
    )
    # omega(-t) = -omega(t), gamma(-t) = gamma(t) from the same place with s reversed.
    reversed_ = back.sample(-TIMES) * np.array([-1, -1, -1, 1, 1, 1])
    bound = forth.error_at(TIMES) + back.error_at(TIMES)
    assert np.abs(forth.sample(TIMES) - reversed_).max() <= bound <= 1e-9


@pytest.mark.parametrize("scale", [10**6, Fraction(1, 10**30)])
@pytest.mark.parametrize(("rigid_body", "text", "motion"), MOTIONS)
def test_a_potential_k_times_as_strong_runs_sqrt_k_times_as_fast(rigid_body, text, motion, scale):
    slow = solve(rigid_body, text, motion)
    fast = solve(rigid_body, f"({scale})*({text})", motion)
    factor = float(scale) ** 0.5
    there = fast.sample(TIMES / factor)
    there[:, :3] /= factor
    # error_at of the fast one is absolute in omega, and its times are smaller by the factor.
    bound = slow.error_at(TIMES) + fast.error_at(TIMES / factor) / min(1.0, factor)
    assert np.abs(slow.sample(TIMES) - there).max() <= bound


@pytest.mark.parametrize(("rigid_body", "text", "motion"), MOTIONS)
def test_the_motion_stays_on_its_curve_and_the_sphere_and_keeps_its_energy(rigid_body, text, motion):
    found = solve(rigid_body, text, motion)
    p, q, r, g1, g2, g3 = found.sample(TIMES).T
    A, C = float(rigid_body.A), float(rigid_body.C)
    lambda_ = float(motion.lambda_squared) ** 0.5
    # Roundings alone: these hold whatever the phase is.
    np.testing.assert_allclose(g1**2 + g2**2 + g3**2, 1.0, rtol=0, atol=2e-15)
    np.testing.assert_allclose(np.abs(g3), lambda_ * np.abs(g1) ** (C / A), rtol=0, atol=5e-15)
    np.testing.assert_allclose(A * p * g1 + C * r * g3, 0.0, rtol=0, atol=5e-15)
    assert not q.any()
    energy = found.energy(rigid_body)
    values = formula(text, rigid_body).value(np.stack([g1, g2, g3], axis=1))
    h = (A * p**2 + C * r**2) / 2 + values
    # p and r are as good as dt/du, and V follows them.
    assert np.abs(h - energy.value).max() <= energy.error + 20.0 * found.error_at(np.zeros(1))


def test_a_hundred_million_periods_cost_no_digit():
    found = solve(DOUBLE, "-g1 + 1/(20*g3^2)", PlanarMotion(None, nu=Fraction(1)), "high")
    with ctx.workprec(200):
        # G4: half the period to 40 digits.
        period = 2 * arb("3.170038968616406868351677946564008046773")
        late = np.linspace(1e8, 1e8 + 1.0, 101) * found.period.hi
        near = np.array([float(arb(t) - (arb(t) / period).floor() * period) for t in late])
    difference = float(np.abs(found.sample(late) - found.sample(near)).max())
    # ``near`` is rounded to half an ulp of the period, which the motion's speed below 2 doubles.
    assert difference <= 3e-15
    assert found.error_at(late) <= 1.2 * found.error_at(near)


def test_columns_are_those_of_the_sample():
    found = solve(*MOTIONS[1])
    names = ("g3", "p")
    every = found.sample(TIMES)
    assert np.array_equal(found.columns(TIMES, names), every[:, [COLUMNS.index(name) for name in names]])


@pytest.mark.parametrize("tier", ["standard", "high"])
def test_the_digits_of_a_time_do_not_depend_on_the_others(tier):
    found = solve(DOUBLE, "-g1 + 1/(20*g3^2)", PlanarMotion(None, nu=Fraction(1)), tier)
    # More than two blocks of 1024; the single ones are at both sides of where a block ends.
    times = np.random.default_rng(3).uniform(-1e4, 1e4, 2500)
    together = found.sample(times)
    for k in (0, 1, 1023, 1024, 2047, 2048, 2499):
        assert np.array_equal(found.sample(times[k : k + 1])[0], together[k])
    assert np.array_equal(found.sample(times[::-1]), together[::-1])


def sweep_of(program, rows, lambdas, times):
    """Solve with each row of constants, on the curve of the same place's λ."""
    sampling = Sampling(TimeList(tuple(map(Fraction, times.tolist()))), np.arange(6))
    squares = [fmpq(*(Fraction(value) ** 2).as_integer_ratio()) for value in lambdas]
    return sweep_sets(DOUBLE, PlanarMotion(Fraction(3)), program, rows, squares, sampling, "standard")


def test_a_sweep_has_the_numbers_of_single_problems():
    values = [Fraction(k, 7) for k in range(3, 12)]
    potentials = [formula(f"-({value})*g1 + 1/(20*g3^2)", DOUBLE) for value in values]
    programs = [make_program(potential.tape) for potential in potentials]
    motion, times = PlanarMotion(Fraction(1)), np.linspace(0.0, 9.0, 20)
    same = [k for k, (program, _) in enumerate(programs) if program.key == programs[0][0].key]
    assert len(same) >= 7
    rows = np.array([programs[k][1] for k in same])
    swept = sweep_of(programs[0][0], rows, [1] * len(same), times)
    for row, k in enumerate(same):
        single = solve_spectral(DOUBLE, potentials[k], motion, tier="standard")
        assert np.array_equal(swept.samples[row], single.sample(times))
        assert swept.periods[row] == single.period.hi
        assert swept.errors[row] == single.error_at(times)


def test_parameters_and_lambda_vary_in_a_sweep():
    names = (*VARIABLES, "a", "b")
    tape = compile_tape(bind(parse("a*g1 + b/g3^2"), {}, variables=names), names)
    program, constants = make_program(tape)
    rows = np.repeat(constants[None, :], 3, axis=0)
    rows[:, 0], rows[:, 1] = (-1.0, -2.0, 1.0), (0.05, 0.0625, 0.05)
    times = np.linspace(0.0, 9.0, 20)
    swept = sweep_of(program, rows, [1, Fraction(5, 4), 1], times)
    for k, (text, lambda_) in enumerate((("-g1 + 1/(20*g3^2)", 1), ("-2*g1 + 1/(16*g3^2)", Fraction(5, 4)))):
        single = solve(DOUBLE, text, PlanarMotion(Fraction(lambda_)))
        bound = swept.errors[k] + single.error_at(times)
        assert np.abs(swept.samples[k] - single.sample(times)).max() <= bound <= 1e-9
    # Pulled away from every point of the curve: no motion.
    assert np.isnan(swept.samples[2]).all()
    assert swept.errors[2] == np.inf
