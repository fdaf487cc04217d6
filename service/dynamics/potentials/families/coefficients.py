"""Families given by coefficients: a uniform field, homogeneous potentials, rational ones for A = 2C.

The homogeneous potentials are terminating hypergeometric series on |g1| and |g3|. With α = A/C and
v = 1 + g3²/g1² (H. M. Yehia, the last formula of the paper),

    B_n = |g1|^(2(α-1)(n+1)/α) 2F1(-n, -(α-1)(n+1)/α; 1-n+(n+1)/α; v),
    C_n = g1^(2n) |g3|^(-2(αn+α-1)) 2F1(2, -n; α+1+(α-1)n; v),
    H[B_n] = (-1)^n (n-(n+1)/α) λ^(2(n+1)),      H[C_n] = (n-(n+1)α) λ^(-2α(n+1)).

The exchange of the axes, α -> 1/α and g1 <-> g3, makes (-1)^n C_n of B_n.

B_n has no value for α = (n+1)/m with m = 1, …, n-1, where a denominator of the
series vanishes; for m = n, which the paper does not except, it is a multiple of
A g1² + C g3² and nothing new beside A_0. Where A < C the same happens to C_n
at 1/α. The logarithmic solution with the same index fills the gap.

The rational potentials are Laurent polynomials with H = Σ powers of nu = g3²/g1: with Gauss's series,

    U_n = g1^(2n-1) 2F1(1/2-n, 2-2n; 5/2-n; v),             H[U_n] = (n-3/2) nu^(2n-1),
    W_n = g1^(2n-2) g3^-(4n-2) 2F1(2, 1-n; 2+n; v),         H[W_n] = -(n+1) nu^(-2n).
"""

from collections.abc import Iterator, Sequence
from fractions import Fraction
from math import comb

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError, FormulaError
from service.dynamics.formula.algebras.monomials import weighted_sum
from service.dynamics.formula.tree import Binary, Tree
from service.dynamics.potentials.potential import Notice, Potential
from service.dynamics.potentials.terms import (
    MAX_TERMS,
    Coefficients,
    Exponents,
    NoLogTermError,
    PowerSum,
    Ratio,
    TooManyTermsError,
    about_one,
    exchanged,
    log_term,
    monomial_sum,
    multiplicity,
    power_terms,
    require_multiplicity,
    scaled,
    total,
)


def gravity_potential(a: Fraction, b: Fraction, c: Fraction) -> Potential:
    """Return V = a g1 + b g2 + c g3."""
    return Potential.from_tree(monomial_sum({(1, 0, 0): a, (0, 1, 0): b, (0, 0, 1): c}), "gravity")


class UndefinedTermError(DynamicsError):
    """A coefficient of a term that has no value for these moments."""

    code = "undefined_term"


def homogeneous_potential(
    body: RigidBody,
    *,
    A: Coefficients = (),
    B: Coefficients = (),
    C: Coefficients = (),
    log: Coefficients = (),
) -> Potential:
    """Return V = (A g1² + C g3²) Σ A_n g2^n + Σ B_n-terms + Σ C_n-terms + Σ log_n-terms, from n = 0.

    Terms that are multiples of A g1² + C g3² are kept, with a warning.

    Raises
    ------
    EqualMomentsError
        A = C.
    TooManyTermsError
        A list is longer than MAX_TERMS; the pointer names it.
    UndefinedTermError, NoLogTermError
        A coefficient that is not zero belongs to no term; the pointer names it.
    FormulaLimitError
        The exact coefficients or exponents are beyond the limits of formulas.
    """
    for error in refusals(body, A=A, B=B, C=C, log=log):
        raise error
    alpha = body.alpha
    logs = [(weight, log_term(alpha, n)) for n, weight in enumerate(log) if weight]
    powers = weighted_sum(
        [
            *((weight, B_term(alpha, n)) for n, weight in enumerate(B) if weight),
            *((weight, C_term(alpha, n)) for n, weight in enumerate(C) if weight),
            *((weight, term.rest) for weight, term in logs),
        ]
    )
    terms = [*power_terms(powers), *(term.tree(weight) for weight, term in logs)]
    if any(A):
        terms.insert(0, _multiple_of_Q(body, A))
    try:
        return Potential.from_tree(total(terms), "homogeneous", tuple(_notices(alpha, B, C)))
    except FormulaError as error:
        raise error.at(pointer="/potential") from error


def refusals(
    body: RigidBody, *, A: Coefficients, B: Coefficients, C: Coefficients, log: Coefficients
) -> Iterator[DynamicsError]:
    """Yield every error that prevents the coefficients from being a potential of the body."""
    try:
        body.require_planar()
    except DynamicsError as error:
        yield error
        return
    for name, coefficients in (("A", A), ("B", B), ("C", C), ("log", log)):
        if len(coefficients) > MAX_TERMS:
            yield TooManyTermsError(name, len(coefficients))
    alpha = body.alpha
    for name, coefficients, ratio in (("B", B, alpha), ("C", C, 1 / alpha)):
        for n, m in _gaps(coefficients, ratio):
            if m < n:
                yield UndefinedTermError(
                    f"{name}_{n} has no value for A/C = {alpha}: a denominator of its series vanishes; "
                    f'accepted in its place is "log" with index {n}',
                    pointer=f"/potential/{name}/{n}",
                )
    for n, coefficient in enumerate(log):
        if coefficient:
            try:
                require_multiplicity(alpha, n)
            except NoLogTermError as error:
                yield error


def B_term(alpha: Fraction, n: int) -> PowerSum:
    """Return B_n by the exponents of |g1| and |g3|; ZeroDivisionError where it is undefined."""
    exponent = 2 * (alpha - 1) * (n + 1) / alpha
    return {(exponent - 2 * k, Fraction(2 * k)): factor for k, factor in enumerate(B_coefficients(alpha, n))}


