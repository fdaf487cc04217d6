"""Drifts of integrals with twice the digits: the very numbers that balls have, or none."""

from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx

from service.dynamics.equations.euler_poisson import kinetic_energy
from service.dynamics.further_integrals import FurtherIntegral, integral_drift
from service.dynamics.potentials.families.written import general_potential
from tests.support.planar import body, formula
from workers.solvers.compiled import integrals
from workers.solvers.compiled.evaluation.program import make_program, rests_of
from workers.solvers.compiled.integrals import (
    drifts_of_many,
    energies_at,
    further_drifts_of_many,
    potential_energies,
)
from workers.solvers.evidence import drifts_of, further_drift

BODY = body(2, 1)
SETS, SAMPLES = 6, 40
TIGHT = 2.0**-88
"""More than the bounds of one operation on numbers below 10 that are known to 2^-98."""


def states(seed=1, octant=False):
    """Return samples with q = 0 and γ of length 1."""
    found = np.random.default_rng(seed).normal(size=(SETS, SAMPLES, 6))
    found[..., 1] = 0.0
    gamma = found[..., 3:]
    gamma /= np.linalg.norm(gamma, axis=-1, keepdims=True)
    found[..., 3:] = np.abs(gamma) if octant else gamma
    return found


def drifts(V, energies, samples, wanted=range(SETS)):
    program, constants = make_program(V.tape)
    rows = [np.repeat(row[None], SETS, axis=0) for row in (constants, rests_of(V.tape, constants))]
    return drifts_of_many(BODY, program, *rows, energies, samples, np.array(wanted, dtype=np.int64))


def by_balls(V, samples, energy):
    """Return the drift of the energy, V summed in balls of 128 bits."""
    with ctx.workprec(128):
        values = np.array([float(ball) for ball in V.value_balls(samples[:, 3:].tolist())])
    return np.abs(kinetic_energy(BODY, samples[:, :3]) + values - energy).max()


@pytest.mark.parametrize(
    "text",
    [
        "-g1/3 + 1/(20*g3^2)",
        "(A*g1^2 + C*g3^2)*g2^3 - abs(g1)^(4/3)/3 + sqrt(g1 + 2)/abs(g3)^(1/2)",
        "exp(g2)*log(2 + g1)*sin(3*g1) + cos(g2)*tan(g3) + exp(1/7)*g1 + pi*g1/abs(g1)",
        "g1^63*g2 - 1/g2^3",
        "1/3",
    ],
)
def test_the_drifts_are_those_of_a_single_job(text):
    V, samples, energies = formula(text, BODY), states(), np.linspace(-1.0, 1.0, SETS)
    found = drifts(V, energies, samples)
    for n in range(SETS):
        own = drifts_of(BODY, V, samples[n], energies[n], is_planar=True)
        assert found[n].tolist() == [own.energy, own.geometric, own.areas]
        assert own.energy == by_balls(V, samples[n], energies[n])


def test_powers_that_vary_have_the_numbers_of_balls():
    V, samples, energies = formula("g1^g3 - g3^(1/3)", BODY), states(octant=True), np.zeros(SETS)
    found = drifts(V, energies, samples)
    assert found[:, 0].tolist() == [by_balls(V, samples[n], 0.0) for n in range(SETS)]


def test_values_of_the_potential_are_what_balls_round_to():
    V, samples = formula("(A*g1^2 + C*g3^2)*g2^3/7 - abs(g1)^(4/3)/3", BODY), states()[0]
    program, constants = make_program(V.tape)
    found = np.empty(SAMPLES)
    potential_energies(program.code, program.result, constants, rests_of(V.tape, constants), samples, found)
    with ctx.workprec(300):
        assert found.tolist() == [float(ball) for ball in V.value_balls(samples[:, 3:].tolist())]


def test_samples_that_are_not_known_are_summed_in_balls():
    V, samples = formula("g1 + 10^40*(g3 + 1/3) - 10^40*(g3 + 1/3)", BODY), states()
    assert np.isnan(energies_at(V, samples[0])).all()
    own = drifts_of(BODY, V, samples[0], 0.5, is_planar=True)
    assert own.energy == by_balls(V, samples[0], 0.5)


def test_a_potential_by_an_integral_has_no_program():
    V = general_potential(BODY, "w^2", "1", {})
    assert np.isnan(energies_at(V, states()[0])).all()
    assert drifts_of(BODY, V, states()[0], 0.0, is_planar=True).energy == by_balls(V, states()[0], 0.0)


@pytest.mark.parametrize(
    "text",
    [
        # More digits cancel than there are.
        "10^40*(g1 + 1/3) - 10^40*(g1 + 1/3 + 10^(-45)*g3)",
        # No value where g1 < 0, nor for balls.
        "log(g1)",
        "1/(g1 - g1 + 10^(-60)*g2 - 10^(-60)*g2)",
    ],
)
def test_what_is_not_known_is_not_told(text):
    assert np.isnan(drifts(formula(text, BODY), np.zeros(SETS), states())[:, 0]).all()


