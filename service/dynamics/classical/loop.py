"""The closed curve of a reduced motion: x = middle − half · cos θ, with θ growing for ever.

The ends are two zeros of its rate.

U and V are divided by what vanishes at the ends, so that no difference of near numbers is formed there:
θ' = rate · sqrt(U~ V~) with U~, V~ > 0 on the whole interval.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

from flint import acb_poly, arb, ctx

from service.dynamics.classical.errors import NearSeparatrixError
from service.dynamics.classical.protocol import Coefficients, Number, Reduced, State, divided, value
from service.dynamics.formula.algebras.ball import ball

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
