"""Admissible potentials as formulas, from the paper and from theory sections 3 and 4."""

from collections.abc import Callable, Mapping
from fractions import Fraction

from service.dynamics.body import RigidBody
from service.dynamics.potentials.families.written import expression_potential
from service.dynamics.potentials.potential import Potential
from service.dynamics.verdict.verdict import Verdict, decide

EIGHT_TERMS = (
    "a1*g1 + a2*(8*g1^3 + 8*g1*g3^2 + g3^4/g1)"
    " + a3*(16*g1*(8*g1^4 + 16*g1^2*g3^2 + 9*g3^4) + 16*g3^6/g1 - g3^8/g1^3)"
    " + b1/g3^2 + b2*(g1^2 - g3^2)/g3^6 + b3*(2*g1^4 - 2*g1^2*g3^2 + g3^4)/g3^10"
    " + c1*(g1^2 - g2^2) + c2*g2^2*(2*g1^2 + g3^2)"
)
EIGHT_PARAMETERS = {
    "a1": Fraction(-2),
    "a2": Fraction(1, 20),
    "a3": Fraction(1, 200),
    "b1": Fraction(1, 50),
    "b2": Fraction(1, 500),
    "b3": Fraction(1, 4000),
    "c1": Fraction(1, 5),
    "c2": Fraction(1, 10),
}


def body(A: Fraction | int | str, C: Fraction | int | str = 1) -> RigidBody:
    return RigidBody(Fraction(A), None, Fraction(C))


def potential(
    text: str, on: RigidBody | None = None, parameters: Mapping[str, Fraction] | None = None
) -> Potential:
    return expression_potential(text, parameters or {}, on or body(2))


def verdict_on(
    text: str,
    on: RigidBody | None = None,
    parameters: Mapping[str, Fraction] | None = None,
    is_late: Callable[[], bool] = lambda: False,
) -> Verdict:
    return decide(on or body(2), potential(text, on, parameters), is_late)


def hypergeometric(a: Fraction, b: Fraction, c: Fraction, terms: int) -> str:
    """Return the polynomial 2F1(a, b; c; v), v = 1 + g3²/g1², up to v^terms."""
    coefficient, parts = Fraction(1), []
    for j in range(terms + 1):
        parts.append(f"({coefficient})*(1 + g3^2/g1^2)^{j}")
        if j < terms:
            coefficient *= (a + j) * (b + j) / ((c + j) * (j + 1))
    return "(" + " + ".join(parts) + ")"


def U(n: int) -> str:
    """Theory 3.1, the a_n-term, A = 2C; H = (n - 3/2) nu^(2n-1)."""
    half = Fraction(1, 2)
    series = hypergeometric(half - n, Fraction(2 - 2 * n), Fraction(5, 2) - n, 2 * n - 2)
    return f"g1^{2 * n - 1} * {series}"


def W(n: int) -> str:
    """Theory 3.1, the b_n-term, A = 2C; H = -(n + 1) nu^(-2n)."""
    series = hypergeometric(Fraction(2), Fraction(1 - n), Fraction(2 + n), n - 1)
    return f"g1^{2 * n - 2} / g3^{4 * n - 2} * {series}"


def B_term(n: int, alpha: Fraction) -> str:
    """Theory 4.3; H = (-1)^n (n α - n - 1)/α λ^(2(n+1))."""
    power = (alpha - 1) * (n + 1) / alpha
    series = hypergeometric(Fraction(-n), -power, 1 - n + (n + 1) / alpha, n)
    return f"abs(g1)^({2 * power}) * {series}"


def C_term(n: int, alpha: Fraction) -> str:
    """Theory 4.3; H = (n - (n+1) α) λ^(-2α(n+1))."""
    series = hypergeometric(Fraction(2), Fraction(-n), alpha + 1 + (alpha - 1) * n, n)
    return f"g1^{2 * n} * abs(g3)^({-2 * (alpha * n + alpha - 1)}) * {series}"
