"""Formulas as sums of monomials, and polynomial potentials with exact coefficients.

Potentials that agree on the sphere |g|² = 1 are the same.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from flint import fmpq

from service.dynamics.formula.algebras.monomials import (
    ALL_ATOMS,
    LOG_G1,
    LOG_G3,
    LOG_RHO,
    RHO,
    SPHERE,
    Atom,
    Monomial,
    MonomialSum,
    NotAMonomialSumError,
    Rules,
    added_up,
    as_fmpq,
    as_fraction,
    read,
    reduced,
    weighted_sum,
    without_zeros,
)
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.potentials.terms import Exponents
from service.dynamics.verdict.proofs.energy_terms import power_text, sum_text, term_text

MAX_TERMS = 500
"""Terms of any sum on the way."""
MAX_TERM_PRODUCTS = 20_000
"""Products of terms in one expansion."""
MAX_EXPANDED_POWER = 60
"""Power of a sum that is multiplied out."""
MAX_COEFFICIENT_BITS = 8192
"""Bits of a numerator or a denominator on the way."""
MAX_ATOMS = 4
"""Functions of g2 and irrational constants that are kept as they are."""
MAX_ATOM_TERMS = 40
"""Terms in the argument of one of them."""
Powers = tuple[Fraction, ...]
"""Exponents of g1, g2, g3, rho = g1² + g3², log g1, log g3, log rho (g1, g3 absolute in a quadrant) and of
the atoms. Those of the logarithms are natural numbers."""
ExpandedTerms = dict[Powers, Fraction]
"""Coefficients by exponents, none of them 0."""
FIRST_ATOM_POSITION = 7
"""Position of the first atom."""
GENERATORS = FIRST_ATOM_POSITION + MAX_ATOMS
_OF_G2 = {1: "g2", 3: "(1 - g2^2)", 6: "log(1 - g2^2)"}
"""A function of g2, as text."""
_POSITIONS = {RHO: 3, LOG_G1: 4, LOG_G3: 5, LOG_RHO: 6}


@dataclass(frozen=True, slots=True)
class Expansion:
    """A sum of monomials, and what its atoms are: texts in ``g2`` alone, such as ``exp(g2)`` and ``pi``."""

    terms: ExpandedTerms
    atoms: tuple[str, ...]


def expand(tape: Tape) -> Expansion | None:
    """Return the formula as a sum of monomials, whatever the signs of g1 and g3; None if it is not one.

    Whole powers of sums are multiplied out; other powers are taken of
    monomials and of multiples of rho (also written 1 - g2²).
    """
    return _expand(tape, 0, 0, plain=7)


def expand_in_quadrant(tape: Tape, g1_sign: int, g3_sign: int) -> Expansion | None:
    """Return the formula as a sum of monomials in |g1| and |g3| where g1 and g3 have the signs given."""
    return _expand(tape, g1_sign, g3_sign, plain=2)


def unit(position: int) -> Powers:
    """Return the exponents of one generator."""
    return tuple(Fraction(index == position) for index in range(GENERATORS))


def _expand(tape: Tape, g1_sign: int, g3_sign: int, *, plain: int) -> Expansion | None:
    rules = Rules(
        (g1_sign, 0, g3_sign),
        plain,
        atoms=ALL_ATOMS,
        most_atoms=MAX_ATOMS,
        most_argument_terms=MAX_ATOM_TERMS,
        most_terms=MAX_TERMS,
        most_work=MAX_TERM_PRODUCTS,
        most_power=MAX_EXPANDED_POWER,
        most_bits=MAX_COEFFICIENT_BITS,
    )
    try:
        found = read(tape, rules)
    except NotAMonomialSumError:
        return None
    atoms = list[str]()
    for atom in found.atoms:
        atoms.append(_atom_text(atom, found.unit, atoms))
    terms = {_powers(monomial, found.unit): as_fraction(value) for monomial, value in found.terms.items()}
    return Expansion(terms, tuple(atoms))


def _powers(monomial: Monomial, unit: int) -> Powers:
    first, second, third, _, atoms = monomial
    powers = [Fraction(each, unit) for each in (first, second, third)] + [Fraction(0)] * (GENERATORS - 3)
    for number, exponent in atoms:
        powers[_POSITIONS.get(number, FIRST_ATOM_POSITION + number)] = Fraction(exponent, unit)
    return tuple(powers)


def _atom_text(atom: Atom, unit: int, known: list[str]) -> str:
    texts = [
        _text({_powers(each, unit): as_fraction(fmpq(p, q)) for each, p, q in terms}, known)
        for terms in atom.arguments
    ]
    match atom.name:
        case "pi":
            return "pi"
        case "power":
            return power_text(f"({texts[0]})", Fraction(*atom.exponent))
        case "general_power":
            return f"({texts[0]})^({texts[1]})"
    return f"{atom.name}({texts[0]})"


def _text(terms: ExpandedTerms, atoms: list[str]) -> str:
    """Return a function of g2 as text."""
    names = _OF_G2 | {FIRST_ATOM_POSITION + number: f"({atom})" for number, atom in enumerate(atoms)}
    ordered = ((powers, terms[powers]) for powers in sorted(terms, reverse=True))
    return sum_text(
        term_text(value, *(power_text(names[p], powers[p]) for p in names)) for powers, value in ordered
    )


MAX_DEGREE = 12
PolynomialSum = Mapping[Exponents, Fraction]
"""Coefficients by the exponents of g1, g2, g3, none of them 0."""


def as_polynomial(potential: Potential) -> dict[Exponents, Fraction] | None:
    """Return V as a polynomial without g3², equal to it on the sphere and of the least degree.

    None if its formula is not a polynomial with rational coefficients as it
    stands, or has a degree beyond MAX_DEGREE.
    """
    try:
        expansion = expand(potential.tape)
    except NoClosedFormError:
        return None
    if expansion is None:
        return None
    polynomial: dict[Exponents, Fraction] = {}
    for (a, b, c, *others), coefficient in expansion.terms.items():
        is_natural = all(power.denominator == 1 and power >= 0 for power in (a, b, c))
        if any(others) or not is_natural or a + b + c > MAX_DEGREE:
            return None
        polynomial[a.numerator, b.numerator, c.numerator] = coefficient
    return on_sphere(polynomial)


def on_sphere(polynomial: PolynomialSum) -> dict[Exponents, Fraction]:
    """Return the polynomial with g3² replaced by 1 - g1² - g2² throughout: the normal form on the sphere."""
    terms: MonomialSum = {(*exponents, 0, ()): as_fmpq(value) for exponents, value in polynomial.items()}
    return {(i, j, k): as_fraction(value) for (i, j, k, *_), value in reduced(terms, SPHERE[2]).items()}


def homogeneous_on_sphere(polynomial: PolynomialSum) -> dict[Exponents, Fraction]:
    """Return the polynomial with all terms of the same parities brought to one degree, the least possible.

    Terms are multiplied by g1² + g2² + g3², which is 1 on the sphere.
    """
    total = on_sphere(polynomial)
    highest: dict[tuple[int, ...], int] = {}
    for exponents in total:
        parities = tuple(exponent % 2 for exponent in exponents)
        highest[parities] = max(highest.get(parities, 0), sum(exponents))
    for low in range(degree(total)):
        for i, j, k in [e for e in total if sum(e) == low < highest[e[0] % 2, e[1] % 2, e[2] % 2]]:
            coefficient = total.pop((i, j, k))
            raised = dict.fromkeys(((i + 2, j, k), (i, j + 2, k), (i, j, k + 2)), coefficient)
            total = weighted_sum(((Fraction(1), total), (Fraction(1), raised)))
    return total


def degree(polynomial: PolynomialSum) -> int:
    """Return the total degree, 0 for the polynomial 0."""
    return max((sum(exponents) for exponents in polynomial), default=0)


def product(left: PolynomialSum, right: PolynomialSum) -> dict[Exponents, Fraction]:
    """Return left · right."""
    return without_zeros(
        added_up(
            ((a + d, b + e, c + f), first * second)
            for (a, b, c), first in left.items()
            for (d, e, f), second in right.items()
        )
    )


def difference(left: PolynomialSum, right: PolynomialSum) -> dict[Exponents, Fraction]:
    """Return left - right."""
    return weighted_sum(((Fraction(1), left), (Fraction(-1), right)))


def quadratic(alpha: Fraction) -> dict[Exponents, Fraction]:
    """Return Q/C = α g1² + g3²."""
    return {(2, 0, 0): alpha, (0, 0, 2): Fraction(1)}
