"""The compiled code says of a function of time what arrays say, and never of a false claim."""

from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from service.dynamics.defect.accumulation import Blocks, accumulate
from service.dynamics.defect.equations import Equations
from service.dynamics.defect.evidence import check_residual, check_samples
from service.dynamics.problem import Accuracy, PlanarMotion
from service.dynamics.solution.dense_output import DenseOutput
from tests.support.effort import examples
from tests.support.planar import body, formula, planar
from tests.support.solving import solve_planar
from workers.solvers import evidence
from workers.solvers.choose import find_motion
from workers.solvers.compiled import records
from workers.solvers.compiled.evaluation.interpreter import new_registers
from workers.solvers.compiled.evaluation.program import make_program
from workers.solvers.compiled.residual.nodes import WIDTH, evaluate, in_lanes, integrals_on, largest_rates
from workers.solvers.compiled.residual.residual import hold, kept_claim, samples_keep_claim

BODY = body(2, 1, "3/2")
FORMULAS = (
    "-g1 + g2*g3^2/7",
    "exp(g1*g2)/3 - sin(2*g2 + g3) + cos(g1)",
    "log(3 + g2) * abs(2 + g1) + tan(g2/3)",
    "(2*g1^2 + g3^2)*(g2^2 - 1/2) + 1/(3 + g1)^(5/2)",
    "(4 + g3)^(g2/2) - (5 + g1)^(-3) + sqrt(2 + g2)/(3 + g3^2) - 2^g2",
    "abs(g1 - 3)*g2 + 1/(4 - g2)",
)
unit = st.floats(-1.0, 1.0)
states = st.lists(unit, min_size=6, max_size=6).map(np.array)
texts = st.sampled_from(FORMULAS)


@cache
def parts(text):
    potential = formula(text, BODY)
    program, constants = make_program(potential.tape)
    A, B, C = (float(each) for each in (BODY.A, BODY.B, BODY.C))
    moments = np.array([A, B, C, B - C, C - A, A - B])
    return Equations.of(BODY, potential), records.Equations(program.gradient, constants, moments)


def on_disc(text, centres, radii):
    equations = parts(text)[1]
    discs = new_registers(equations.gradient.code, 2, 1)
    bounds, found = np.empty(6), np.empty((2, 3))
    largest_rates(equations, discs, centres, radii, bounds)
    integrals_on(equations, discs, centres, radii, found)
    return bounds, found


