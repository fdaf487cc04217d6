r"""The angular part V1[F] along one curve, by series: estimates, for a hundredth of the price of integrals.

On the curve V1 is a function of σ, with |g1| = G σ^α and |g3| = Z σ where A > C, and with α = C/A and the two
exchanged where A < C. Next to a pole, σ = 0, it is a sum of powers of σ^(2(α − 1)), of σ², and of these times
log σ. In x = σ^(1/n) they are as smooth as n is large, and on pieces of 0 ≤ x ≤ 1 V1 is a Chebyshev series.
What that leaves out is estimated from its last terms and seen between its nodes; it is no theorem.
"""

from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from math import ceil

from flint import arb, arb_mat, ctx

from service.dynamics.formula.algebras.ball import ball
from service.dynamics.potentials.angular_part.balls import angular_balls, curve_ball
from service.dynamics.potentials.angular_part.field import AngularField, AngularJet

LEAST_SMOOTH_EXPONENT = 16
"""Least exponent of x that is not whole, or goes with a logarithm: coefficients fall like k^-33 there."""
SERIES_NODES = 40
TAIL_TERMS, TAIL_FACTOR = 4, 4
"""Number of the last coefficients of a series; how many times their sum what it leaves out may add up to."""
CHECKED_POINTS = (Fraction(-7, 10), Fraction(3, 10))
"""Places in a piece, none a node, where a series is compared with the integral."""
UNSEEN_DEPARTURE_FACTOR = 4
"""Largest departure between the places that are looked at, in parts of the largest departure at them."""
SHORTEST_PIECE = 2.0**-10
"""Length of pieces, in parts of those at first, that are not halved: there V1 stays an integral."""
SERIES_BITS, SPARE_BITS = 80, 20
"""Bits to which a series is wanted, and by how many more its integrals are computed."""


def smooth_unit(alpha: Fraction) -> int:
    """Return n for α > 1: all powers of x = σ^(1/n) are whole, or at least LEAST_SMOOTH_EXPONENT."""
    return alpha.denominator * ceil(LEAST_SMOOTH_EXPONENT / (2 * (alpha - 1) * alpha.denominator))


@dataclass(frozen=True, slots=True)
class LoopCurve:
    """A curve in primed axes: those of the body, g1 and g3 exchanged if it is mirrored, so that α > 1."""

    alpha: Fraction
    Z: arb
    G: arb
    mirrored: bool

    def gamma(self, log_sigma: arb) -> tuple[arb, arb]:
        """Return |g1| and |g3| in the client's axes."""
        first = self.G * (ball(self.alpha) * log_sigma).exp()
        third = self.Z * log_sigma.exp()
        return (third, first) if self.mirrored else (first, third)

    def log_sigma(self, g1: arb, g3: arb) -> arb:
        """Return log σ; not finite where σ may be 0."""
        return (abs(g1 if self.mirrored else g3) / self.Z).log()


Piece = tuple[float, float]


@dataclass(frozen=True, slots=True)
class CurveField(AngularField):
    """V1[F] at places of one curve: without derivatives by series, which are made where they are needed."""

    curve: LoopCurve = field(compare=False)
    pieces: dict[Piece, "tuple[arb, ...] | None"] = field(
        default_factory=dict, init=False, compare=False, repr=False
    )
    """The coefficients, the error being in the first; None where there is no series."""

    def ball(self, g1: arb, g3: arb, order: int) -> "AngularJet[arb]":
        """See AngularField.ball; the ball of V1 without derivatives is an estimate."""
        log_x = self.curve.log_sigma(g1, g3) / smooth_unit(self.curve.alpha)
        found = self._series_at(float(log_x.exp())) if order == 0 and log_x.is_finite() else None
        if found is None:
            return AngularField.ball(self, g1, g3, order)
        (left, right), series = found
        value = _sum(series, (2 * log_x.exp() - left - right) / (arb(right) - left))
        return self.jet(g1, g3, self.F.ball(curve_ball(self.body, g1, g3), 0), (value,))

    def _series_at(self, x: float) -> tuple[Piece, tuple[arb, ...]] | None:
        whole = _whole_pieces(smooth_unit(self.curve.alpha))
        left, right = next((piece for piece in whole if x <= piece[1]), whole[-1])
        least = SHORTEST_PIECE * (right - left)
        while right - left > least:
            if (left, right) not in self.pieces:
                self.pieces[left, right] = self._series(left, right)
            series = self.pieces[left, right]
            if series is not None:
                return (left, right), series
            middle = 0.5 * (left + right)
            left, right = (left, middle) if x <= middle else (middle, right)
        return None

    def _series(self, left: float, right: float) -> tuple[arb, ...] | None:
        """Return the series on a piece; None if it does not fall fast enough."""
        middle, half = (arb(left) + right) / 2, (arb(right) - left) / 2
        n = smooth_unit(self.curve.alpha)

        def integral(y: arb) -> arb:
            place = self.curve.gamma(n * (middle + half * y).log())
            return angular_balls(self.body, self.F, 0, *place, self.angle())[0]

        with ctx.workprec(SERIES_BITS + SPARE_BITS):
            nodes, transform = _rule(ctx.prec)
            found = (transform * arb_mat([[integral(y)] for y in nodes])).entries()
            # Radii would grow by 1 + √2 for each coefficient of a sum.
            series = tuple(value.mid() for value in found)
            tail = sum(map(abs, series[-TAIL_TERMS:]), arb(0))
            # V1 is wanted to the accuracy of F, to which it is added.
            w = curve_ball(self.body, *self.curve.gamma(arb(0)))
            size = max(map(abs, series)) + abs(self.F.ball(w, 0)[0])
            if not tail <= size * arb(2) ** -SERIES_BITS:
                return None
            apart = max(abs(_sum(series, y) - integral(y)).upper() for y in map(ball, CHECKED_POINTS))
            error = sum(
                (value.rad() for value in found), TAIL_FACTOR * tail + UNSEEN_DEPARTURE_FACTOR * apart
            )
        return series[0] + arb(0, error.upper()), *series[1:]


@lru_cache(maxsize=8)
def _whole_pieces(n: int) -> tuple[Piece, ...]:
    """Return the pieces of 0 ≤ x ≤ 1 before any is halved, for x = σ^(1/n)."""
    marks = [1.0]
    # About twice as far in the logarithm of σ each time.
    while marks[0] > 0.5:
        marks.insert(0, 2.0 ** -(2.0 * (2 ** len(marks) - 1) / n))
    return tuple(pairwise([0.0, *marks]))


@lru_cache(maxsize=8)
def _rule(precision: int) -> tuple[tuple[arb, ...], arb_mat]:
    """Return the zeros of T_N, N = SERIES_NODES, and the matrix from values there to coefficients."""
    with ctx.workprec(precision):
        cosines = [(arb(k) / (2 * SERIES_NODES)).cos_pi() for k in range(4 * SERIES_NODES)]
        table = [
            [
                cosines[k * (2 * j + 1) % (4 * SERIES_NODES)] * (2 if k else 1) / SERIES_NODES
                for j in range(SERIES_NODES)
            ]
            for k in range(SERIES_NODES)
        ]
        return tuple(cosines[1 : 2 * SERIES_NODES : 2]), arb_mat(table)


def _sum(series: tuple[arb, ...], y: arb) -> arb:
    """Return a Chebyshev series at y, by Clenshaw's recurrence."""
    first, second, twice = arb(0), arb(0), 2 * y
    for value in series[:0:-1]:
        first, second = twice * first - second + value, first
    return series[0] + y * first - second
