"""Integrals that have names, on whatever axes of the body they lie, and named cases of the heavy body.

A candidate is a formula made for the body and the field; whether it is an integral there is proved by who
asks. Sources: Euler 1758, Lagrange 1788, Kovalevskaya 1889, Brun 1893, Goriachev 1900 and 1916, Chaplygin
1901 and 1903, see :mod:`service.dynamics.further_integrals`.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

from service.dynamics.body import RigidBody
from service.dynamics.discovery.functions import Functions, Quotient
from service.dynamics.discovery.setting import STATE, VELOCITIES
from service.dynamics.formula.parameters import MOMENTS
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import VARIABLES
from service.dynamics.identity_cache import IdentityCache
from service.dynamics.inverse.polynomials import as_polynomial
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.verdict.exact_ring.generators import NoProofError

IntegralName = Literal[
    "energy",
    "areas",
    "geometric",
    "euler",
    "lagrange",
    "spherical",
    "kovalevskaya",
    "chaplygin",
    "goriachev",
    "goriachev_chaplygin",
    "brun",
]


@dataclass(frozen=True, slots=True)
class Candidate:
    """A function that is an integral in some settings.

    ``text`` is a formula for it, up to a factor that is a number where the letters are.
    """

    name: IntegralName
    value: Quotient
    text: str


_ZERO, _HALF = Fraction(0), Fraction(1, 2)
_TEMPLATES: tuple[tuple[IntegralName, tuple[str, ...], int], ...] = (
    ("euler", ("A^2*p^2 + B^2*q^2 + C^2*r^2",), 1),
    ("lagrange", ("r",), 3),
    ("spherical", ("v1*p + v2*q + v3*r",), 1),
    ("kovalevskaya", ("p^2 - q^2 - (v1*g1 - v2*g2)/C", "2*p*q - (v1*g2 + v2*g1)/C"), 3),
    ("chaplygin", ("p^2 - q^2 + c1*g3^2/C", "2*p*q + c2*g3^2/C"), 3),
    (
        "goriachev",
        (
            "p^2 - q^2 - (v1*g1 - v2*g2)/C + c1*g3^2/C - b1*(g1^2 - g2^2)/(C*g3^2)",
            "2*p*q - (v1*g2 + v2*g1)/C + c2*g3^2/C - 2*b1*g1*g2/(C*g3^2)",
        ),
        3,
    ),
    ("goriachev_chaplygin", ("r*(p^2 + q^2 + b1/(2*C*g3^2)) - g3*(v1*p + v2*q)/C",), 3),
    ("brun", ("A^2*p^2 + B^2*q^2 + C^2*r^2 - mu*(B*C*g1^2 + C*A*g2^2 + A*B*g3^2)",), 1),
)
"""Names, parts with the coefficients of V in them, and the number of axes that may be the third one."""
_WITHOUT_FIELD = 2
"""The first templates, which have no coefficients in them."""


def candidates(field: Functions) -> Iterator[Candidate]:
    """Yield what may be an integral for the moments and the potential of the field, and is not too large."""
    setting = field.setting
    terms = _laurent_terms(field, field.value(setting.tape(setting.potential)))
    groups = (VELOCITIES, VARIABLES, MOMENTS)
    of_axes = dict(zip((*STATE, *MOMENTS), (*field.inputs[: len(STATE)], *field.moments()), strict=True))
    for name, parts, turns in _TEMPLATES if terms is not None else _TEMPLATES[:_WITHOUT_FIELD]:
        for turn in range(turns):
            turned = [of_axes[names[(place + turn) % 3]] for names in groups for place in range(3)]
            with suppress(NoProofError):
                found = _coefficients(field, terms or {}, turn)
                tapes = [compile_tape(parse(part), (*of_axes, *found)) for part in parts]
                values = [tape.evaluate(field, (*turned, *found.values())) for tape in tapes]
                total = values[0]
                if len(values) > 1:
                    first, second = (field.multiply(each, each) for each in values)
                    total = field.add(first, second)
                if total.numerator:
                    yield Candidate(name, total, _text(field, values))


def _text(field: Functions, parts: Sequence[Quotient]) -> str:
    """Return the sum of the squares of the parts, or the one part, times a denominator of letters."""
    common = field.ring.constant(1)
    for part in parts:
        if not any(int(degree) for degree in part.denominator.degrees()[: field.first_letter]):
            common = common * part.denominator / common.gcd(part.denominator)
    scale = Quotient(common, field.ring.constant(1))
    texts = [field.quotient_text(field.multiply(scale, part)) for part in parts]
    return texts[0] if len(texts) == 1 else " + ".join(f"({text})^2" for text in texts)


def _laurent_terms(field: Functions, V: Quotient) -> dict[tuple[int, int, int], Quotient] | None:
    """Return the coefficients of V by the exponents of g1, g2, g3; None if it is no Laurent polynomial."""
    content = V.denominator.term_content()
    shift = [int(k) for k in content.degrees()]
    places = [field.ring.variable_to_index(name) for name in VARIABLES]
    below = V.denominator / content
    if any(int(k) for k in below.degrees()[: field.first_letter]) or any(shift[: field.atoms]):
        return None
    parts: dict[tuple[int, int, int], dict[tuple[int, ...], int]] = {}
    for exponents, coefficient in V.numerator.terms():
        whole = [int(k) for k in exponents]
        if any(whole[: field.atoms]):
            return None
        key = (whole[places[0]], whole[places[1]], whole[places[2]])
        for place in places:
            whole[place] = 0
        parts.setdefault(key, {})[tuple(whole)] = int(coefficient)
    rest = V.denominator
    for place in places:
        if shift[place]:
            rest = rest / field.ring.gens()[place] ** shift[place]
    found: dict[tuple[int, int, int], Quotient] = {}
    for (i, j, k), terms in parts.items():
        exponents3 = (i - shift[places[0]], j - shift[places[1]], k - shift[places[2]])
        found[exponents3] = Quotient(field.ring.from_dict(terms), rest)
    return found


def _coefficients(
    field: Functions, terms: Mapping[tuple[int, int, int], Quotient], turn: int
) -> dict[str, Quotient]:
    """Return the coefficients of V that formulas have, with the axes turned."""
    zero = field.constant(_ZERO)

    def take(*exponents: int) -> Quotient:
        place = [0, 0, 0]
        for axis, exponent in enumerate(exponents):
            place[(axis + turn) % 3] = exponent
        return terms.get((place[0], place[1], place[2]), zero)

    squares = [take(*(2 * (axis == each) for each in range(3))) for axis in range(3)]
    moments = field.moments()
    difference = field.subtract(squares[0], squares[1])
    mu = zero
    for i, j in ((0, 1), (1, 2), (2, 0)) if turn == 0 else ():
        gap = field.subtract(moments[i], moments[j])
        if gap.numerator:
            twice = field.add(squares[i], squares[i])
            mu = field.divide(field.subtract(twice, field.add(squares[j], squares[j])), gap)
            break
    half = field.constant(_HALF)
    return {
        "v1": take(1, 0, 0),
        "v2": take(0, 1, 0),
        "v3": take(0, 0, 1),
        "c1": field.multiply(half, difference),
        "c2": field.multiply(half, take(1, 1, 0)),
        "b1": take(0, 0, -2),
        "mu": mu,
    }


MAX_INSTRUCTIONS = 100
"""Length of a formula that is looked at: a linear function is written shorter."""


@dataclass(frozen=True, slots=True)
class KnownCase:
    """A case by its name, and who found it."""

    name: str
    source: str


EULER = KnownCase("euler", "L. Euler, 1758")
LAGRANGE = KnownCase("lagrange", "J.-L. Lagrange, 1788")
KOVALEVSKAYA = KnownCase("kovalevskaya", "S. Kovalevskaya, 1889")
BOBYLEV_STEKLOV = KnownCase("bobylev_steklov", "D. K. Bobylev and V. A. Steklov, 1896")
GORIACHEV_CHAPLYGIN = KnownCase("goriachev_chaplygin", "D. N. Goriachev, 1900; S. A. Chaplygin, 1901")


def known_cases(body: RigidBody, potential: Potential) -> tuple[KnownCase, ...]:
    """Return the cases of a body in a linear field, however it is written, the earliest first.

    Conditions are met exactly. That of Bobylev and Steklov is about motions with q = 0; those that need
    B are not told where it was left out.
    """
    # The problems of a list have one potential, or few.
    centre = _LINEAR_PARTS(potential)
    if centre is None:
        return ()
    a, b, c = centre
    if not any(centre):
        return (EULER,)
    found: list[KnownCase] = []
    if (body.A == 2 * body.C and not (b or c)) or (body.C == 2 * body.A and not (a or b)):
        found.append(BOBYLEV_STEKLOV)
    moments = (body.A, body.A if body.B is None else body.B, body.C)
    for axis in range(3) if body.B is not None else ():
        i, j = (axis + 1) % 3, (axis + 2) % 3
        if moments[i] != moments[j]:
            continue
        if not (centre[i] or centre[j]):
            found.append(LAGRANGE)
        elif not centre[axis] and moments[i] in (2 * moments[axis], 4 * moments[axis]):
            found.append(KOVALEVSKAYA if moments[i] == 2 * moments[axis] else GORIACHEV_CHAPLYGIN)
    order = (LAGRANGE, KOVALEVSKAYA, BOBYLEV_STEKLOV, GORIACHEV_CHAPLYGIN)
    return tuple(case for case in order if case in found)


def _linear_part(potential: Potential) -> tuple[Fraction, Fraction, Fraction] | None:
    """Return a, b, c of V = a g1 + b g2 + c g3 plus a constant; None of another potential."""
    try:
        if len(potential.tape.instructions) > MAX_INSTRUCTIONS:
            return None
    except NoClosedFormError:
        return None
    polynomial = as_polynomial(potential)
    if polynomial is None or any(sum(exponents) > 1 for exponents in polynomial):
        return None
    zero = Fraction(0)
    return polynomial.get((1, 0, 0), zero), polynomial.get((0, 1, 0), zero), polynomial.get((0, 0, 1), zero)


_LINEAR_PARTS = IdentityCache(_linear_part)
