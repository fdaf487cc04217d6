"""Section 5 of the paper, its series that end: the cases 1), 2), 3) and the final potential."""

from fractions import Fraction

import pytest
import sympy

from service.dynamics.potentials.families.coefficients import (
    B_coefficients,
    UndefinedTermError,
    homogeneous_potential,
)
from tests.paper.forms import (
    ALPHA,
    G1,
    G2,
    G3,
    L,
    Number,
    is_zero,
    series_2f1,
    symbolic,
)
from tests.support.planar import body

n, nu = sympy.symbols("n nu")
ONE = sympy.Integer(1)
V_OF_GAMMA = 1 + G3**2 / G1**2
# The parameters of (g1).
a, b, c = -nu / 2, 1 - ALPHA * nu / (2 * (ALPHA - 1)), 2 - nu / 2

# Bodies with A/C above and below 1, and coefficients of terms that exist there.
BODIES = [
    ((3, 1), [2, -1, 0, 3], [1, 4, -2]),
    ((5, 2), [1, 1, -3], [2, 0, 5]),
    ((3, 5), [2, 7, -1], [3, -2, 0]),
]


def t2(n: int, alpha: Number) -> tuple[sympy.Expr, Number]:
    """Return (t2) as printed, as a function and the power of g3 in front of it."""
    series = series_2f1(n, 2, -n, alpha + 1 + (alpha - 1) * n, V_OF_GAMMA)
    return G1 ** (2 * n) * series, -2 * (alpha * n + alpha - 1)


def t3(n: int, alpha: Number) -> tuple[sympy.Expr, Number]:
    """Return (t3) as printed, as a function and the power of g1 in front of it."""
    series = series_2f1(n, -n, -(alpha - 1) / alpha * (n + 1), 1 - n + (n + 1) / alpha, V_OF_GAMMA)
    return G1 ** (2 * n) * series, 2 * (alpha - 1 - n) / alpha


def integer_powers(expression: sympy.Expr, root: int) -> sympy.Expr:
    """Return the expression with g1, g3 as powers of new variables: then it is rational."""
    x, y = sympy.symbols("x y", positive=True)
    return expression.subs({G1: x**root, G3: y**root}, simultaneous=True)


def test_case_1():
    """Case 1): a = -k, ν = 2k: only ν = 2 has c not among 0, …, 1-k; there g1² F = (α g1² + g3²)/(α-1)."""
    series = series_2f1(1, *(parameter.subs(nu, 2) for parameter in (a, b, c)), V_OF_GAMMA)
    assert is_zero(G1**2 * series - (ALPHA * G1**2 + G3**2) / (ALPHA - 1))
    for k in range(2, 9):
        assert 1 - k <= c.subs(nu, 2 * k) <= 0


def test_case_2_is_t3():
    """Case 2): b = -n gives ν = 2(α-1)(n+1)/α and c = 1-n+(n+1)/α: that is (t3), not (t2) as printed."""
    (degree,) = sympy.solve(b + n, nu)
    assert is_zero(degree - 2 * (ALPHA - 1) * (n + 1) / ALPHA)
    assert is_zero(c.subs(nu, degree) - (1 - n + (n + 1) / ALPHA))
    assert is_zero(a.subs(nu, degree) + (ALPHA - 1) / ALPHA * (n + 1))
    assert is_zero(degree - 2 * (ALPHA - 1 - n) / ALPHA - 2 * n)
    # "The third index becomes α+1+(α-1)n", says the paper here.
    assert not is_zero(c.subs(nu, degree) - (ALPHA + 1 + (ALPHA - 1) * n))
    double = sympy.Integer(2)
    assert (t2(0, double)[1], t3(0, double)[1]) == (-2, 1)


def test_case_3_is_t2():
    """Case 3): c-b = -n gives ν = -2(α-1)(n+1) and c = α+1+(α-1)n: that is (t2), not (t3) as printed."""
    (degree,) = sympy.solve(c - b + n, nu)
    assert is_zero(degree + 2 * (ALPHA - 1) * (n + 1))
    assert is_zero(c.subs(nu, degree) - (ALPHA + 1 + (ALPHA - 1) * n))
    # g1^ν (v-1)^{c-a-b} F(2, -n; c; v): powers of g3 and g1.
    exponent = (c - a - b).subs(nu, degree)
    assert is_zero(2 * exponent + 2 * (ALPHA * n + ALPHA - 1))
    assert is_zero(degree - 2 * exponent - 2 * n)


def test_t2_solves_the_equation():
    """(t2): L = 0 for symbolic α, n = 0..3; numerator a homogeneous polynomial of degree 2n."""
    for order in range(4):
        function, power = t2(order, ALPHA)
        assert is_zero(L(function, ALPHA, ONE, power_3=power))
        assert sympy.Poly(sympy.expand(function), G1, G3).is_homogeneous
        assert sympy.Poly(sympy.expand(function), G1, G3).total_degree() == 2 * order


