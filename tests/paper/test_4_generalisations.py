"""Section 4 of the paper: bodies with A = 2C and rational potentials; ν = g3²/g1."""

from fractions import Fraction

import pytest
import sympy

from service.dynamics.potentials.families.coefficients import U_term, W_term, rational_potential
from tests.paper.forms import (
    G1,
    G2,
    G3,
    GAMMA,
    NU,
    RHO,
    A,
    C,
    H,
    L,
    Q,
    gradient,
    is_zero,
    printed_rates,
    service_rates,
    symbolic,
)
from tests.support.planar import body, formula

x, lambda_ = sympy.symbols("x lambda", positive=True)
COEFFICIENTS = a1, a2, a3, b1, b2, b3, c1, c2 = sympy.symbols("a1 a2 a3 b1 b2 b3 c1 c2", real=True)
LISTS = ("a", "a", "a", "b", "b", "b", "c", "c")
PLACES = (1, 2, 3, 1, 2, 3, 1, 2)

# The display after (F), and c1, c2 of (Vr), as printed.
PRINTED = {
    a1: G1,
    a2: 8 * G1 * RHO + G3**4 / G1,
    a3: 16 * G1 * (8 * G1**4 + 16 * G1**2 * G3**2 + 9 * G3**4) + 16 * G3**6 / G1 + G3**8 / G1**3,
    b1: 1 / G3**2,
    b2: (G1**2 - G3**2) / G3**6,
    b3: (2 * G1**4 - 2 * G1**2 * G3**2 + G3**4) / G3**10,
    c1: G1**2 - G2**2,
    c2: G2**2 * (2 * G1**2 + G3**2),
}
CORRECTED = PRINTED | {a3: PRINTED[a3] - 2 * G3**8 / G1**3}
ENERGY = {a1: -NU / 2, a2: NU**3 / 2, a3: -3 * NU**5 / 2, b1: -2 / NU**2, b2: -6 / NU**4, b3: -20 / NU**6}


def of_the_service(symbol: sympy.Symbol) -> sympy.Expr:
    """Return the service's potential with this one coefficient 1."""
    place = COEFFICIENTS.index(symbol)
    lists: dict[str, list[Fraction]] = {"a": [], "b": [], "c": []}
    lists[LISTS[place]] = [Fraction(0)] * (PLACES[place] - 1) + [Fraction(1)]
    return symbolic(rational_potential(**lists))


def on_curve(expression: sympy.Expr) -> sympy.Expr:
    """Return the expression in x = g1 and ν, where it is even in g2 and g3."""
    x_and_nu = {G3: sympy.sqrt(NU * x), G1: x}
    return expression.subs(G2, sympy.sqrt(1 - RHO)).subs(x_and_nu, simultaneous=True)


def g_of(symbol: sympy.Symbol) -> sympy.Expr:
    """Return g(x) = ν⁴ (C/2) (dx/dt)² from D of the service's potential: r² = 2 g1 D/(C g3), x' = r g2."""
    V1, _, V3 = gradient(of_the_service(symbol))
    r_squared = 2 * G1 * (G1 * V3 - G3 * V1) / (C * G3)
    return NU**4 * C / 2 * (1 - x**2 - NU * x) * on_curve(r_squared)


def printed_g(constant: sympy.Expr) -> sympy.Expr:
    """Return g(x) as printed, with this in the place of λ."""
    first = 2 * c2 * x**5 - 2 * (4 * a2 - c2 * constant) * x**4
    first += -2 * (2 * a2 * constant + c1 + c2) * x**3 - (a1 - a2 * constant**2) * x**2
    whole = constant**4 * first - 2 * (b1 * constant**2 + 3 * b2) * x + 2 * b2 * constant
    return (1 - x**2 - constant * x) / x * whole


@pytest.mark.parametrize("symbol", [a1, a2, a3, b1, b2, b3], ids=str)
def test_F_of_the_rational_potentials(symbol):
    """F(u) = √u (A1 + A2 u + a3 u²) + B1/u + B2/u² + B3/u³ at u = -C ν²: F = -H[V] makes A_n imaginary.

    B1, B2, B3 = -2C b1, 6C² b2, -20C³ b3 are real. The a3 in F is an A3, not the a3 of V1.
    """
    n = PLACES[COEFFICIENTS.index(symbol)]
    energy = on_curve(H(of_the_service(symbol), 2 * C)).expand()
    assert is_zero(energy - ENERGY[symbol])
    u = -C * NU**2
    if symbol in (b1, b2, b3):
        assert sympy.simplify(-energy * u**n - {b1: -2 * C, b2: 6 * C**2, b3: -20 * C**3}[symbol]) == 0
    else:
        assert sympy.simplify(-energy / (sympy.sqrt(u) * u ** (n - 1))).is_imaginary