def C_term(alpha: Fraction, n: int) -> PowerSum:
    """Return C_n by the exponents of |g1| and |g3|; ZeroDivisionError where it is undefined."""
    return weighted_sum([(Fraction((-1) ** n), exchanged(B_term(1 / alpha, n)))])


def B_coefficients(alpha: Ratio, n: int) -> list[Ratio]:
    """Return the coefficients of (g3/g1)^0, (g3/g1)², …, (g3/g1)^(2n) in B_n / |g1|^(2(α-1)(n+1)/α)."""
    return about_one(-n, (1 - alpha) * (n + 1) / alpha, 1 - n + (n + 1) / alpha, n + 1, alpha / alpha)


def energy_of_B(alpha: Fraction, n: int) -> Fraction:
    """Return the factor of λ^(2(n+1)) in H[B_n]; zero where B_n is a multiple of Q."""
    return Fraction(-1) ** n * (n - (n + 1) / alpha)


def energy_of_C(alpha: Fraction, n: int) -> Fraction:
    """Return the factor of λ^(-2α(n+1)) in H[C_n]; zero where C_n is a multiple of Q."""
    return n - (n + 1) * alpha


def _gaps(coefficients: Coefficients, ratio: Fraction) -> Iterator[tuple[int, int]]:
    """Yield n and m where ``ratio`` is (n+1)/m > 1: the term is undefined, or a multiple of Q if m = n."""
    for n, coefficient in enumerate(coefficients):
        if coefficient and ratio > 1 and (m := multiplicity(ratio, n)) is not None:
            yield n, m


def _notices(alpha: Fraction, B: Coefficients, C: Coefficients) -> Iterator[Notice]:
    for name, coefficients, ratio in (("B", B, alpha), ("C", C, 1 / alpha)):
        for n, _ in _gaps(coefficients, ratio):
            yield Notice(
                "trivial_term",
                f"{name}_{n} is a multiple of A g1² + C g3² for A/C = {alpha}: A_0 says the same, "
                f'and the energy does not contain it; "log" with index {n} is the new solution in its place',
                f"/potential/{name}/{n}",
            )


def _multiple_of_Q(body: RigidBody, A: Coefficients) -> Tree:
    Q = monomial_sum({(2, 0, 0): body.A, (0, 0, 2): body.C})
    match [(n, coefficient) for n, coefficient in enumerate(A) if coefficient]:
        case [(0, only)]:
            return scaled(only, [Q])
        case [(n, only)]:
            return scaled(only, [monomial_sum({(0, n, 0): Fraction(1)}), Q])
        case several:
            return Binary("*", Q, monomial_sum({(0, n, 0): coefficient for n, coefficient in several}))


Laurent = dict[Exponents, Fraction]


class RationalBodyError(DynamicsError):
    """The rational family needs A = 2C."""

    code = "rational_needs_double_moment"


def require_rational_body(body: RigidBody) -> None:
    """Raise RationalBodyError unless A = 2C."""
    if body.A != 2 * body.C:
        raise RationalBodyError(
            f"A = {body.A} and C = {body.C}: the rational family needs A = 2C", pointer="/body"
        )


def rational_potential(a: Sequence[Fraction], b: Sequence[Fraction], c: Sequence[Fraction]) -> Potential:
    """Return V = Σ a_n-terms + Σ b_n-terms + Σ c_k-terms, indices from 1.

    a_n multiplies U_n, a_3 multiplies -U_3 (the paper's sign, with its misprint
    in g3^8/g1^3 corrected); b_n multiplies Catalan(n) W_n; c_1 multiplies
    g1² - g2², and c_k for k ≥ 2 multiplies g2^(2k-2) (2 g1² + g3²).

    Raises
    ------
    TooManyTermsError
        A list is longer than MAX_TERMS; the pointer names it.
    """
    terms: list[tuple[Fraction, Laurent]] = []
    for name, coefficients, term in (("a", a, _a_term), ("b", b, _b_term), ("c", c, _c_term)):
        if len(coefficients) > MAX_TERMS:
            raise TooManyTermsError(name, len(coefficients))
        terms += [(weight, term(n)) for n, weight in enumerate(coefficients, start=1) if weight]
    return Potential.from_tree(monomial_sum(weighted_sum(terms)), "rational")


def U_term(n: int) -> Laurent:
    """Return U_n, n ≥ 1: degree 2n-1."""
    factors = about_one(Fraction(1, 2) - n, 2 - 2 * n, Fraction(5, 2) - n, 2 * n - 1, Fraction(1))
    return {(2 * n - 1 - 2 * k, 0, 2 * k): factor for k, factor in enumerate(factors)}


def W_term(n: int) -> Laurent:
    """Return W_n, n ≥ 1: degree -2n."""
    factors = about_one(2, 1 - n, 2 + n, n, Fraction(1))
    return {(2 * n - 2 - 2 * k, 0, 2 * k - 4 * n + 2): factor for k, factor in enumerate(factors)}


def _a_term(n: int) -> Laurent:
    sign = -1 if n == 3 else 1
    return {exponents: sign * factor for exponents, factor in U_term(n).items()}


def _b_term(n: int) -> Laurent:
    catalan = comb(2 * n, n) // (n + 1)
    return {exponents: catalan * factor for exponents, factor in W_term(n).items()}


def _c_term(k: int) -> Laurent:
    if k == 1:
        return {(2, 0, 0): Fraction(1), (0, 2, 0): Fraction(-1)}
    return {(2, 2 * k - 2, 0): Fraction(2), (0, 2 * k - 2, 2): Fraction(1)}
