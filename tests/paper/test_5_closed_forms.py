"""Section 5 of the paper: homogeneous potentials; v = 1 + g3²/g1², α = A/C symbolic wherever it can be."""

import pytest
import sympy
from flint import acb, arb, ctx

from service.dynamics.potentials.families.coefficients import (
    B_coefficients,
    U_term,
)
from tests.paper.forms import (
    ALPHA,
    G1,
    G2,
    G3,
    RHO,
    L,
    Number,
    gradient,
    is_zero,
    series_2f1,
)

n, nu, v, z = sympy.symbols("n nu v z")
ONE = sympy.Integer(1)
V_OF_GAMMA = 1 + G3**2 / G1**2
# The parameters of (g1).
a, b, c = -nu / 2, 1 - ALPHA * nu / (2 * (ALPHA - 1)), 2 - nu / 2
FIRST = (nu - 2 + nu / (2 * (ALPHA - 1))) * v - nu / 2 + 2
PRINTED_LAST = ALPHA * nu / (ALPHA - 1) - 2
CORRECT_LAST = -nu / 4 * PRINTED_LAST


def eg(g: sympy.Expr, last: sympy.Expr, degree: Number = nu) -> sympy.Expr:
    """Return the left side of (eg) with this coefficient of g."""
    whole = v * (1 - v) * g.diff(v, 2) + FIRST * g.diff(v) + last * g
    return whole.subs(nu, degree)


def test_e1_equation_without_g2():
    """(e1): for V(g1, g3) the service's L(V) is g2 times the printed left side."""
    V = sympy.Function("V")(G1, G3)
    V1, _, V3 = gradient(V)
    A, C = sympy.symbols("A C", positive=True)
    printed = (
        G1 * G3 * (A * V1.diff(G1) - C * V3.diff(G3))
        - (A * G1**2 - C * G3**2) * V1.diff(G3)
        - (A - 2 * C) * G3 * V1
        - (2 * A - C) * G1 * V3
    )
    assert sympy.expand(L(V, A, C) - G2 * printed) == 0


@pytest.mark.parametrize("g", [ONE, v, v**2], ids=str)
def test_v_and_eg_corrected(g):
    """(v), (eg): L(g1^ν g(v)) = -4(α-1) g1^{ν-1} g2 g3 C E[g], E's last term -(ν/4)(αν/(α-1)-2) g.

    1, v, v² determine the three coefficients of a second-order operator.
    """
    residual = L(g.subs(v, V_OF_GAMMA), ALPHA, ONE, nu)
    factor = -4 * (ALPHA - 1) * G2 * G3 / G1
    assert is_zero(residual - factor * eg(g, CORRECT_LAST).subs(v, V_OF_GAMMA))