@pytest.mark.one_in(3)
@pytest.mark.parametrize("n", range(1, 7))
def test_F_powers_lead_to_rational_potentials(n):
    """Text before F(u): u^{n-1/2} and u^{-n} have rational potentials: the service's U_n, W_n"""
    for laurent, expected in (
        (U_term(n), (n - sympy.Rational(3, 2)) * NU ** (2 * n - 1)),
        (W_term(n), -(n + 1) / NU ** (2 * n)),
    ):
        V = sum(
            sympy.Rational(k.numerator, k.denominator) * G1**i * G3**j for (i, _, j), k in laurent.items()
        )
        assert is_zero(L(V, 2 * C))
        assert is_zero(on_curve(H(V, 2 * C)) - expected)


@pytest.mark.parametrize("symbol", COEFFICIENTS[:6], ids=str)
def test_V1_rational_terms(symbol):
    """V1, display after F(u): terms of a1, a2, b1, b2, b3 as printed are the service's, with L = 0."""
    assert is_zero(of_the_service(symbol) - CORRECTED[symbol])
    assert is_zero(L(CORRECTED[symbol], 2 * C))


def test_V1_rational_a3():
    """V1, a3-term: with + g3⁸/g1³ printed L(V) = -64 C g2 g3⁷/g1²; with - g3⁸/g1³ it is 0."""
    assert is_zero(L(PRINTED[a3], 2 * C) + 64 * C * G2 * G3**7 / G1**2)
    assert not is_zero(L(PRINTED[a3], 2 * C))


def test_Vr_full_potential():
    """(Vr): C (2g1² + g3²)(C1 + C2 g2²) is c1 (g1² - g2²) + c2 g2² (2g1² + g3²) + c1 |γ|², c_i = C C_i."""
    assert is_zero(of_the_service(c1) - PRINTED[c1])
    assert is_zero(of_the_service(c2) - PRINTED[c2])
    V2 = (Q * (c1 + c2 * G2**2) / C).subs(A, 2 * C)
    assert is_zero(V2 - c1 * PRINTED[c1] - c2 * PRINTED[c2] - c1 * (G1**2 + G2**2 + G3**2))
    # On the sphere: L of g1² - g2² has the factor |γ|² - 1 at most; here it vanishes off it too.
    assert is_zero(L(PRINTED[c1], 2 * C))
    assert is_zero(L(PRINTED[c2], 2 * C))


@pytest.mark.parametrize("symbol", [a1, a2, b1, b2, c1, c2], ids=str)
def test_g_terms_as_printed(symbol):
    """g(x), display before (Vg): with ν in the place of λ every printed term is that of (dx/dt)²."""
    only = {other: int(other is symbol) for other in COEFFICIENTS}
    assert is_zero(g_of(symbol) - printed_g(NU).subs(only))


def test_g_terms_left_out():
    """g(x), display before (Vg): a3 and b3 of V1 are missing."""
    curve = 1 - x**2 - NU * x
    third = 128 * x**4 + 192 * NU * x**3 + 48 * NU**2 * x**2 - 8 * NU**3 * x + 3 * NU**4
    assert is_zero(g_of(a3) + NU**4 * x * third * curve)
    assert is_zero(g_of(b3) + 2 * (10 * x**2 - 4 * NU * x + NU**2) / (NU**2 * x**2) * curve)
    assert not printed_g(NU).has(a3, b3)


def test_t_and_g_lambda():
    """t = λ² √(C/2) ∫dx/√g before (Vg): λ there is ν = λ² of (8).

    V = -g1, C = 1, λ = 2 of (8), at x = 1/8: (dx/dt)² = 31/256, printed 47/256.
    """
    values = {a1: -1, lambda_: 2, x: sympy.Rational(1, 8)} | dict.fromkeys(COEFFICIENTS[1:], 0)
    printed = (2 * printed_g(lambda_) / lambda_**4).subs(values)
    true = (-2 * g_of(a1) / (C * NU**4)).subs(NU, lambda_**2).subs(C, 1).subs(values)
    assert (true, printed) == (sympy.Rational(31, 256), sympy.Rational(47, 256))


