"""The parts of a case: conditions, parameters, relations, sources, and its reduced motion on a closed curve.

The periodic cases share one reduced form: x' = rate · u · v with u² = U(x), v² = V(x). The state is a
rational function of x, u and v. Nothing here takes a square root, so that one set of formulas serves balls,
doubles, and proofs in a ring of polynomials. Times and angular velocities are in the case's own scale, and
the components of γ are taken by T = |centre| γ: the first moment is 1, and the length of T is what |centre|
then is. A motion of any |centre| follows by changing the unit of time.

In cases with the centre on the first axis and q² = Q(p), r² = R(p), Q and R determine the rest. With A = 1,
β = B − C and |centre| γ = T,

    T1 = h − (p² + B Q + C R)/2,   T2 = q ((1−B) p − C β R'/2),   T3 = r ((1−C) p + B β Q'/2),   p' = β q r.

The closed curve is x = middle − half · cos θ, with θ growing for ever; its ends are two zeros of the rate.
U and V are divided by what vanishes at the ends, so that no difference of near numbers is formed there:
θ' = rate · sqrt(U~ V~) with U~, V~ > 0 on the whole interval.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise
from typing import Any, Literal, TypeAlias

from flint import acb_poly, arb, ctx, fmpq_poly

from service.dynamics.errors import NearSeparatrixError
from service.dynamics.formula.algebras.ball import ball


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
CASE_BITS = 512
"""Precision of the numbers of a case: 154 digits, of which roots and quotients lose some."""
ROOT_BITS = 476
"""Bits to which the ends are known."""
PERIOD_RELATIVE_CHANGE = arb(2) ** -100
"""Change of the period, relative, at which its sum has converged."""
MAX_NODES = 2**11
"""Largest number of nodes of the sum; a motion so close to a separatrix is not computed."""


@dataclass(frozen=True, slots=True)
class ReducedLoop:
    """A reduced motion with its ends: which of u, v vanishes at each, and what is left of U and V."""

    reduced: Reduced
    lower: arb
    upper: arb
    ends: tuple[str, str]
    U: Coefficients
    V: Coefficients

    @property
    def turns(self) -> int:
        """Turns of θ after which all variables are the same again."""
        return 1 if self.ends[0] == self.ends[1] else 2

    def x(self, theta: arb) -> arb:
        """Return the coordinate."""
        half = (self.upper - self.lower) / 2
        return (self.upper + self.lower) / 2 - half * theta.cos()

    def rate(self, theta: arb) -> Number:
        """Return θ', in the unit of time of the reduced motion."""
        x = self.x(theta)
        return abs(self.reduced.rate) * (value(self.U, x) * value(self.V, x)).sqrt()

    def factors(self, theta: arb) -> tuple[Number, Number]:
        """Return u and v; with both signs so that x' is u v times the rate."""
        x, width = self.x(theta), self.upper - self.lower
        forward = 1 if self.reduced.rate > 0 else -1
        u, v = value(self.U, x).sqrt(), value(self.V, x).sqrt()
        match self.ends:
            case ("u", "u"):
                return forward * width / 2 * theta.sin() * u, v
            case ("v", "v"):
                return u, forward * width / 2 * theta.sin() * v
        near, far = width.sqrt() * (theta / 2).sin(), width.sqrt() * (theta / 2).cos()
        return (forward * near * u, far * v) if self.ends[0] == "u" else (far * u, forward * near * v)

    def state(self, theta: arb) -> State:
        """Return p, q, r, T1, T2, T3."""
        u, v = self.factors(theta)
        return self.reduced.state(self.reduced.constants, self.x(theta), u, v)

    def strength(self) -> Number:
        """Return |T|, which is the same everywhere."""
        *_, T1, T2, T3 = self.state(arb(1))
        return (T1 * T1 + T2 * T2 + T3 * T3).sqrt()

    def times(self) -> tuple[list[arb], arb]:
        """Return dt/dθ at equidistant θ from 0 to 2π, the latter left out, and the error of their mean.

        The mean converges geometrically: nodes are doubled until it has settled.

        Raises
        ------
        NearSeparatrixError
            It has not with as many as there may be.
        """
        count, before, values = 16, None, dict[Fraction, arb]()
        while True:
            places = [Fraction(k, count) for k in range(count // 2 + 1)]
            for place in places:
                if place not in values:
                    values[place] = 1 / self.rate(2 * arb.pi() * ball(place))
            first = [values[place] for place in places]
            series = first + first[-2:0:-1]
            mean = sum(series, arb(0)) / count
            if before is not None:
                change = abs(mean - before)
                if change < PERIOD_RELATIVE_CHANGE * mean:
                    return series, arb(change.abs_upper())
                if count >= MAX_NODES:
                    raise NearSeparatrixError(
                        f"the motion is so close to a separatrix that {MAX_NODES} nodes do not give its "
                        'period; accepted is the method "integration", with times',
                        pointer="/motion",
                    )
            before, count = mean, 2 * count


def loops(reduced: Reduced) -> Iterator[ReducedLoop]:
    """Yield every bounded motion of the reduced form, by growing x."""
    with ctx.workprec(CASE_BITS):
        roots = sorted(
            [(root, "u") for root in _real_roots(reduced.U)]
            + [(root, "v") for root in _real_roots(reduced.V)],
            key=lambda pair: float(pair[0]),
        )
        for (lower, first), (upper, last) in pairwise(roots):
            between = (lower + upper) / 2
            if not (lower < upper and value(reduced.U, between) > 0 and value(reduced.V, between) > 0):
                continue
            U, V = reduced.U, reduced.V
            U = divided(U, lower) if first == "u" else U
            V = divided(V, lower) if first == "v" else V
            U = tuple(-c for c in divided(U, upper)) if last == "u" else U
            V = tuple(-c for c in divided(V, upper)) if last == "v" else V
            yield ReducedLoop(reduced, lower, upper, (first, last), U, V)


def _real_roots(coefficients: Coefficients) -> list[arb]:
    """Return the simple real roots; roots in pairs that cannot be told apart are none."""
    if len(coefficients) < 2:
        return []
    try:
        found = acb_poly([arb(c) for c in coefficients]).roots(
            tol=arb(2) ** -ROOT_BITS, maxprec=4 * CASE_BITS
        )
    except ValueError:
        # Two roots that are one, or nearly: a separatrix or an equilibrium, which no motion goes round.
        return []
    # Isolated balls: one that meets the real axis holds a root and no other, hence not its conjugate.
    return [root.real for root in found if root.imag.contains(0)]
