"""The parts of a case: conditions on body and centre, free parameters, relations, reduced motion, sources.

The periodic cases share one reduced form: x' = rate · u · v with u² = U(x), v² = V(x). The state is a
rational function of x, u and v. Nothing here takes a square root, so that one set of formulas serves balls,
doubles, and proofs in a ring of polynomials. Times and angular velocities are in the case's own scale, and
the components of γ are taken by T = |centre| γ: the first moment is 1, and the length of T is what |centre|
then is. A motion of any |centre| follows by changing the unit of time.

In cases with the centre on the first axis and q² = Q(p), r² = R(p), Q and R determine the rest. With A = 1,
β = B − C and |centre| γ = T,

    T1 = h − (p² + B Q + C R)/2,   T2 = q ((1−B) p − C β R'/2),   T3 = r ((1−C) p + B β Q'/2),   p' = β q r.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from flint import arb, fmpq_poly


def real_roots(polynomial: fmpq_poly) -> list[arb]:
    """Return the real roots in growing order, to the bits of the context."""
    found = list[arb]()
    # For rational roots the library gives multiplicities beside them too.
    for pair in polynomial.complex_roots():
        root, _ = tuple(pair)  # type: ignore[arg-type,var-annotated]
        if root.imag == 0:
            found.append(root.real)
    return sorted(found, key=float)


Number: TypeAlias = Any
"""Balls as a rule; also doubles, arrays of them, rationals, polynomials: what can be added and multiplied."""
Coefficients = tuple[Number, ...]
"""Coefficients of a polynomial, that of degree 0 first."""
Constants = Mapping[str, Number]
State = tuple[Number, Number, Number, Number, Number, Number]
"""p, q, r, T1, T2, T3."""
Relations = Mapping[str, Number]
"""Expressions that vanish on the case, by a name for people."""


@dataclass(frozen=True, slots=True)
class Reduced:
    """A reduced motion: polynomials, rate, and the state as a function of (constants, x, u, v)."""

    U: Coefficients
    V: Coefficients
    rate: Number
    constants: Constants
    state: Callable[[Constants, Number, Number, Number], State]
    relations: Callable[[Constants, State], Relations]

    def converted(self, convert: Callable[[Number], Number]) -> "Reduced":
        """Return the same with other numbers."""
        constants = {
            name: tuple(map(convert, value)) if isinstance(value, tuple) else convert(value)
            for name, value in self.constants.items()
        }
        U, V = tuple(map(convert, self.U)), tuple(map(convert, self.V))
        return Reduced(U, V, convert(self.rate), constants, self.state, self.relations)


def value(coefficients: Coefficients, x: Number) -> Number:
    """Return the value of a polynomial at x."""
    total = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        total = total * x + coefficient
    return total


def derivative(coefficients: Coefficients) -> Coefficients:
    """Return the coefficients of the derivative; that of a constant is 0."""
    return tuple(k * c for k, c in enumerate(coefficients) if k) or (0 * coefficients[0],)


def divided(coefficients: Coefficients, root: Number) -> Coefficients:
    """Return the quotient of a polynomial by (x − root); the remainder is dropped."""
    quotient, carry = list[Number](), 0 * root
    for coefficient in reversed(coefficients[1:]):
        carry = carry * root + coefficient
        quotient.append(carry)
    return tuple(reversed(quotient))


def master(B: Number, C: Number, Q: Coefficients, R: Coefficients, h: Number) -> Reduced:
    """Return the reduced motion with x = p, u = q, v = r."""
    constants = {"B": B, "C": C, "h": h, "Q": Q, "R": R, "dQ": derivative(Q), "dR": derivative(R)}
    return Reduced(Q, R, B - C, constants, _state, _relations)


def _state(k: Constants, p: Number, q: Number, r: Number) -> State:
    B, C = k["B"], k["C"]
    beta = B - C
    T1 = k["h"] - (p * p + B * value(k["Q"], p) + C * value(k["R"], p)) / 2
    T2 = q * ((1 - B) * p - C * beta * value(k["dR"], p) / 2)
    T3 = r * ((1 - C) * p + B * beta * value(k["dQ"], p) / 2)
    return p, q, r, T1, T2, T3


def _relations(k: Constants, state: State) -> Relations:
    p, q, r, T1, T2, T3 = state
    _, _, _, S1, S2, S3 = _state(k, p, q, r)
    return {
        "q^2 - Q(p)": q * q - value(k["Q"], p),
        "r^2 - R(p)": r * r - value(k["R"], p),
        "gamma along the centre": T1 - S1,
        "gamma along the second axis": T2 - S2,
        "gamma along the third axis": T3 - S3,
    }


CentrePlace = Literal["axis", "plane", "any"]
"""On a principal axis; in a principal plane and on no axis; anywhere."""
Form = Literal["loop", "steady", "hess"]
"""One coordinate between two zeros of its rate; a steady rotation; a momentum that never closes."""
Source = Literal["proved", "attribution", "candidate"]
"""``proved``: formulas and name are beyond doubt; ``attribution``: the formulas are proved, the name is
that of the case they look like; ``candidate``: the formulas are proved, who was the first is not known."""
Condition = Callable[[Number, Number, Number, Number, Number], Number]
"""A polynomial in A, B, C, and the components a and c of the centre, zero for bodies of the case."""
Ratios = Callable[[], tuple[tuple[arb, arb], ...]]
"""B/A and C/A of the only bodies of the case."""


@dataclass(frozen=True, slots=True)
class About:
    """The description of a case in a catalogue, for people."""

    title: str
    author: str
    year: int | None
    conditions: tuple[str, ...]
    real: str
    """The bodies and parameters for which there is a motion, in one order of the axes; any other is
    accepted."""
    relations: tuple[str, ...]
    functions: str
    stability: str
    source: Source


@dataclass(frozen=True, slots=True)
class Setting:
    """Body and centre in the order of axes of the case, with A = 1; centre (a, 0, c), a > 0, c ≥ 0."""

    B: arb
    C: arb
    a: arb
    c: arb
    parameters: Mapping[str, arb] = field(default_factory=dict)

    @property
    def strength(self) -> arb:
        """The distance of the centre."""
        return (self.a * self.a + self.c * self.c).sqrt()

    @property
    def ex(self) -> arb:
        """The first component of the direction of the centre."""
        return self.a / self.strength

    @property
    def ez(self) -> arb:
        """The third component of the direction of the centre."""
        return self.c / self.strength


@dataclass(frozen=True, slots=True)
class ClassicalCase:
    """A case of the catalogue."""

    name: str
    centre: CentrePlace
    condition: Condition | None
    """None if the moments are free, or given by ``ratios``."""
    example: Mapping[str, object]
    """Moments, centre and parameters of a motion."""
    about: About
    reduce: Callable[[Setting], Reduced] | None = None
    """The motion between two ends; None for other forms."""
    ratios: Ratios | None = None
    parameters: Mapping[str, str] = field(default_factory=dict)
    """Free parameters beside signs and phase, and their real ranges."""
    form: Form = "loop"
    solutions: int = 1
    """Bodies among which a field of the motion chooses."""
    is_scaled: bool = True
    """The motion is reduced in a unit of time of its own, and fitted to the centre."""
    is_descending: bool = False
    """Its axes are taken so that A > B > C."""

    @property
    def solved(self) -> int:
        """The moment that follows from the other two: the second in a plane, else the third."""
        return 1 if self.centre == "plane" else 2

    @property
    def fields(self) -> dict[str, str]:
        """The fields of a motion document that the case takes, with what they mean."""
        own = dict(self.parameters)
        if self.form == "loop":
            own |= {"phase": PHASE}
            own |= {} if self.name == "bobylev_steklov" else {"direction": DIRECTION}
            own |= {"sign": SIGN} if self.centre == "axis" else {}
        if self.solutions > 1:
            own |= {"solution": "1 or 2: which of the bodies, if more than one moment is left out"}
        return own


PHASE = (
    "where on its closed curve the motion is at time 0, 0 to 1: a share of the angle in which the coordinate"
    " of the curve is a cosine; 0 if left out"
)
DIRECTION = "-1 for the motion backwards in time; 1 if left out"
SIGN = "-1 for the motion turned by half a turn about the axis of the centre; 1 if left out"
