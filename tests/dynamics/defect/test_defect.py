"""The defect of a function of time is what it leaves of the equations, between its nodes as well."""

from dataclasses import replace
from math import inf, isnan, nan

import numpy as np
import pytest
from scipy.integrate import quad

from service.dynamics.defect.accumulation import Blocks, Cutter, accumulate
from service.dynamics.defect.equations import Equations
from service.dynamics.defect.evidence import check_residual, check_samples
from service.dynamics.equations.euler_poisson import energy_integral, euler_poisson_rhs
from service.dynamics.motion import COLUMNS, Estimate
from service.dynamics.numerics import is_within
from service.dynamics.problem import PlanarMotion
from service.dynamics.solution.dense_output import DenseOutput, chebyshev_coefficients, chebyshev_points
from tests.support import planar as support
from tests.support.effort import each_once
from tests.support.planar import body, planar
from tests.support.solving import solve_planar

BODY = body(2, 1, "3/2")
WALL = "-g1 + (2*g1^2+g3^2)*2*exp(-{steepness}*(g2-3/10)^2)"


@pytest.fixture(scope="module")
def motion():
    return solve_planar(planar(BODY, "-g1", PlanarMotion(1)))


def formula(text):
    return support.formula(text, BODY)


def shown(motion, text="-g1", dense=None, claim=None, **changes):
    dense = motion.dense if dense is None else dense
    claim = dense.error if claim is None else claim
    arguments = {"is_planar": True, **changes}
    return check_residual(BODY, formula(text), dense, claim, motion.energy, **arguments)


def planted(dense, piece, degree, size, column=3):
    """The function of time with one more Chebyshev polynomial in one column of a piece."""
    coefficients = np.pad(dense.coefficients, ((0, 0), (0, max(0, degree + 1 - 21)), (0, 0)))
    coefficients[piece, degree, column] += size
    return replace(dense, coefficients=coefficients)


def test_rates_and_integrals_are_those_of_the_equations(motion):
    potential = formula("-g1 + g2*g3^2/7")
    states = np.array([[0.3, -0.2, 0.7, 0.6, 0.48, 0.64], [1.0, 2.0, 3.0, 0.0, -0.8, 0.6]])
    rates, integrals = Equations.of(BODY, potential).at(states)
    expected = euler_poisson_rhs(BODY, potential, states[:, :3], states[:, 3:])
    np.testing.assert_allclose(rates, np.hstack([expected.omega, expected.gamma]), rtol=0, atol=1e-14)
    energies = energy_integral(BODY, potential, states[:, :3], states[:, 3:])
    np.testing.assert_allclose(integrals[:, 0], energies, rtol=0, atol=1e-14)


def test_the_bound_holds_between_the_nodes(motion):
    """D by another way: adaptive Gauß-Kronrod of F along the polynomials, at random times."""
    text = "-g1 + (2*g1^2+g3^2)/100*exp(-400*(g2-3/10)^2)"
    equations = Equations.of(BODY, formula(text))
    found = accumulate(
        motion.dense, list(Blocks(motion.dense, equations.at, equations.bound).cut(1e-12)), has_bounds=True
    )
    assert found.settled_share == 1.0
    rng = np.random.default_rng(5)
    start = motion.dense(np.zeros(1))[0]
    for t in rng.uniform(0.0, motion.dense.breaks[-1], 2):
        stretch = int(np.searchsorted(found.starts, t, side="right")) - 1
        for column in (0, 2):
            F = lambda s, k=column: equations.at(motion.dense(np.array([s])))[0][0, k]  # noqa: E731
            corners = [c for c in found.starts if c < t]
            integral = sum(
                quad(F, a, b, epsabs=1e-10, epsrel=1e-10, limit=200)[0]
                for a, b in zip(corners, [*corners[1:], t], strict=True)
            )
            D = motion.dense(np.array([t]))[0, column] - start[column] - integral
            # Quadrature of each of some tens of stretches to 1e-10.
            assert abs(D - found.before[stretch, column]) <= found.within[stretch, column] + 1e-8


@pytest.mark.parametrize("steepness", ["10^2", "10^6", "10^10", "10^16"])
def test_a_wall_between_the_nodes_is_seen(motion, steepness):
    """The motion of -g1 crosses where the wall stands. Its force does not vanish on stretches that small."""
    found = shown(motion, WALL.format(steepness=steepness))
    assert found.settled == 1.0
    assert found.error > 1.0
    assert found.defect > 0.1