def test_t2_power():
    """(t2): "the power 2(αn+α-1) is always positive", "undefined at g3 = 0": not for α < 1/(n+1).

    α = 1/2, n = 0: the term is g3. α = 1/3, n = 2: c = 0, no term; α = 1/2, n = 1: a multiple of α g1² + g3².
    """
    half, third = sympy.Rational(1, 2), sympy.Rational(1, 3)
    function, power = t2(0, half)
    assert (function, power) == (1, 1)
    assert is_zero(symbolic(homogeneous_potential(body(1, 2), C=[Fraction(1)])) - G3)
    assert (third + 1 + (third - 1) * 2) == 0
    with pytest.raises(UndefinedTermError):
        homogeneous_potential(body(1, 3), C=[Fraction(0), Fraction(0), Fraction(1)])
    function, power = t2(1, half)
    assert power == 0
    assert sympy.cancel(function / (half * G1**2 + G3**2)).is_number


def test_t3_solves_the_equation():
    """(t3): L = 0 for symbolic α, n = 0..3; a polynomial of degree 2n after its first factor."""
    for order in range(4):
        function, power = t3(order, ALPHA)
        assert is_zero(L(function, ALPHA, ONE, power_1=power))
        assert sympy.Poly(sympy.expand(function), G1, G3).total_degree() == 2 * order


@pytest.mark.one_in(3)
@pytest.mark.parametrize("order", range(1, 7))
def test_exclusions(order):
    """Case 3): "α not one of (n+1)/(n-1-k), k = 0..n" belongs to (t3), for k = 0..n-2 only.

    k = n-1 divides by zero, k = n gives α < 0; α = (n+1)/n gives a V2. The poles in α are those of the
    service's coefficients of B_n.
    """
    denominator = sympy.lcm_list([sympy.denom(sympy.cancel(k)) for k in B_coefficients(ALPHA, order)])
    poles = {root for root in sympy.roots(denominator, ALPHA) if root > 0}
    assert poles == {sympy.Rational(order + 1, order - 1 - k) for k in range(order - 1)}
    trivial = Fraction(order + 1, order)
    coefficients = [Fraction(0)] * order + [Fraction(1)]
    potential = homogeneous_potential(body(trivial, 1), B=coefficients)
    assert [notice.code for notice in potential.notices] == ["trivial_term"]
    ratio = integer_powers(symbolic(potential) / (trivial.numerator * G1**2 + trivial.denominator * G3**2), 1)
    assert sympy.cancel(ratio).is_number
    for m in range(1, order):
        with pytest.raises(UndefinedTermError):
            homogeneous_potential(body(Fraction(order + 1, m), 1), B=coefficients)


def test_exclusion_of_zero():
    """Cases 1), 2): "c is not a negative integer greater than -n": nor may it be 0, as for n = 2, α = 3."""
    assert (1 - n + (n + 1) / ALPHA).subs({n: 2, ALPHA: 3}) == 0
    with pytest.raises(ZeroDivisionError):
        B_coefficients(Fraction(3), 2)


@pytest.mark.parametrize(("moments", "B", "C"), BODIES, ids=["α = 3", "α = 5/2", "α = 3/5"])
def test_final_potential(moments, B, C):
    """Final V: the printed sums with these coefficients are the service's potential, and L(V) = 0."""
    alpha = sympy.Rational(*moments)
    A = [1, -2, 3]
    exact = [[Fraction(k) for k in row] for row in (A, B, C)]
    V = symbolic(homogeneous_potential(body(*moments), A=exact[0], B=exact[1], C=exact[2]))
    printed = (moments[0] * G1**2 + moments[1] * G3**2) * sum(k * G2**i for i, k in enumerate(A))
    for order, k in enumerate(B):
        if k:
            series = series_2f1(
                order,
                -order,
                -(alpha - 1) / alpha * (order + 1),
                1 - order + (order + 1) / alpha,
                V_OF_GAMMA,
            )
            power = 2 * (alpha - 1) / alpha + 2 * order * (1 - 1 / alpha)
            printed += k * G1**power * series
    for order, k in enumerate(C):
        if k:
            function, _ = t2(order, alpha)
            printed += k * function / (G3 ** (2 * (alpha - 1)) * G3 ** (2 * alpha * order))
    # All exponents are multiples of 1/15: with g = x^15 both are rational.
    assert is_zero(integer_powers(V - printed, 15))
    assert is_zero(integer_powers(L(V, *(sympy.Integer(moment) for moment in moments)), 15))
