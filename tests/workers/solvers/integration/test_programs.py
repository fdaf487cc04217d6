from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.potentials.families.coefficients import rational_potential
from service.dynamics.potentials.families.written import expression_potential
from tests.workers.solvers.integration.cases import BODY
from workers.solvers.compiled.evaluation.program import numbers_of
from workers.solvers.integration.programs import Line, gradient_function, shared_gradient

TEXTS = [
    "3",
    "g2",
    "-g1 + 1/(20*g3^2)",
    "g2^3*g1 - g3^(-5) + g1^40/(1 + g2^2)",
    "sqrt(g1) + g3^(2/3)/g1^(1/2)",
    "exp(g2)*log(g1) + sin(g2)*cos(g3) - tan(g2)",
    "(1 + g1^2)^(g2/2) + pi*g3^g1",
    "abs(g2) + abs(g1 - g3)^(4/3)",
]
POINTS = [(0.6, 0.0, 0.8), (0.3, -0.5, 0.7), (0.9, 0.1, 1e-3)]


@pytest.mark.parametrize("text", TEXTS)
@pytest.mark.parametrize("point", POINTS)
def test_function_is_the_gradient(text, point):
    potential = expression_potential(text, {}, BODY)
    expected = potential.gradient(np.array(point))
    # Powers are products here and pow there: some ulp of the largest term.
    assert np.array(gradient_function(potential.tape, float)(*point)) == pytest.approx(
        expected, rel=1e-14, abs=1e-14
    )


def test_line_of_a_long_formula_is_short():
    """Shared parts are computed once: fewer than four operations per term and direction."""
    potential = rational_potential(
        [Fraction(-2), Fraction(1, 20), Fraction(1, 200)],
        [Fraction(1, 50), Fraction(1, 500), Fraction(1, 4000)],
        [Fraction(1, 5), Fraction(1, 10)],
    )
    assert len(Line(potential.tape).steps) <= 5 * len(potential.tape.instructions)
    point = (0.37, 0.69, 0.61)
    assert np.array(gradient_function(potential.tape, float)(*point)) == pytest.approx(
        potential.gradient(np.array(point)), rel=1e-13
    )


@pytest.mark.parametrize(
    ("text", "point"),
    [
        ("1/g2", (0.6, 0.0, 0.8)),
        ("sqrt(g1)", (-0.6, 0.0, 0.8)),
        ("log(g1)", (0.0, 0.6, 0.8)),
        ("g1^(-200)", (1e-3, 0.6, 0.8)),
        ("exp(exp(exp(7*g3)))", (0.0, 0.6, 0.8)),
    ],
)
def test_undefined_gradients_are_nan(text, point):
    assert np.isnan(gradient_function(expression_potential(text, {}, BODY).tape, float)(*point)).all()


@pytest.mark.parametrize(
    ("text", "other", "is_shared"),
    [
        ("3*g1^5 - g3^(7/2)/7", "11*g1^5 - g3^(3/2)/5", True),
        ("3*g1^5 - g3^(7/2)/7", "3*g1^4 - g3^(7/2)/7", False),
        ("3*g1^5 - g3^(7/2)/7", "3*g1^5 - g3^3/7", False),
        ("pi*g1 - 2^g2*g3^2", "pi*g1 - 5^g2*g3^2", True),
        ("2*g1 - 3*g3", "-5*g1 - 7*g3", True),
    ],
)
def test_potentials_of_one_structure_share_their_operations(text, other, is_shared):
    """The constants of another potential are those it has by itself, bit for bit: so are its motions."""
    tapes = [expression_potential(each, {}, BODY).tape for each in (text, other)]
    shared, own = (shared_gradient(tape, float) for tape in tapes)
    found = shared.constants(numbers_of(tapes[1]), float)
    assert (found is not None) == is_shared
    if found is not None:
        assert found == own.gradient.constants.tolist()
        for one, two in zip(shared.gradient, own.gradient, strict=True):
            assert one is shared.gradient.constants or np.array_equal(one, two)