@given(texts, states)
def test_rates_and_integrals_are_those_of_arrays(text, state):
    arrays, equations = parts(text)
    registers = new_registers(equations.gradient.code, 1, WIDTH)
    rates, integrals = np.empty((6, WIDTH)), np.empty((3, WIDTH))
    columns = np.tile(state[:, None], WIDTH)
    evaluate(equations, registers, columns, rates, integrals, 2)
    expected, others = arrays.at(state[None])
    # Some twenty roundings of numbers below 100.
    np.testing.assert_allclose(rates[:, 1], expected[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(integrals[:, 1], others[0], rtol=0, atol=1e-12)


@given(texts, states, st.floats(0.0, 0.8))
def test_bounds_on_discs_are_those_of_arrays(text, state, radius):
    """The formulas are the same; roundings are counted here and there by other multiples of 2^-50."""
    equations = parts(text)[0]
    bounds, found = on_disc(text, state, np.full(6, radius))
    others = equations.bound(state[:, None], np.full((6, 1), radius))[:, 0]
    np.testing.assert_allclose(bounds, others, rtol=1e-9, atol=1e-12)
    centres, radii = equations.integrals_on(state[:, None], np.full((6, 1), radius))
    np.testing.assert_allclose(found[0], centres[:, 0], rtol=0, atol=1e-12)
    # Compiled code takes V and its derivatives together: without a bound of these it has none of V.
    if np.isfinite(radii).all() and np.isfinite(bounds).all():
        np.testing.assert_allclose(found[1], radii[:, 0], rtol=1e-9, atol=1e-12)


@given(texts, states, st.floats(0.0, 0.5), st.integers(0, 2**32 - 1))
def test_no_state_of_a_disc_has_larger_rates(text, state, radius, seed):
    """At real states of the disc, by the arrays of doubles, which know nothing of discs."""
    equations = parts(text)[0]
    bounds, found = on_disc(text, state, np.full(6, radius))
    assume(np.isfinite(bounds).all())
    inside = state + radius * np.random.default_rng(seed).uniform(-1.0, 1.0, (50, 6))
    rates, integrals = equations.at(inside)
    # The doubles themselves are off by their roundings.
    assert (np.abs(rates) <= bounds + 1e-12).all()
    assert (np.abs(integrals - found[0]) <= found[1] + 1e-12).all()


@pytest.mark.parametrize("text", ["abs(g1)", "log(g1)", "1/g1", "sqrt(g1)", "g1^(-2)", "g1^g2", "g1/abs(g1)"])
def test_nothing_is_known_where_a_formula_is_not_analytic(text):
    bounds, _ = on_disc(text, np.array([0.1, 0.2, 0.3, 0.2, 0.3, 0.4]), np.full(6, 0.25))
    assert not np.isfinite(bounds).all()


@pytest.fixture(scope="module")
def motion():
    return solve_planar(planar(BODY, "-g1", PlanarMotion(1)))


def kept(motion, text="-g1", dense=None, claim=None):
    dense = motion.dense if dense is None else dense
    return kept_claim(
        BODY, formula(text, BODY), dense, dense.error if claim is None else claim, motion.energy
    )


def test_a_solution_of_the_very_equations_keeps_its_claim(motion):
    found = kept(motion)
    arrays = check_residual(
        BODY, formula("-g1", BODY), motion.dense, motion.dense.error, motion.energy, is_planar=True
    )
    assert (found.settled, found.error) == (1.0, arrays.error)
    # Both are sums of roundings, in another order.
    assert found.defect == pytest.approx(arrays.defect, rel=0.2)
    assert found.drift == pytest.approx(arrays.drift, rel=0.2)


@given(st.integers(0, 7), st.integers(0, 20), st.floats(-12.0, -4.0), st.integers(0, 5))
@settings(max_examples=examples(8, 100))
def test_a_claim_that_arrays_raise_is_not_kept(motion, piece, degree, size, column):
    """An error is planted in one coefficient: wherever the arrays see it, compiled code leaves it to them."""
    coefficients = motion.dense.coefficients.copy()
    coefficients[piece % len(coefficients), degree, column] += 10.0**size
    dense = replace(motion.dense, coefficients=coefficients)
    arrays = check_residual(BODY, formula("-g1", BODY), dense, dense.error, motion.energy, is_planar=True)
    found = kept(motion, dense=dense)
    if found is None:
        return
    # Next to the limit one of them may still explain by roundings what the other does not.
    assert arrays.error <= 2.0 * dense.error
    assert found.defect == pytest.approx(arrays.defect, rel=0.2)


@pytest.mark.parametrize("size", [1e-4, 1e-7, 1e-10])
def test_a_planted_error_is_never_kept(motion, size):
    coefficients = motion.dense.coefficients.copy()
    coefficients[3, 20, 3] += size
    assert kept(motion, dense=replace(motion.dense, coefficients=coefficients)) is None
    assert kept(motion, dense=replace(motion.dense, coefficients=coefficients), claim=10.0 * size) is not None


def test_next_to_a_pole_where_forces_have_no_bound_all_but_a_trillionth_of_the_time_is_settled():
    """V = −|g1|^(1/3) at A/C = 6/5: arrays took half of the time of such a motion to say the same."""
    moments, text = body("6/5", 1), "-abs(g1)^(1/3)"
    # Its function of time, which samples do not come from.
    passing = find_motion(planar(moments, text, PlanarMotion(1)))
    potential = formula(text, moments)
    assert "pole" in passing.window.ends
    found = kept_claim(moments, potential, passing.dense, passing.dense.error, passing.energy)
    assert found.settled == 1.0 - 1e-12
    arrays = check_residual(
        moments, potential, passing.dense, passing.dense.error, passing.energy, is_planar=True
    )
    assert arrays.error == passing.dense.error
    # What the claim next to the pole does not hide elsewhere is left to the arrays.
    assert kept_claim(moments, potential, passing.dense, 1e-3 * found.defect, passing.energy) is None


@pytest.mark.parametrize("steepness", ["10^2", "10^6", "10^16"])
def test_a_wall_between_the_nodes_is_left_to_the_arrays(motion, steepness):
    assert kept(motion, f"-g1 + (2*g1^2+g3^2)*2*exp(-{steepness}*(g2-3/10)^2)") is None


def test_what_is_not_finite_is_not_kept(motion):
    for spoilt in (np.nan, np.inf):
        coefficients = motion.dense.coefficients.copy()
        coefficients[0, 0, 0] = spoilt
        assert kept(motion, dense=replace(motion.dense, coefficients=coefficients)) is None
        assert kept(motion, claim=spoilt) is None
        samples = motion.dense(np.linspace(0.0, 1.0, 50))
        samples[49, 1] = spoilt
        assert not samples_keep_claim(BODY, formula("-g1", BODY), samples, 1e-9, motion.energy)


@given(st.integers(0, 99), st.integers(0, 5), st.floats(-15.0, -3.0))
def test_samples_keep_a_claim_only_where_arrays_keep_it(motion, place, column, size):
    samples = motion.dense(np.linspace(0.0, 7.0, 100))
    samples[place, column] += 10.0**size
    potential, claim = formula("-g1", BODY), 1e-11
    arrays = check_samples(BODY, potential, samples, claim, motion.energy)
    if samples_keep_claim(BODY, potential, samples, claim, motion.energy):
        assert arrays == claim


@given(st.lists(st.floats(0.2, 2.0), min_size=3, max_size=3), st.integers(0, 2**32 - 1))
@settings(max_examples=examples(6, 50))
def test_the_defect_of_any_polynomials_bounds_what_is_integrated(lengths, seed):
    """Not of a motion: D is as large as the polynomials themselves, and pieces are cut.

    On stretches of their own kernel and arrays bound the same D, each by sizes at ends and sums of sizes of
    Chebyshev coefficients: none is below D, and neither is far above it. The sum of n coefficients is at most
    √(2n) times the maximum of the series (Parseval), and here n = 33.
    """
    text = "exp(g1*g2)/3 - sin(2*g2 + g3) + cos(g1)"
    equations, compiled = parts(text)
    decay = 0.3 ** np.arange(21.0)[None, :, None]
    coefficients = np.random.default_rng(seed).uniform(-1.0, 1.0, (3, 21, 6)) * decay
    dense = DenseOutput((), np.cumsum([0.0, *lengths]), coefficients, None, 1.0)
    # Everything explains integrals within such a claim.
    _, defect, _ = hold(
        compiled, dense.breaks, in_lanes(coefficients), 21, 1e-6, np.inf, True, 1e3, np.zeros(3), 1e3, 0.0
    )
    blocks = list(Blocks(dense, equations.at, equations.bound).cut(1e-6))
    found = accumulate(dense, blocks, has_bounds=True)
    assume(np.isfinite(defect))
    assert found.settled_share == 1.0
    seen = integrated_defect(dense, equations)
    assert seen <= float(found.sizes.max()) + 1e-12
    # What interpolation leaves out is below the goal; D on a stretch departs from its value at the beginning.
    assert seen - 1e-12 <= defect <= (1.0 + 2.0 * np.sqrt(66.0)) * seen + 2e-6


def integrated_defect(dense, equations):
    """Return the largest |y(t) − y(0) − ∫F dt| at 201 points of each piece, F integrated by 120 nodes."""
    x, gained, largest = np.linspace(-1.0, 1.0, 201), np.zeros(6), 0.0
    nodes = np.cos(np.pi * (np.arange(120) + 0.5) / 120)
    first = np.polynomial.chebyshev.chebval(-1.0, dense.coefficients[0])
    for series, length in zip(dense.coefficients, np.diff(dense.breaks), strict=True):
        rates = equations.at(np.polynomial.chebyshev.chebval(nodes, series).T)[0]
        F = np.polynomial.chebyshev.chebint(
            np.polynomial.chebyshev.chebfit(nodes, rates, 119), lbnd=-1.0, scl=0.5 * length
        )
        D = np.polynomial.chebyshev.chebval(x, series).T - first - gained
        D -= np.polynomial.chebyshev.chebval(x, F).T
        largest = max(largest, float(np.abs(D).max()))
        gained = gained + np.polynomial.chebyshev.chebval(1.0, F)
    return largest


@pytest.mark.parametrize("width", ["1/2000", "1/8000"])
def test_a_corner_in_the_long_pieces_of_a_draft_is_settled_without_arrays(width, monkeypatch):
    """Arrays take ten times as long: a draft would be slower than the tier standard with shorter pieces."""
    text = f"-g1 + (2*g1^2 + g3^2)*sqrt((g2 + 63/200)^2 + ({width})^2)/10^8"
    asked = planar(BODY, formula(text, BODY), PlanarMotion(Fraction(1)), tolerance=1e-6)
    problem = replace(asked, method="auto", accuracy=Accuracy(1e-6, "draft"))

    def arrays(*_, **__):
        raise AssertionError("arrays are asked")

    monkeypatch.setattr(evidence, "check_residual", arrays)
    motion = solve_planar(problem)
    assert len(motion.dense.breaks) < 12
    assert motion.evidence["defect_covers"] == 1.0
    # The same function in shorter pieces shows the same integrals: their nodes are others, its roundings too.
    monkeypatch.undo()
    whole = check_residual(
        BODY, problem.potential, motion.dense, motion.dense.error, motion.energy, is_planar=True
    )
    # It looks at fewer points, as few as the claim allows: its bound is wider, and still within the claim.
    assert 0.5 * whole.defect <= motion.evidence["defect"] <= motion.dense.error


@pytest.mark.parametrize(
    ("text", "most"),
    [
        # Tails that four pieces leave: what is allowed of them would be 4e-8.
        ("-g1", 1e-9),
        ("-g1 + 1/20/g3^2", 2e-9),
        ("-g1 + (2*g1^2 + g3^2)*exp(g2)/20", 1e-7),
        # Narrow for its pieces, and too faint for their tails: its integrated defect is twice the claim.
        ("-g1 + 1/20/g3^2 - (2*g1^2 + g3^2)/(1 + ((g2 - 23/50)*155)^2)*118/10^8", 1e-6),
        # So narrow and faint that four pieces would leave more than the tier promises: it has finer ones.
        ("-g1 + 1/100/g3^2 + (g1^2 - g2^2)/3 + (2*g1^2 + g3^2)*exp(-((g2 + 74/125)*72)^2)*234/10^8", 1e-6),
    ],
)
def test_a_draft_claims_of_its_function_of_time_what_it_errs(text, most):
    asked = replace(planar(BODY, text, PlanarMotion(Fraction(7, 5))), method="auto")
    draft = solve_planar(replace(asked, accuracy=Accuracy(1e-6, "draft"))).dense
    # Five orders better, its own claim included: a reference.
    reference = solve_planar(replace(asked, accuracy=Accuracy(1e-10, "standard"))).dense
    times = np.linspace(0.0, 0.999 * draft.period.hi, 4001)
    assert np.abs(draft(times) - reference(times)).max() <= draft.error + reference.error
    assert draft.error <= most
