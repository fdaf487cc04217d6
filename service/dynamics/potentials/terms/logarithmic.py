"""Logarithmic potentials where A/C or C/A is a ratio N/m > 1 of integers: those of F(w) = w^m.

With A/C = α = N/m, Q = α g1² + g3², ρ = g1² + g3² and T = Q/ρ,

    V = ρ^(N-m) T ∫ (α-t)^N (t-1)^(-m) t^(-2) dt  at t = T,     H[V] = -(α-1)^(N-m) λ^(2N).

The integrand is split into partial fractions; it has no residue at t = 0, and
its residue at t = 1 multiplies log(g1²/ρ). For A < C the axes are exchanged.
"""

from dataclasses import dataclass
from fractions import Fraction
from math import comb

from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.monomials import added_up, weighted_sum
from service.dynamics.formula.tree import Binary, Call, Number, Symbol, Tree
from service.dynamics.potentials.terms.powers import PowerSum, exchanged, monomial_sum, scaled


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