def test_a_solution_of_the_very_equations_keeps_its_claim(motion):
    found = shown(motion)
    assert found.settled == 1.0
    assert found.error == motion.dense.error
    # D of a function within the claim of a motion, and of some ulp more of F than that.
    assert found.defect < 1e-13
    assert found.drift < 1e-14


@each_once(column=list(range(6)), size=[1e-6, 1e-9, 1e-12], degree=[20, 40])
def test_an_error_planted_in_one_piece_is_in_the_claim(motion, degree, size, column):
    """T_20 vanishes at none of the nodes of degree 20, T_40 − 1 at all of them."""
    coefficients = motion.dense.coefficients
    dense = planted(motion.dense, 3, degree, size, column)
    if degree == 40:
        dense = planted(dense, 3, 0, -size, column)
    points = 0.5 * (1.0 + chebyshev_points(20))
    left, right = dense.breaks[3:5]
    moved = np.abs(dense(left + (right - left) * points) - motion.dense(left + (right - left) * points)).max()
    assert (moved < 1e-14) == (degree == 40)
    found = shown(motion, dense=dense)
    assert len(coefficients) > 4
    assert found.defect >= 0.9 * size
    assert found.error >= 0.9 * size


@pytest.mark.parametrize("size", [1e-6, 1e-11])
def test_a_jump_between_pieces_is_in_the_claim(motion, size):
    found = shown(motion, dense=planted(motion.dense, 2, 0, size, 3))
    assert found.error >= 0.9 * size


def test_another_energy_is_seen_without_any_defect(motion):
    """A motion of the same equations with a slightly other energy has no defect, but it drifts."""
    other = replace(motion, energy=replace(motion.energy, value=motion.energy.value + 1e-7))
    found = shown(other)
    assert found.drift >= 0.99e-7
    # The gradient of the energy is below 2 + 2 + 1 in any sum of its parts.
    assert found.error >= 1e-7 / 8.0


def test_a_not_finite_function_of_time_shows_no_claim(motion):
    for value in (nan, inf):
        found = shown(motion, dense=planted(motion.dense, 3, 5, value))
        assert isnan(found.error) or found.error == inf


def test_samples_off_the_energy_raise_their_claim(motion):
    samples = motion.dense(np.linspace(0.0, 6.0, 50))
    assert check_samples(BODY, formula("-g1"), samples, 1e-14, motion.energy) == 1e-14
    samples[17, 0] += 1e-8
    assert check_samples(BODY, formula("-g1"), samples, 1e-14, motion.energy) > 1e-10


@pytest.mark.parametrize("value", [nan, inf])
def test_no_bound_lets_what_is_not_finite_pass(motion, value):
    breaks = motion.dense.breaks.copy()
    breaks[-1] = value
    energy = motion.energy
    not_finite = [
        shown(motion, claim=value),
        shown(motion, dense=replace(motion.dense, breaks=breaks)),
        shown(replace(motion, energy=replace(energy, value=value))),
        shown(replace(motion, energy=replace(energy, error=value))),
    ]
    assert not any(is_within(found.error, 1.0) for found in not_finite)
    for column in range(6):
        samples = motion.dense(np.linspace(0.0, 6.0, 5))
        samples[3, column] = value
        for text in ("-g1", "-g1 + 0*g2"):
            assert not is_within(check_samples(BODY, formula(text), samples, 1e-14, energy), 1.0)


@np.errstate(all="ignore")
def held(text, state, off, claim=1e-9):
    """Hold one state, of any areas integral, against an energy that is ``off`` by so much."""
    samples = np.array([state])
    areas = equations_of(text).at(samples)[1][0]
    samples[0, 1] = -areas[1] / (1.5 * state[4])
    energy = float(equations_of(text).at(samples)[1][0, 0])
    return check_samples(BODY, formula(text), samples, claim, Estimate(energy + off, 0.0, "estimate"))


def equations_of(text):
    return Equations.of(BODY, formula(text))


