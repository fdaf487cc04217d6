"""The homogeneous family against the printed series, its H, and the moments where a term has no value."""

from fractions import Fraction
from math import comb

import pytest
import sympy
from flint import arb, ctx

from service.dynamics.equations.compatibility import pde_residual
from service.dynamics.errors import EqualMomentsError, FormulaLimitError
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.potentials.families.coefficients import (
    B_term,
    C_term,
    UndefinedTermError,
    energy_of_B,
    energy_of_C,
    homogeneous_potential,
    rational_potential,
    refusals,
)
from service.dynamics.potentials.terms import MAX_TERMS, NoLogTermError, TooManyTermsError
from tests.support.planar import body

ALPHA, Z = sympy.symbols("alpha z", positive=True)
GAMMA = sympy.symbols("g1 g2 g3", positive=True)
RATIOS = [Fraction(text) for text in ("17/10", "2", "3", "4", "7/3", "3/5", "1/2", "1/3", "3/2", "11/10")]
TERMS = {"B": B_term, "C": C_term}


def unit(n: int, value: Fraction | int = 1) -> list[Fraction]:
    return [Fraction(0)] * n + [Fraction(value)]


def of_ratio(alpha: Fraction):
    return body(alpha.numerator, alpha.denominator)


def symbolic(term) -> sympy.Expr:
    g1, _, g3 = GAMMA
    return sum(factor * g1**first * g3**third for (first, third), factor in term.items())


def series(a: sympy.Expr, b: sympy.Expr, c: sympy.Expr, length: int) -> sympy.Expr:
    """Gauss's series from the definition with Pochhammer symbols, v = 1 + z."""
    return sum(
        sympy.rf(a, j) * sympy.rf(b, j) / sympy.rf(c, j) / sympy.factorial(j) * (1 + Z) ** j
        for j in range(length)
    )


@pytest.mark.one_in(2)
@pytest.mark.parametrize("n", range(5))
def test_terms_are_the_printed_series_for_every_alpha(n: int) -> None:
    g1, _, g3 = GAMMA
    B = g1 ** (2 * (ALPHA - 1) * (n + 1) / ALPHA) * series(
        sympy.Integer(-n), -(ALPHA - 1) * (n + 1) / ALPHA, 1 - n + (n + 1) / ALPHA, n + 1
    )
    C = (
        g1 ** (2 * n)
        * g3 ** (-2 * (ALPHA * n + ALPHA - 1))
        * series(sympy.Integer(2), sympy.Integer(-n), ALPHA + 1 + (ALPHA - 1) * n, n + 1)
    )
    for term, printed in ((B_term(ALPHA, n), B), (C_term(ALPHA, n), C)):
        # Both are homogeneous of one degree in g1 and g3: g1 = 1 keeps what they say.
        difference = (symbolic(term) - printed.subs(Z, (g3 / g1) ** 2)).subs(g1, 1)
        assert sympy.cancel(sympy.powsimp(sympy.expand(difference * g3 ** (2 * ALPHA * (n + 1))))) == 0


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", ["B", "C"])
@pytest.mark.parametrize("n", range(4))
def test_terms_satisfy_the_compatibility_equation_for_every_alpha(name: str, n: int) -> None:
    V = symbolic(TERMS[name](ALPHA, n))
    first = [V.diff(g) for g in GAMMA]
    L = pde_residual(
        ALPHA, sympy.Integer(1), GAMMA, first, [[slope.diff(g) for g in GAMMA] for slope in first]
    )
    residual = L.subs(GAMMA[0], 1) * GAMMA[2] ** (2 * ALPHA * (n + 1))
    assert sympy.cancel(sympy.powsimp(sympy.expand(residual))) == 0


@pytest.mark.parametrize("alpha", RATIOS, ids=str)
@pytest.mark.parametrize("n", [0, 1, 2, 3, 7, 19])
def test_H_is_the_printed_power_of_lambda(alpha: Fraction, n: int) -> None:
    with ctx.workprec(300):
        g1, g2, g3 = arb(2) / 7, arb(6) / 7, arb(3) / 7
        ratio = BallAlgebra().constant(alpha)
        # λ = |g3| / |g1|^(1/α); H is scale-free, so C need not be 1.
        square = g3**2 / g1 ** (2 / ratio)
        powers = {"B": square ** (n + 1), "C": square ** (-ratio * (n + 1))}
        for name, energy in (("B", energy_of_B), ("C", energy_of_C)):
            try:
                potential = homogeneous_potential(of_ratio(alpha), **{name: unit(n)})
            except UndefinedTermError:
                continue
            H = potential.H_ball(of_ratio(alpha), g1, g2, g3)
            expected = BallAlgebra().constant(energy(alpha, n)) * powers[name]
            assert H.overlaps(expected)
            # Cancellation in the sums costs up to some 10 bits per index at this point.
            assert (H - expected).abs_upper() < arb(2) ** (-80) * (1 + abs(expected))


@pytest.mark.parametrize(
    ("alpha", "coefficients", "text"),
    [
        ("2", {"B": unit(0)}, "abs(g1)"),
        ("4", {"B": unit(1)}, "4*abs(g1)^3 + 3*abs(g1)*g3^2"),
        ("1/2", {"C": unit(0, -3)}, "-3*abs(g3)"),
        ("3/5", {"C": unit(0)}, "abs(g3)^0.8"),
        ("3", {"B": unit(0, -1)}, "-abs(g1)^(4/3)"),
        ("17/10", {"C": unit(0, Fraction(1, 50))}, "0.02/abs(g3)^1.4"),
        ("2", {"A": unit(0, -1)}, "-(2*g1^2 + g3^2)"),
        ("2", {"A": [Fraction(1), Fraction(0), Fraction(-2)]}, "(2*g1^2 + g3^2)*(1 - 2*g2^2)"),
        ("2", {"A": [Fraction(0)], "B": [], "C": [Fraction(0)] * 3}, "0"),
    ],
)
def test_what_it_looks_like(alpha: str, coefficients: dict, text: str) -> None:
    assert homogeneous_potential(of_ratio(Fraction(alpha)), **coefficients).formula() == text