@pytest.mark.parametrize(
    ("absent", "genus"),
    [
        ((), 3),
        ((c2,), 3),
        ((a2,), 3),
        ((c2, a2), 2),
        ((c2, b2), 2),
        ((b2,), 2),
        ((a2, b2), 2),
        ((c2, a2, b2), 1),
    ],
    ids=str,
)
def test_genus(absent, genus):
    """Text after g(x): "ultraelliptic when c2 = 0" is genus 3 still; a2 = 0 or b2 = 0 must join it.

    Elliptic for c2 = a2 = b2 = 0, as printed. Branch points of y² = g(x) counted at generic values.
    """
    generic = {a1: -2, a2: 3, b1: 5, b2: 7, c1: 11, c2: 13} | dict.fromkeys(absent, 0)
    numerator, denominator = sympy.fraction(sympy.together(printed_g(sympy.Rational(3, 2)).subs(generic)))
    _, factors = sympy.Poly(numerator * denominator, x).sqf_list()
    degree = sum(factor.degree() for factor, multiplicity in factors if multiplicity % 2)
    assert (degree - 1) // 2 == genus


def test_Vg_three_terms():
    """(Vg): V = a1 g1 + c1 (g1² - g2²) + b1/g3² is the service's, with L = 0 and h = -a1ν/2 - 2b1/ν² - c1."""
    V = symbolic(rational_potential([Fraction(3)], [Fraction(5)], [Fraction(7)]))
    assert is_zero(V - (3 * G1 + 7 * (G1**2 - G2**2) + 5 / G3**2))
    assert is_zero(L(V, 2 * C))
    assert is_zero(on_curve(H(V, 2 * C)) + 3 * NU / 2 + 10 / NU**2 + 7)


def test_B_remains_arbitrary():
    """Text after (tg): the solution does not depend on B: at q = 0 no right-hand side of (1), (2) has it."""
    omega, gamma = (3, 0, -5), (2, -7, 4)
    rates = []
    for moment in (8, 16):
        rigid_body = body(4, 2, moment)
        V = formula("3*g1 + 7*(g1^2 - g2^2) + 5*g3^4", rigid_body)
        rates.append(service_rates(rigid_body, V, omega, gamma))
    small, large = rates
    # Integers over powers of two: exact in doubles. B q' is the torque, without B.
    assert small.omega[[0, 2]].tolist() == large.omega[[0, 2]].tolist()
    assert 8 * small.omega[1] == 16 * large.omega[1]
    assert small.gamma.tolist() == large.gamma.tolist()


@pytest.mark.parametrize(
    ("coefficients", "needs_zero_areas"),
    [((a1, b1, c1), True), ((a1, 0, c1), True), ((a1, 0, 0), False)],
    ids=["Goriachev", "fluid", "Kovalevskaya"],
)
def test_integrable_neighbours(coefficients, needs_zero_areas):
    """List after (tg): A = B = 2C. X + iY = (p + iq)² + … turns at the rate -r, so X² + Y² is an integral.

    On I3 = 0 for (Vg), with b1 = 0 as well; without I3 = 0 for V = a1 g1 (b1 = c1 = 0): Kovalevskaya.
    """
    a, b, c = coefficients
    p, q, r = sympy.symbols("p q r")
    X = p**2 - q**2 - a * G1 / C + c * G3**2 / C - b * (G1**2 - G2**2) / (C * G3**2)
    Y = 2 * p * q - a * G2 / C - 2 * b * G1 * G2 / (C * G3**2)
    V = a * G1 + c * (G1**2 - G2**2) + b / G3**2
    torques, turning = printed_rates((2 * C, 2 * C, C), gradient(V), (p, q, r), GAMMA)
    p_rate, q_rate = torques[0] / (2 * C), torques[1] / (2 * C)

    def derivative(f: sympy.Expr) -> sympy.Expr:
        total = f.diff(p) * p_rate + f.diff(q) * q_rate
        return total + sum(f.diff(g) * rate for g, rate in zip((G1, G2, G3), turning, strict=True))

    left = [derivative(X) - r * Y, derivative(Y) + r * X]
    zero_areas = {r: -2 * (p * G1 + q * G2) / G3}
    assert all(is_zero(_on_sphere(f.subs(zero_areas) if needs_zero_areas else f)) for f in left)
    assert all(is_zero(_on_sphere(f)) for f in left) is not needs_zero_areas


def _on_sphere(expression: sympy.Expr) -> sympy.Expr:
    numerator = sympy.fraction(sympy.together(expression))[0]
    return sympy.rem(sympy.expand(numerator), G1**2 + G2**2 + G3**2 - 1, G2)
