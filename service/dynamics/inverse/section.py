"""Finds G from V on the section phi = pi/4 of a quadrant, where V1 is zero: as a formula or in doubles.

With |g1| = |g3| = (rho/2)^(1/2) and rho = 1 - g2² there,

    G(g2) = 2 V / ((A + C) rho).
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import comb, floor, inf, isfinite, nan, nextafter

import numpy as np
from flint import arb, ctx
from numpy.typing import ArrayLike, NDArray

from service.dynamics.body import RigidBody
from service.dynamics.errors import FormulaError
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import (
    Binary,
    Call,
    Negation,
    Number,
    Symbol,
    Tree,
    fold_tree,
    format_tree,
    with_operands,
)
from service.dynamics.inverse.polynomials import Expansion
from service.dynamics.potentials.potential import Potential
from service.dynamics.verdict.proofs.energy_terms import power_text, sum_text, term_text

FloatArray = NDArray[np.float64]
BallFunction = Callable[[arb], arb]
PRECISIONS = (96, 192, 384, 768, 1536)
"""Bits, in turn, until a ball is narrow."""
_BITS_OF_ZERO = 384
"""A ball with so many bits that still has 0 in it is taken for 0: a value that is 0 is never narrow."""
_RELATIVE_RADIUS = 2.0**-56
"""Relative radius that is lost in the rounding to a double."""


@dataclass(frozen=True, slots=True)
class Values:
    """Doubles and bounds of their errors, of one shape; where there is no value, NaN ± ∞."""

    value: FloatArray
    error: FloatArray


def enclose(function: BallFunction, points: ArrayLike) -> Values:
    """Return ``function`` at doubles of any shape, each with a rigorous bound of its error."""
    points = np.asarray(points, dtype=np.float64)
    pairs = [_value_at(function, x) for x in points.ravel().tolist()]
    value, error = np.array(pairs, dtype=np.float64).reshape(-1, 2).T
    return Values(value.reshape(points.shape).copy(), error.reshape(points.shape).copy())


def _value_at(function: BallFunction, x: float) -> tuple[float, float]:
    best = nan, inf
    for bits in PRECISIONS:
        with ctx.workprec(bits):
            ball = function(arb(x))
            if not ball.is_finite():
                continue
            if bits >= _BITS_OF_ZERO and ball.contains(0):
                # The midpoint would be noise, which no quadrature of the function could resolve.
                return 0.0, _upwards(float(ball.abs_upper()))
            value = float(ball.mid())
            error = _upwards(float((ball - arb(value)).abs_upper()))
            if isfinite(value) and error < best[1]:
                best = value, error
            if ball.rad() <= _RELATIVE_RADIUS * abs(ball.mid()):
                break
    return best


def _upwards(bound: float) -> float:
    """Return a double that is no less than what was rounded to ``bound``; 0 was not rounded."""
    return nextafter(bound, inf) if bound else 0.0


MAX_EXPANDED_POWER = 60
"""Largest power of 1 - g2² that is multiplied out."""
_ZERO = Fraction(0)
_CHECK_BITS = 128
_CHECK_LATITUDES = tuple(Fraction(g2) for g2 in ("1/7", "-2/5", "3/4", "-8/9"))
"""Values of g2 where a formula is compared with V."""
Polynomial = dict[Fraction, Fraction]
"""Coefficients by the exponents of g2."""


@dataclass(frozen=True, slots=True)
class _Factor:
    """The irrational factor of a sum of monomials of G."""

    g2: Fraction
    rho: Fraction
    two: Fraction
    log_rho: int
    log_two: int
    atoms: tuple[tuple[str, Fraction], ...]
    """Other functions of g2 and constants, with their exponents."""

    @property
    def is_one(self) -> bool:
        return not any((self.g2, self.rho, self.two, self.log_rho, self.log_two, self.atoms))

    def text(self, polynomial: Polynomial) -> str:
        """Return the polynomial times the factor."""
        factors = (
            power_text("2", self.two),
            power_text("(1 - g2^2)", self.rho),
            power_text("log(1 - g2^2)", Fraction(self.log_rho)),
            power_text("log(2)", Fraction(self.log_two)),
            *(power_text(_as_factor(atom), exponent) for atom, exponent in self.atoms),
        )
        parts = [(self.g2 + k, polynomial[k]) for k in sorted(polynomial, reverse=True)]
        if len(parts) > 1 and any(factors):
            terms = sum_text(term_text(value, power_text("g2", k)) for k, value in parts)
            return term_text(Fraction(1), f"({terms})", *factors)
        return sum_text(term_text(value, power_text("g2", k), *factors) for k, value in parts)


@dataclass(frozen=True, slots=True)
class SectionSum:
    """G of a sum of monomials: parts with different factors, which are linearly independent."""

    parts: tuple[tuple[_Factor, Polynomial], ...]

    def text(self) -> str | None:
        """Return G as a formula in ``g2``, None if it is too large."""
        try:
            return formula_text(sum_text(factor.text(polynomial) for factor, polynomial in self.parts))
        except FormulaError:
            return None  # a function in it is

    def polynomial(self) -> list[Fraction] | None:
        """Return the coefficients of g2^0, g2^1, … if G is a polynomial in g2."""
        if not self.parts:
            return []
        ((factor, polynomial), *others) = self.parts
        if others or not factor.is_one or min(polynomial) < 0:
            return None
        return [polynomial.get(Fraction(k), _ZERO) for k in range(floor(max(polynomial)) + 1)]


def section(body: RigidBody, expansion: Expansion) -> SectionSum | None:
    """Return G of a potential expanded in a quadrant, None if it is too large."""
    collected: dict[_Factor, dict[tuple[int, Fraction], Fraction]] = defaultdict(
        lambda: defaultdict(Fraction)
    )
    for (a, k, b, r, log1, log3, log_rho, *powers), coefficient in expansion.terms.items():
        rho, logs = (a + b) / 2 + r - 1, floor(log1 + log3)
        twos = r - rho - 1 - logs
        value = 2 * coefficient / (body.A + body.C) * Fraction(2) ** floor(twos)
        atoms = tuple((atom, power) for atom, power in zip(expansion.atoms, powers, strict=False) if power)
        # |g1| and |g3| have the logarithm (log rho - log 2)/2.
        for j in range(logs + 1):
            factor = _Factor(k % 1, rho % 1, twos % 1, logs - j + floor(log_rho), j, atoms)
            collected[factor][floor(rho), k - k % 1] += value * comb(logs, j) * (-1) ** j
    reduced: list[tuple[_Factor, Polynomial]] = []
    for factor, parts in collected.items():
        exponents = [rho for rho, _ in parts]
        if max(exponents) - min(0, *exponents) > MAX_EXPANDED_POWER:
            return None
        is_whole = factor.rho == 0
        for power, polynomial in _by_powers_of_rho(
            *_lowest_terms(parts, is_whole=is_whole), is_whole=is_whole
        ):
            reduced.append((replace(factor, rho=factor.rho + power), polynomial))
    return SectionSum(tuple(sorted(reduced, key=lambda part: (not part[0].is_one, part[0].two, part[0].rho))))


def substituted_formula(body: RigidBody, tree: Tree, signs: tuple[int, int]) -> str | None:
    """Return G with the section put into the formula of V as it stands, None if it is too large."""
    square = parse("(1 - g2^2)/2")
    side = Call("sqrt", square)
    images: dict[str, Tree] = {
        name: side if sign > 0 else Negation(side) for name, sign in zip(("g1", "g3"), signs, strict=True)
    }

    def build(_: int, node: Tree, operands: Sequence[Tree]) -> Tree:
        match node:
            case Symbol(name):
                return images.get(name, node)
            case Binary("^", Symbol(name), Number(exponent)) if name in images and exponent % 2 == 0:
                return square if exponent == 2 else Binary("^", square, Number(exponent / 2))
        return with_operands(node, operands)

    factor = parse(f"({(body.A + body.C) / 2})*(1 - g2^2)")
    try:
        return formula_text(format_tree(Binary("/", fold_tree(tree, build), factor)))
    except FormulaError:
        return None


def G_on_section(body: RigidBody, potential: Potential, signs: tuple[int, int]) -> BallFunction:
    """Return G as a function of a ball -1 < g2 < 1, computed from V."""

    def G(g2: arb) -> arb:
        rho = (1 - g2) * (1 + g2)
        side = (rho / 2).sqrt()
        V = potential.value_ball(signs[0] * side, g2, signs[1] * side)
        return V / (BallAlgebra().constant((body.A + body.C) / 2) * rho)

    return G


def is_G_confirmed(body: RigidBody, potential: Potential, G: str, signs: tuple[int, int]) -> bool:
    """Whether the balls of a formula for G meet those computed from V, wherever V has values."""
    balls = BallAlgebra()
    try:
        tape = compile_tape(parse(G), ("g2",))
    except FormulaError:
        return False  # a constant of it has no value, or is beyond the limits
    on_section = G_on_section(body, potential, signs)
    with ctx.workprec(_CHECK_BITS):
        for g2 in _CHECK_LATITUDES:
            expected = on_section(balls.constant(g2))
            value = tape.evaluate(balls, (balls.constant(g2),))
            if expected.is_finite() and not (value.is_finite() and value.overlaps(expected)):
                return False
    return True


def _as_factor(atom: str) -> str:
    """Return an atom as text that a power can be taken of."""
    return format_tree(tree) if isinstance(tree := parse(atom), Symbol | Call) else f"({atom})"


def formula_text(text: str) -> str | None:
    """Return the text as the printer writes it, None if it is beyond the limits of formulas."""
    try:
        return format_tree(parse(text))
    except FormulaError:
        return None


def _lowest_terms(parts: dict[tuple[int, Fraction], Fraction], *, is_whole: bool) -> tuple[int, Polynomial]:
    """Return e and P with Σ c rho^e' g2^k = rho^e P(g2); e ≤ 0 if the powers of rho are whole."""
    lowest = min(rho for rho, _ in parts)
    if is_whole:
        lowest = min(lowest, 0)
    polynomial: Polynomial = defaultdict(Fraction)
    for (rho, k), value in parts.items():
        for j in range(rho - lowest + 1):
            polynomial[k + 2 * j] += value * comb(rho - lowest, j) * (-1) ** j
    polynomial = {k: value for k, value in polynomial.items() if value}
    while polynomial and not (is_whole and lowest == 0):
        quotient, remainder = _divided_by_rho(polynomial)
        if remainder:
            break
        lowest, polynomial = lowest + 1, quotient
    return lowest, polynomial


def _by_powers_of_rho(
    lowest: int, polynomial: Polynomial, *, is_whole: bool
) -> Iterator[tuple[int, Polynomial]]:
    """Yield rho^lowest P as terms rho^e (c + d g2), and as a polynomial where e is a natural number."""
    while polynomial and min(polynomial) >= 0 and not (is_whole and lowest == 0):
        quotient, remainder = _divided_by_rho(polynomial)
        if remainder:
            yield lowest, remainder
        lowest, polynomial = lowest + 1, quotient
    if polynomial:
        yield lowest, polynomial


def _divided_by_rho(polynomial: Polynomial) -> tuple[Polynomial, Polynomial]:
    """Return the quotient by 1 - g2² and the remainder, two terms of the highest powers or of 1 and g2."""
    quotient: Polynomial = {}
    low, high = min(_ZERO, *polynomial), max(polynomial)
    remainder = dict(polynomial)
    for k in (high - j for j in range(floor(high - low) - 1)):
        value = remainder.pop(k, _ZERO)
        if value:
            quotient[k - 2] = -value
            remainder[k - 2] = remainder.get(k - 2, _ZERO) + value
    return quotient, {k: value for k, value in remainder.items() if value}