def test_eg_printed():
    """(eg): its last coefficient αν/(α-1)-2 lacks a factor -ν/4. The service's U_2 has α = 2, ν = 3."""
    terms = [(sympy.Rational(k.numerator, k.denominator), j // 2) for (_, _, j), k in U_term(2).items()]
    g = sum(k * (v - 1) ** j for k, j in terms)
    assert is_zero(eg(g, CORRECT_LAST, 3).subs(ALPHA, 2))
    assert is_zero(eg(g, PRINTED_LAST, 3).subs(ALPHA, 2) - 7 * g)


def test_g1_parameters():
    """(g1): a, b, c as printed make (eg), corrected, the equation of 2F1(a, b; c; v)."""
    assert is_zero(FIRST - c + (a + b + 1) * v)
    assert is_zero(CORRECT_LAST + a * b)
    assert not is_zero(PRINTED_LAST + a * b)


def test_g1_is_complex():
    """(g1), (t1): v > 1 is the cut of 2F1: unless the series ends the value there is complex.

    2F1(a, b; a+b+1-c; 1-v) is a real solution. α = 17/10, ν = 3/5, v = 3/2, in balls.
    """
    with ctx.workprec(160):
        at, values = acb("1.5"), [acb(_decimal(parameter)) for parameter in (a, b, c)]
        g = at.hypgeom_2f1(*values)
        assert not g.imag.contains(arb(0))
        assert _residual(values, at, acb(1), at).contains(acb(0))
        a1, b1, c1 = values
        real = [a1, b1, a1 + b1 + 1 - c1]
        assert (1 - at).hypgeom_2f1(*real).imag == 0
        assert _residual(real, 1 - at, acb(-1), at).contains(acb(0))


def test_g2_second_solution():
    """(g2): v^{ν/2-1} F(-1, -ν/(2(α-1)); ν/2; v) = v^{ν/2-1} (α-1+v)/(α-1) solves (eg), corrected."""
    short = (ALPHA - 1 + v) / (ALPHA - 1)
    assert is_zero(series_2f1(1, -1, -nu / (2 * (ALPHA - 1)), nu / 2, v) - short)
    # With v^k in front, k = ν/2 - 1, d/dv is d/dv + k/v.
    k = nu / 2 - 1
    slope = short.diff(v) + k * short / v
    curvature = slope.diff(v) + k * slope / v
    whole = v * (1 - v) * curvature + FIRST * slope
    assert is_zero(whole + CORRECT_LAST * short)
    assert not is_zero(whole + PRINTED_LAST * short)


def test_contribution_of_g2():
    """Display after (g2): g1^ν g_ν2 (α-1) = (g1² + g3²)^{ν/2-1} (α g1² + g3²), of the form (V2)."""
    assert is_zero(V_OF_GAMMA * G1**2 - RHO)
    assert is_zero(G1**2 * (ALPHA - 1 + V_OF_GAMMA) - ALPHA * G1**2 - G3**2)
    power = sympy.Function("power")(RHO)
    assert is_zero(L(power * (ALPHA * G1**2 + G3**2), ALPHA, ONE).doit())


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_t1_is_the_term_of_the_service(order):
    """(t1): g1^ν 2F1(-ν/2, 1-αν/(2(α-1)); 2-ν/2; v) at ν = 2(α-1)(n+1)/α is the service's B_n, α symbolic."""
    degree = 2 * (ALPHA - 1) * (order + 1) / ALPHA
    printed = series_2f1(order, *(parameter.subs(nu, degree) for parameter in (b, a, c)), 1 + z)
    service = sum(factor * z**k for k, factor in enumerate(B_coefficients(ALPHA, order)))
    assert is_zero(printed - service)


def test_transformation():
    """F(a,b;c;v) = (1-v)^{c-a-b} F(c-a,c-b,c): the argument v is missing (Euler). In balls at v = 1/3."""
    with ctx.workprec(160):
        values = [acb(_decimal(parameter)) for parameter in (a, b, c)]
        a1, b1, c1 = values
        at = acb(1) / 3
        right = (1 - at) ** (c1 - a1 - b1) * at.hypgeom_2f1(c1 - a1, c1 - b1, c1)
        assert (at.hypgeom_2f1(a1, b1, c1) - right).contains(acb(0))
        assert (at.hypgeom_2f1(a1, b1, c1) - right).abs_upper() < arb(2) ** -120


def test_transformation_applied():
    """The same for (t1): exponent 1+αν/(2(α-1)), parameters 2, 1+ν/(2(α-1)). There v > 1: (v-1) for (1-v)."""
    assert is_zero(c - a - b - 1 - ALPHA * nu / (2 * (ALPHA - 1)))
    assert is_zero(c - a - 2)
    assert is_zero(c - b - 1 - nu / (2 * (ALPHA - 1)))
    assert is_zero(V_OF_GAMMA - 1 - G3**2 / G1**2)
    half = sympy.Rational(-1, 4) ** (1 + ALPHA * nu / (2 * (ALPHA - 1))).subs({ALPHA: 3, nu: 1})
    assert not half.is_real


def _decimal(parameter: sympy.Expr) -> arb:
    value = parameter.subs({ALPHA: sympy.Rational(17, 10), nu: sympy.Rational(3, 5)})
    return arb(int(value.p)) / arb(int(value.q))


def _residual(parameters: list[acb], argument: acb, slope: acb, at: acb) -> acb:
    """Return (eg), corrected, for 2F1 of ``argument``, whose derivative by v is ``slope``, at v = ``at``."""
    a1, b1, c1 = parameters
    g = argument.hypgeom_2f1(a1, b1, c1)
    first = a1 * b1 / c1 * argument.hypgeom_2f1(a1 + 1, b1 + 1, c1 + 1) * slope
    curve = a1 * b1 * (a1 + 1) * (b1 + 1) / (c1 * (c1 + 1))
    second = curve * argument.hypgeom_2f1(a1 + 2, b1 + 2, c1 + 2) * slope * slope
    coefficients = [_decimal(FIRST.coeff(v, k)) for k in (0, 1)]
    middle = coefficients[0] + coefficients[1] * at
    return at * (1 - at) * second + middle * first + _decimal(CORRECT_LAST) * g