def test_only_what_is_wanted_is_told():
    found = drifts(formula("-g1", BODY), np.zeros(SETS), states(), wanted=[1, 4])
    assert np.flatnonzero(~np.isnan(found).any(axis=1)).tolist() == [1, 4]
    assert np.isnan(found[[0, 2, 3, 5]]).all()


@pytest.mark.parametrize(
    "parameters", [("-1", "0", "0", "0", "0"), ("-1/3", "1/7", "2/5", "3", "1/9"), ("0", "0", "0", "0", "1")]
)
def test_further_integrals_are_those_of_a_single_job(parameters):
    integral = FurtherIntegral("goriachev", "zero_areas", Fraction(3, 2), *map(Fraction, parameters))
    other = FurtherIntegral("kovalevskaya", "general", Fraction(1), *map(Fraction, ("2", *4 * ("0",))))
    samples = states(2)
    found = further_drifts_of_many({0: integral, 2: other, 5: integral}, samples)
    assert np.isnan(found[[1, 3, 4]]).all()
    for n, one in ((0, integral), (2, other), (5, integral)):
        assert tuple(found[n].tolist()) == integral_drift(one, samples[n]) == further_drift(one, samples[n])


def test_a_cubic_integral_is_left_to_balls():
    integral = FurtherIntegral(
        "goriachev_chaplygin", "zero_areas", Fraction(1), *map(Fraction, (1, 2, 0, 0, 3))
    )
    square = FurtherIntegral("kovalevskaya", "general", Fraction(1), *map(Fraction, ("2", *4 * ("0",))))
    samples = states(4)
    found = further_drifts_of_many({0: integral, 1: square}, samples)
    assert np.isnan(found[0]).all()
    assert not np.isnan(found[1]).any()
    assert further_drift(integral, samples[0]) == integral_drift(integral, samples[0])


def test_a_further_integral_at_a_pole_is_left_to_balls():
    integral = FurtherIntegral("goriachev", "zero_areas", Fraction(1), *map(Fraction, (0, 0, 0, 0, 1)))
    samples = states(3)
    samples[1, 7, 5] = 0.0
    found = further_drifts_of_many({0: integral, 1: integral}, samples)
    assert np.isnan(found[1, 1])
    assert further_drift(integral, samples[1]) == integral_drift(integral, samples[1])
    assert found[0, 1] == integral_drift(integral, samples[0])[1]


def _numbers(count=200):
    """Yield pairs that are known a little, the first positive."""
    for a, b, u, v in np.random.default_rng(7).uniform([0.1, -5, -1, -1], [5, 5, 1, 1], (count, 4)).tolist():
        yield (a, 2.0**-54 * a * u, 2.0**-98), (b, 2.0**-54 * b * v, 2.0**-98)


@pytest.mark.parametrize(
    ("name", "exact"),
    [
        ("plus", lambda x, y: x + y),
        ("minus", lambda x, y: x - y),
        ("times", lambda x, y: x * y),
        ("over", lambda x, y: x / y),
        ("power", lambda x, y: x**y),
        ("square_root", lambda x, _: x.sqrt()),
        ("exponential_of", lambda _, y: y.exp()),
        ("logarithm_of", lambda x, _: x.log()),
        ("sine", lambda _, y: y.sin()),
        ("cosine", lambda _, y: y.cos()),
        ("tangent", lambda _, y: y.tan()),
    ],
)
def test_errors_are_within_their_bounds(name, exact):
    """The bounds hold for every number within those of the operands, so at their ends, too."""
    functions = {"sine": 10, "cosine": 11, "tangent": 12}

    def apply(x, y):
        if name in functions:
            return integrals.function(functions[name], y)
        if name == "exponential_of":
            return integrals.exponential_of(y)
        operation = getattr(integrals, name)
        return operation(x) if name in ("square_root", "logarithm_of") else operation(x, y)

    with ctx.workprec(300):
        for x, y in _numbers():
            high, low, error = apply(x, y)
            for side in (-1, 0, 1):
                a, b = (arb(one[0]) + arb(one[1]) + side * arb(one[2]) for one in (x, y))
                off = abs(exact(a, b) - arb(high) - arb(low))
                assert off < 2.0 * error
            assert error <= TIGHT * max(1.0, abs(high)) ** 3 * (100.0 if name == "tangent" else 1.0)


def test_a_number_rounds_to_the_double_that_all_within_its_error_round_to():
    above = np.nextafter(1.0, 2.0)
    assert integrals.nearest((1.0, 2.0**-60, 2.0**-100)) == 1.0
    assert integrals.nearest((1.0, 0.75 * 2.0**-52, 2.0**-100)) == above
    assert np.isnan(integrals.nearest((1.0, 2.0**-53, 2.0**-100)))
    assert np.isnan(integrals.nearest((1.0, 2.0**-53 - 2.0**-101, 2.0**-100)))
    assert np.isnan(integrals.nearest((1.0, 0.0, np.inf)))
    assert np.isnan(integrals.nearest((np.nan, 0.0, 0.0)))
    # Below a power of two doubles are twice as near.
    assert np.isnan(integrals.nearest((1.0, -(2.0**-54), 2.0**-100)))