def test_degree_five_is_the_polynomial_of_alpha_six() -> None:
    g1, _, g3 = GAMMA
    ratio = sympy.cancel(
        symbolic(B_term(Fraction(6), 2)) / (g1 * (24 * g1**4 + 40 * g1**2 * g3**2 + 15 * g3**4))
    )
    assert ratio.is_number


def test_for_a_double_moment_the_terms_are_the_rational_ones() -> None:
    double = body(2, 1)
    for k in range(1, 5):
        a, b = rational_potential(unit(k - 1), [], []), rational_potential([], unit(k - 1), [])
        ours = homogeneous_potential(double, B=unit(2 * k - 2)), homogeneous_potential(double, C=unit(k - 1))
        # The rational family has the paper's sign of a_3, and Catalan numbers before its b-terms.
        scales = -1 if k == 3 else 1, Fraction(k + 1, comb(2 * k, k))
        with ctx.workprec(200):
            point = arb(2) / 7, arb(6) / 7, arb(3) / 7
            for mine, theirs, scale in zip(ours, (a, b), scales, strict=True):
                scaled = BallAlgebra().constant(Fraction(scale)) * theirs.value_ball(*point)
                assert (mine.value_ball(*point) - scaled).contains(0)
                # At most a thousand in size, and 200 bits.
                assert (mine.value_ball(*point) - scaled).abs_upper() < arb(2) ** -160


@pytest.mark.parametrize(
    ("alpha", "n", "undefined"),
    [
        ("3", 2, "B"),
        ("4", 3, "B"),
        ("2", 3, "B"),
        ("6", 5, "B"),
        ("3/2", 5, "B"),
        ("1/3", 2, "C"),
        ("2/3", 5, "C"),
    ],
)
def test_a_term_without_a_value_is_refused_and_the_logarithm_offered(
    alpha: str, n: int, undefined: str
) -> None:
    rigid_body = of_ratio(Fraction(alpha))
    with pytest.raises(UndefinedTermError, match=rf'"log" with index {n}') as caught:
        homogeneous_potential(rigid_body, **{undefined: unit(n)})
    assert caught.value.pointer == f"/potential/{undefined}/{n}"
    assert homogeneous_potential(rigid_body, log=unit(n), **{undefined: unit(n, 0)})


@pytest.mark.parametrize(
    ("alpha", "n", "name", "text"),
    [
        ("2", 1, "B", "2*g1^2 + g3^2"),
        ("3/2", 2, "B", "3*g1^2 + 2*g3^2"),
        ("4/3", 3, "B", "4*g1^2 + 3*g3^2"),
        ("6/5", 5, "B", "6*g1^2 + 5*g3^2"),
        ("1/2", 1, "C", "-2*g3^2 - g1^2"),
        ("2/3", 2, "C", "3*g3^2 + 2*g1^2"),
    ],
)
def test_a_multiple_of_Q_is_accepted_and_told(alpha: str, n: int, name: str, text: str) -> None:
    ratio = Fraction(alpha)
    potential = homogeneous_potential(of_ratio(ratio), **{name: unit(n)})
    assert potential.formula() == text
    assert (energy_of_B if name == "B" else energy_of_C)(ratio, n) == 0
    (notice,) = potential.notices
    assert (notice.code, notice.pointer) == ("trivial_term", f"/potential/{name}/{n}")


def test_the_moments_without_a_term_are_those_of_the_formula_and_no_others() -> None:
    for n in range(8):
        undefined = {Fraction(n + 1, m) for m in range(1, n)}
        # A grid that holds all of them and many more.
        for alpha in {Fraction(p, q) for p in range(1, 13) for q in range(1, 13)} - {Fraction(1)}:
            found = {error.pointer for error in refusals(of_ratio(alpha), A=[], B=unit(n), C=unit(n), log=[])}
            expected = {f"/potential/B/{n}"} if alpha in undefined and alpha > 1 else set()
            expected |= {f"/potential/C/{n}"} if 1 / alpha in undefined and alpha < 1 else set()
            assert found == expected
            if not found:
                assert B_term(alpha, n)
                assert C_term(alpha, n)


def test_every_refusal_is_told() -> None:
    errors = list(
        refusals(
            body(2, 1), A=unit(MAX_TERMS), B=[Fraction(1)] * 6, C=unit(3), log=[Fraction(1), Fraction(1)]
        )
    )
    assert [(type(error), error.pointer) for error in errors] == [
        (TooManyTermsError, "/potential/A"),
        (UndefinedTermError, "/potential/B/3"),
        (UndefinedTermError, "/potential/B/5"),
        (NoLogTermError, "/potential/log/0"),
    ]


def test_equal_moments_have_no_such_family() -> None:
    with pytest.raises(EqualMomentsError):
        homogeneous_potential(body(3, 3), A=unit(0))


def test_exponents_beyond_the_limits_are_refused_at_the_potential() -> None:
    with pytest.raises(FormulaLimitError) as caught:
        homogeneous_potential(body(1, 60), B=unit(15))
    assert caught.value.pointer == "/potential"
