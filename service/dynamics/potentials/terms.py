"""Sums of terms with exact coefficients: monomials and powers, and logarithmic potentials made of them.

The families' lists of coefficients are checked here too.

Logarithmic potentials are those of F(w) = w^m. With A/C = α = N/m, Q = α g1² + g3², ρ = g1² + g3² and
T = Q/ρ,

    V = ρ^(N-m) T ∫ (α-t)^N (t-1)^(-m) t^(-2) dt  at t = T,     H[V] = -(α-1)^(N-m) λ^(2N).

The integrand is split into partial fractions; it has no residue at t = 0, and
its residue at t = 1 multiplies log(g1²/ρ). For A < C the axes are exchanged.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import comb
from typing import TypeVar

from flint import fmpq

from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.monomials import added_up, weighted_sum
from service.dynamics.formula.tree import VARIABLES, Binary, Call, Negation, Number, Symbol, Tree, exact_tree

MAX_TERMS = 20
"""Length of each list. The degree grows with the index, and with it the cancellation near the poles."""
Coefficients = Sequence[Fraction]
Ratio = TypeVar("Ratio", Fraction, fmpq)
"""Exact numbers of either library."""


class TooManyTermsError(DynamicsError):
    """A list of coefficients longer than MAX_TERMS."""

    code = "too_many_terms"

    def __init__(self, name: str, count: int) -> None:
        super().__init__(
            f"{count} coefficients; at most {MAX_TERMS} are accepted", pointer=f"/potential/{name}"
        )


Exponents = tuple[int, int, int]
"""Exponents of g1, g2, g3."""


def monomial_sum(coefficients: Mapping[Exponents, Fraction]) -> Tree:
    """Return the tree of the sum, without zero terms; the Number 0 if nothing is left."""
    total: Tree | None = None
    for exponents, coefficient in coefficients.items():
        if coefficient == 0:
            continue
        term = _monomial(abs(coefficient), exponents)
        if total is None:
            total = term if coefficient > 0 else _negated(term)
        else:
            total = Binary("+" if coefficient > 0 else "-", total, term)
    return Number(Fraction(0)) if total is None else total


def _negated(term: Tree) -> Tree:
    # -x*y reads as (-x)*y: the sign goes to the leftmost factor, so that no parentheses are printed.
    if isinstance(term, Binary) and term.operator in "*/":
        return Binary(term.operator, _negated(term.left), term.right)
    return Negation(term)


def _monomial(coefficient: Fraction, exponents: Exponents) -> Tree:
    """Return coefficient · powers / powers, for a positive coefficient."""
    numerator: Tree | None = None if coefficient == 1 else exact_tree(coefficient)
    denominator: Tree | None = None
    for name, exponent in zip(VARIABLES, exponents, strict=True):
        if exponent:
            factor: Tree = Symbol(name)
            if abs(exponent) > 1:
                factor = Binary("^", factor, Number(Fraction(abs(exponent))))
            if exponent > 0:
                numerator = factor if numerator is None else Binary("*", numerator, factor)
            else:
                denominator = factor if denominator is None else Binary("*", denominator, factor)
    if numerator is None:
        numerator = Number(Fraction(1))
    return numerator if denominator is None else Binary("/", numerator, denominator)


PowerSum = Mapping[tuple[Fraction, Fraction], Fraction]
"""Coefficients by the exponents of |g1| and |g3|."""


def about_one(a: Ratio | int, b: Ratio | int, c: Ratio | int, count: int, one: Ratio) -> list[Ratio]:
    """Return the ``count`` coefficients of 2F1(a, b; c; 1 + z), which ends, in powers of z; ``one`` is 1."""
    series = [one]
    for j in range(count - 1):
        series.append(series[-1] * (a + j) * (b + j) / ((c + j) * (j + 1)))
    return [sum((comb(j, k) * series[j] for j in range(k + 1, count)), start=series[k]) for k in range(count)]


def exchanged(terms: PowerSum) -> dict[tuple[Fraction, Fraction], Fraction]:
    """Return the sum with |g1| and |g3| exchanged."""
    return {(third, first): factor for (first, third), factor in terms.items()}


def power_terms(terms: PowerSum) -> list[Tree]:
    """Return the terms that are not zero as trees."""
    return [_term(factor, exponents) for exponents, factor in terms.items() if factor]


def scaled(coefficient: Fraction, factors: Sequence[Tree], divisors: Sequence[Tree] = ()) -> Tree:
    """Return coefficient · factors / divisors; a coefficient 1 is not written."""
    if abs(coefficient) != 1 or not factors:
        first, rest = exact_tree(coefficient), factors
    else:
        first, rest = factors[0] if coefficient > 0 else Negation(factors[0]), factors[1:]
    for factor in rest:
        first = Binary("*", first, factor)
    for divisor in divisors:
        first = Binary("/", first, divisor)
    return first


def total(terms: Iterable[Tree]) -> Tree:
    """Return the sum of the terms, the Number 0 if there are none."""
    result: Tree | None = None
    for term in terms:
        if result is None:
            result = term
        elif (positive := _opposite(term)) is not None:
            result = Binary("-", result, positive)
        else:
            result = Binary("+", result, term)
    return Number(Fraction(0)) if result is None else result


def _opposite(term: Tree) -> Tree | None:
    """Return the term without the minus sign it begins with, None if it begins with none."""
    if isinstance(term, Negation):
        return term.operand
    if isinstance(term, Binary) and term.operator in "*/":
        left = _opposite(term.left)
        return None if left is None else Binary(term.operator, left, term.right)
    return None


def _term(coefficient: Fraction, exponents: tuple[Fraction, Fraction]) -> Tree:
    powers = {name: exponent for name, exponent in zip(("g1", "g3"), exponents, strict=True) if exponent}
    factors = [_power(name, exponent) for name, exponent in powers.items() if exponent > 0]
    divisors = [_power(name, -exponent) for name, exponent in powers.items() if exponent < 0]
    return scaled(coefficient, factors, divisors)


def _power(name: str, exponent: Fraction) -> Tree:
    # An even power is the same on the axis and on its absolute value.
    base: Tree = Symbol(name) if exponent % 2 == 0 else Call("abs", Symbol(name))
    return base if exponent == 1 else Binary("^", base, exact_tree(exponent))


class NoLogTermError(DynamicsError):
    """A logarithmic term for moments where the power series has no gap."""

    code = "no_log_term"


@dataclass(frozen=True, slots=True)
class LogTerm:
    """V = ``residue`` (g1² + g3²)^``power`` Q log(g_k²/(g1² + g3²)) + ``rest``.

    Q = α g1² + g3² and k = 1 for A > C, Q = g1² + α g3² and k = 3 for A < C.
    """

    alpha: Fraction
    """The larger of A/C and C/A."""
    power: int
    residue: Fraction
    rest: PowerSum
    is_exchanged: bool

    def tree(self, coefficient: Fraction) -> Tree:
        """Return the logarithmic part, without ``rest``, times ``coefficient`` other than 0."""
        moments = (self.alpha, Fraction(1)) if not self.is_exchanged else (Fraction(1), self.alpha)
        Q = _quadratic(*moments)
        rho = _quadratic(Fraction(1), Fraction(1))
        square = Binary("^", Symbol("g3" if self.is_exchanged else "g1"), Number(Fraction(2)))
        factors = [Q, Call("log", Binary("/", square, rho))]
        if self.power:
            factors.insert(0, rho if self.power == 1 else Binary("^", rho, Number(Fraction(self.power))))
        return scaled(coefficient * self.residue, factors)


def multiplicity(alpha: Fraction, n: int) -> int | None:
    """Return m of the logarithmic solution with index n, None if there is none.

    There is one if (n+1)/m is A/C or C/A for an m from 1 to n.
    """
    m = (n + 1) / max(alpha, 1 / alpha)
    return m.numerator if m.denominator == 1 and m <= n else None


def require_multiplicity(alpha: Fraction, n: int) -> int:
    """Return m of the logarithmic solution with index n; raises NoLogTermError."""
    m = multiplicity(alpha, n)
    if m is None:
        accepted = ", ".join(str(Fraction(n + 1, k)) for k in range(1, n + 1)) or "none"
        raise NoLogTermError(
            f"A/C = {alpha} has no logarithmic term with index {n}; "
            f"it is there where A/C or C/A is one of: {accepted}",
            pointer=f"/potential/log/{n}",
        )
    return m


def log_term(alpha: Fraction, n: int) -> LogTerm:
    """Return the logarithmic solution with N = n + 1 for A/C = ``alpha``; raises NoLogTermError."""
    larger, N, m = max(alpha, 1 / alpha), n + 1, require_multiplicity(alpha, n)
    polynomial, double, poles = partial_fractions(larger, N, m)
    degree = N - m
    parts = [(-double, _product(larger, 0, degree))]
    parts += [
        (factor / (i + 1), _product(larger, i + 2, degree - i - 2)) for i, factor in enumerate(polynomial)
    ]
    for k, factor in enumerate(poles[1:], start=1):
        # (t-1)^-k = (ρ/((α-1) g1²))^k
        weight = -factor / (k * (larger - 1) ** k)
        parts.append((weight, _product(larger, 1, degree - 1 + k, first=-2 * k)))
    rest = weighted_sum(parts)
    is_exchanged = alpha < 1
    return LogTerm(larger, degree - 1, poles[0], exchanged(rest) if is_exchanged else rest, is_exchanged)


def energy_of_log(alpha: Fraction, n: int) -> Fraction:
    """Return H of the logarithmic solution: the factor of λ^(2(n+1)), of λ^(-2 α (n+1)) for α < 1.

    Raises
    ------
    NoLogTermError
        There is no such solution.
    """
    return -((max(alpha, 1 / alpha) - 1) ** (n + 1 - require_multiplicity(alpha, n)))


def partial_fractions(alpha: Fraction, N: int, m: int) -> tuple[list[Fraction], Fraction, list[Fraction]]:
    """Split (α-t)^N (t-1)^(-m) t^(-2), α = N/m, into powers of t, of 1/t and of 1/(t-1).

    Returns
    -------
    polynomial
        Coefficients of t^0, t^1, …, t^(N-m-2).
    double
        Coefficient of t^(-2); that of t^(-1) is zero.
    poles
        Coefficients of (t-1)^(-1), …, (t-1)^(-m).
    """
    double = (-1) ** m * alpha**N
    # About t = 1, with x = t - 1: (α-1-x)^N (1+x)^(-2), up to x^(m-1).
    power = [comb(N, i) * (alpha - 1) ** (N - i) * (-1) ** i for i in range(m)]
    poles = [
        sum((power[i] * (-1) ** (j - i) * (j - i + 1) for i in range(j + 1)), Fraction(0)) for j in range(m)
    ]
    # For large t: t^(N-m-2) (α/t-1)^N (1-1/t)^(-m), down to t^0.
    power = [comb(N, i) * alpha**i * (-1) ** (N - i) for i in range(N - m - 1)]
    falling = [
        sum((power[i] * comb(m - 1 + j - i, j - i) for i in range(j + 1)), Fraction(0))
        for j in range(N - m - 1)
    ]
    return falling[::-1], double, poles[::-1]


def _product(alpha: Fraction, quadratics: int, circles: int, *, first: int = 0) -> PowerSum:
    """Return |g1|^first Q^quadratics ρ^circles expanded."""
    return added_up(
        (
            (Fraction(2 * (i + j) + first), Fraction(2 * (quadratics + circles - i - j))),
            comb(quadratics, i) * comb(circles, j) * alpha**i,
        )
        for i in range(quadratics + 1)
        for j in range(circles + 1)
    )


def _quadratic(first: Fraction, third: Fraction) -> Tree:
    return monomial_sum({(2, 0, 0): first, (0, 0, 2): third})
