"""Hill's equation against the six variational equations: two of the six multipliers."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from service.dynamics.problem import PlanarMotion, StartAtRest
from service.dynamics.reduction.windows import find_windows
from tests.support.admissible import Case as AdmissibleCase
from tests.support.admissible import cases as admissible
from tests.support.effort import examples
from tests.support.planar import body, formula
from tests.workers.solvers.stability.cases import Case, bobylev_steklov, case, in_window, lambda_, nu
from workers.solvers.stability.monodromy import StabilityUndefinedError

REST = "(17*g1^2 + 10*g3^2)*(g2/3 - g2^2) + abs(g1)^(14/17)"
CASES = {
    "rotation through both poles": lambda: bobylev_steklov(2, 3),
    "g1 < 0": lambda: case(2, 3, 1, "g1", nu(-2)),
    "alpha = 4, through both poles": lambda: case(
        4, "7/2", 1, "-g1*(4*g1^2+3*g3^2) + (4*g1^2+g3^2)/10", lambda_("9/10")
    ),
    "rest, equator, rest": lambda: case(2, "9/10", 1, "-g1 + 1/(20*g3^2)", nu(1)),
    "rest, rest": lambda: case(2, "9/10", 1, "-g1 + 1/(50*g3^2) + 6/5*(g1^2-g2^2)", nu(1)),
    "rest, pole, rest": lambda: case(2, "9/10", 1, "-g1 + 6/5*(g1^2-g2^2)", nu(1)),
    "rest, south pole, rest": lambda: case(
        2, "9/10", 1, "-g1 + 6/5*(g1^2-g2^2)", nu(1, start=StartAtRest(-1))
    ),
    "alpha = 3": lambda: case(
        3, "5/2", 1, "(3*g1^2+g3^2)*(g2^2-1/2+g2^3/5) + abs(g1)^(4/3)/5", lambda_("4/5")
    ),
    "alpha = 1.7, north": lambda: case(17, 16, 10, REST, lambda_("6/5", window=0)),
    "alpha = 1.7, south": lambda: case(17, 16, 10, REST, lambda_("6/5", window=1)),
    "A < C, through both poles": lambda: case(1, "3/2", 2, "-g3", lambda_(1)),
    "A < C, libration": lambda: case(
        1, "5/2", 3, "(g1^2+3*g3^2)*(g2^2-1/2+g2^3/5) + abs(g3)^(4/3)/5", lambda_("5/4")
    ),
}


def agree(found: Case) -> None:
    hill, six = found.hill(), found.jacobian()
    M, trace = six.matrix, hill.trace
    assert abs(six.trace - 4.0 - trace) <= hill.error + six.error
    # Sums of the powers of 1, 1, 1, 1, mu and 1/mu: they determine the six. 2 T_k(trace/2) = mu^k + mu^-k.
    size = np.linalg.norm(M)
    for k in range(1, 7):
        power = [0.0] * k + [1.0]
        pair = 2.0 * np.polynomial.chebyshev.chebval(trace / 2.0, power)
        # What both claim, carried to the k-th power, and fifty roundings of each factor; seen were five.
        slope = abs(np.polynomial.chebyshev.chebval(trace / 2.0, np.polynomial.chebyshev.chebder(power)))
        claimed = slope * hill.error + k * size ** (k - 1) * six.error
        gap = abs(np.trace(np.linalg.matrix_power(M, k)) - (4.0 + pair))
        assert gap <= claimed + k * 1e-14 * size**k


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", CASES)
def test_four_multipliers_are_1_and_two_are_hills(name):
    agree(CASES[name]())


@given(admissible(), st.fractions("1/5", 4, max_denominator=10))
@example(
    # What both claim is more than fifty roundings here.
    AdmissibleCase(
        Fraction(2),
        Fraction(1),
        "(A*g1^2 + C*g3^2)*(-19/9*g2^2) + 2/15*abs(g1)",
        PlanarMotion(Fraction(1, 2), None),
        Fraction(7),
    ),
    Fraction(1, 5),
)
@settings(max_examples=examples(5, 15), deadline=None)
def test_in_any_window_of_any_admissible_potential(problem, B):
    rigid_body = body(problem.A, problem.C, B)
    potential = formula(problem.text, rigid_body)
    for window in find_windows(rigid_body, potential, problem.motion):
        if window.kind == "periodic":
            found = in_window(rigid_body, potential, problem.motion, window)
            try:
                agree(found)
            except StabilityUndefinedError:
                with pytest.raises(StabilityUndefinedError):
                    found.hill()
                with pytest.raises(StabilityUndefinedError):
                    found.jacobian()
                assert found.start.arc.is_whole_loop or found.start.arc.poles


@pytest.mark.parametrize("by", [Case.hill, Case.jacobian])
def test_no_multipliers_through_a_pole_where_the_field_is_not_smooth(by):
    # c = −5/t² there: q ~ t² or 1/t, and nothing says how either goes on.
    with pytest.raises(StabilityUndefinedError, match="not twice differentiable"):
        by(case(3, "5/2", 1, "-abs(g1)^(4/3)", lambda_(1)))


def spike(exponent: int) -> Case:
    text = f"-g1 + (2*g1^2+g3^2)*exp(-10^{2 * exponent}*(g2-3/10)^2)/100"
    return case(2, "3/2", 1, text, lambda_(1))


def test_the_trace_sees_a_spike_of_any_width():
    """It is passed in a time proportional to its width, and so is what it does to the trace at first."""
    plain, wide, narrow = (each.hill() for each in (bobylev_steklov(1, "3/2"), spike(3), spike(5)))
    shifts = wide.trace - plain.trace, narrow.trace - plain.trace
    # The second order is the first times the width, 1e-3, beside the errors.
    errors = wide.error + plain.error + 100.0 * (narrow.error + plain.error)
    assert abs(shifts[0] - 100.0 * shifts[1]) <= 2e-3 * abs(shifts[0]) + errors
    assert abs(shifts[0]) > 1e-6


def test_both_equations_see_it():
    found = spike(4)
    hill, jacobian = found.hill(), found.jacobian()
    # Four multipliers are 1.
    assert abs(jacobian.trace - 4.0 - hill.trace) <= hill.error + jacobian.error