STATES = {
    # |z| is not analytic about 0, and V has a kink there, or no derivative.
    "-g1+abs(g1)": (0.3, 0.0, 0.5, 1e-12, 0.8, 0.6),
    "-g1+abs(g1)^(4/3)": (0.3, 0.0, 0.5, 1e-12, 0.8, 0.6),
    # V has no bound within the claim of the state.
    "-g3+g1*log(g1)": (0.3, 0.0, 0.5, 1e-12, 0.8, 0.6),
    # It has bounds everywhere.
    "-g1": (0.3, 0.0, 0.5, 1e-12, 0.8, 0.6),
}


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("text", "state"), STATES.items())
def test_an_energy_is_not_believed_because_discs_say_nothing(text, state):
    """An energy that is off by 1e-3 needs an error of that order; NaN of a disc explains nothing."""
    assert held(text, state, 0.0) == 1e-9
    # The rates of the energy are below 2 in any sum of their parts where V is smooth.
    assert held(text, state, 1e-3) > 1e-4


def test_an_error_smaller_than_the_claim_explains_a_departure():
    """About 1/g1 = 1e10 V has no bound within the claim; 1e-12, a thousandth of it, changes V by 1e-7."""
    state = (0.3, 0.0, 0.5, 1e-10, 0.8, 0.6)
    assert held("-g1+1e-15/g1", state, 1e-7) == 1e-9


def test_a_pole_on_the_way_is_left_out_and_told():
    """1/√|g2|-like forces have no bound about g2 = 0: all but 2^-40 of a piece on either side is settled."""
    points = chebyshev_points(8)
    values = np.zeros((9, 1, 6))
    values[:, 0, 4], values[:, 0, 3] = points, 0.6
    dense = DenseOutput(
        COLUMNS, np.array([0.0, 2.0]), chebyshev_coefficients(values).swapaxes(0, 1), None, 1e-9
    )
    equations = Equations.of(BODY, formula("g1*abs(g2)^(1/2)"))
    stretches = Cutter(dense.coefficients, np.array([2.0]), equations.bound).cut(1e-6)
    lost = stretches.half[~stretches.is_settled]
    assert 0 < len(lost) <= 4
    assert lost.max() <= 2.0**-39
    assert stretches.half.sum() == 1.0


def test_discs_hold_what_polynomials_take_beside_the_stretch(motion):
    """At points of the ellipses about a piece, its quarters and theirs, which are complex."""
    seen = []

    def bound(centres, radii):
        seen.append((centres, radii))
        return np.full_like(centres, inf if len(seen) < 3 else 0.0)

    Cutter(motion.dense.coefficients[:1], np.ones(1), bound).cut(1.0)
    centres, radii = (np.concatenate(parts, axis=1) for parts in zip(*seen, strict=True))
    halves = np.concatenate([4.0**-g * np.ones(4**g) for g in range(4)])
    middles = np.concatenate([4.0**-g * np.arange(1 - 4**g, 4**g, 2) for g in range(4)])
    assert centres.shape[1] == len(halves)
    circle = np.exp(2j * np.pi * np.arange(48) / 48)
    for k, (middle, half) in enumerate(zip(middles, halves, strict=True)):
        z = middle + half * 0.5 * (4.0 * circle + 0.25 / circle)
        values = np.polynomial.chebyshev.chebval(z, motion.dense.coefficients[0])
        assert (np.abs(values - centres[:, [k]]) <= radii[:, [k]]).all()
        # Not much larger than what they hold: a factor 4, and what rounded T_20 are out there.
        assert (radii[:, k] <= 4.0 * np.abs(values - centres[:, [k]]).max(axis=1) + 1e-5).all()


def test_pieces_that_were_cut_for_another_goal_are_cut_as_if_it_were_the_first(motion):
    equations = Equations.of(BODY, formula("-g1"))
    again = Blocks(motion.dense, equations.at, equations.bound)
    for goal in (1e-3, 1e-7, 1e-12, 1e-7):
        (found,), (expected,) = (
            list(pieces.cut(goal)) for pieces in (again, Blocks(motion.dense, equations.at, equations.bound))
        )
        for part in ("piece", "middle", "half", "tail"):
            np.testing.assert_array_equal(getattr(found.stretches, part), getattr(expected.stretches, part))
        for part in ("times", "states", "rates", "integrals"):
            np.testing.assert_array_equal(getattr(found, part), getattr(expected, part))
