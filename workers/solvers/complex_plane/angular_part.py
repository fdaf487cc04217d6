r"""The angular part V1[F] along one curve as an analytic function, with a proven remainder.

With α > 1 and |g1| = G σ^α, |g3| = Z σ in primed axes, and a the client's A/C (α or 1/α), let
Λ = (α − 1) log σ and u = (G/Z)² e^{2Λ}. Then

.. math::

    V_1 = (1-a)\,T \int_{y_0}^{Y} F\bigl(w\bigr)\,\frac{e^y\,dy}{(a+e^y)^2}, \qquad
    \log w = (a-1)\log(|A-C|\rho) + a y + (1-a)\log(1+e^y),

with Y = ∓log u, ρ = Z² σ² (1 + u) and T = (α u + 1)/(1 + u), or (a + u)/(1 + u) where A < C. On
y = y0 + s (Y − y0) the integrand is holomorphic in s and Λ together wherever balls show that it is. Let it be
at most M for Λ on a disc about c of the radius R, and s on the ellipse about a panel, with its ends
for foci and half axes that add up to k of its halves. The rule of Gauss with N nodes then leaves a function
of Λ of at most (64/15) M k^(−2N)/(1 − k^(−2)) of half the panel (L. N. Trefethen, Is Gauss quadrature
better than Clenshaw-Curtis?, theorem 4.5), and what V1 leaves of its Taylor series, with M of its own, is at
most M qⁿ/(1 − q) for \|Λ − c\| ≤ q R. Singularities lie near u = −1: far from there discs are large.
"""

from bisect import bisect_left
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, lru_cache, reduce
from math import ceil, hypot, inf, isfinite, lcm, log
from typing import Generic, NamedTuple, TypeVar

from flint import acb, arb, arb_poly, arb_series, ctx

from service.dynamics.formula.algebra import Algebra, OperatorAlgebra
from service.dynamics.formula.algebras.ball import BallAlgebra, ComplexBallAlgebra, ball, series_of
from service.dynamics.formula.algebras.long_intervals import LongInterval, LongIntervalAlgebra
from service.dynamics.formula.algebras.power_sums import PowerAlgebra, PowerSum, Small
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.potentials.angular_part.balls import GENERIC_W, curve_ball
from service.dynamics.potentials.angular_part.field import AngularField
from service.dynamics.reduction.geometry.loop import Loop

Ball = TypeVar("Ball", arb, acb)
T = TypeVar("T")
_Panel = tuple[float, float, arb, bool]
"""The ends in s, the bound M, and whether y is beyond 0 there."""

LOST_BITS = 12
"""Bits that quotients of h − V lose next to a rest point."""
SPARE_BITS = 24
"""Bits by which sums of series are more precise than V1 is wanted."""
SHARE, KNOWN, OUTER = 0.36, 0.49, 0.65
"""Parts of the radius of a disc: on the reals its series serves up to the first, and has all bits up to the
second, where it takes the points of a circle whose double is within the third. No region reaches further."""
ELLIPSE_RHO = 3.0
"""k, the sum of the half axes of an ellipse about a panel, in halves of it."""
FIRST_PANEL_LENGTH = 8.0
"""Length of a panel in y, before it is halved."""
MOST_HALVINGS, MOST_PIECES, MOST_TERMS = 6, 96, 240
"""Motions that were seen to be answered have 11 to 53 pieces: to make many more would put off a refusal."""
MAX_OVERESTIMATE_BITS = 40.0
"""Bits by which a bound of V1 may be larger than it is: then smaller discs are cheaper."""
RADII = (1.7, 1.2, 0.8, 0.55, 0.35, 0.2, 0.1, 0.05)
"""Radii that are tried, in parts of the last one that served."""
FIRST_DISC_RADIUS = 1.0
MIN_DISC_RADIUS = 1e-3
"""Radii in y: of the first disc that is tried, and of the smallest."""


@dataclass(frozen=True, slots=True)
class _Piece:
    """V1 for |Λ − centre| < radius, as a series of (Λ − centre)/radius and two derivatives of it."""

    centre: float
    radius: float
    series: tuple[arb_poly, arb_poly, arb_poly]
    terms: int
    largest: arb
    """The bound M of |V1| on the disc."""
    error: arb
    """The bound of what quadratures leave on the disc, beside the coefficients' own radii."""

    def value(self, place: Ball, order: int) -> Ball:
        """Return V1, its first or its second derivative; not finite outside the disc."""
        y = (place - self.centre) / self.radius
        q = arb(abs(y).upper())
        if not q < OUTER:
            return y * arb.nan()
        n, rest = self.terms, 1 - q
        # Derivatives of M qⁿ/(1 − q), and of E/(1 − q).
        tail, error = [
            (q**n / rest, 1 / rest),
            (n * q ** (n - 1) / rest + q**n / rest**2, 1 / rest**2),
            (
                n * (n - 1) * q ** (n - 2) / rest + 2 * n * q ** (n - 1) / rest**2 + 2 * q**n / rest**3,
                2 / rest**3,
            ),
        ][order]
        off = arb(0, (self.largest * tail + self.error * error).abs_upper())
        value = self.series[order](y)
        return (value + (acb(off, off) if isinstance(value, acb) else off)) / self.radius**order


class AngularSeries:
    """V1 and its derivatives by Λ along the curve of a loop; pieces are made where they are asked for."""

    def __init__(self, loop: Loop, field: AngularField, bits: int) -> None:
        self._F, self._bits = field.F.tape, bits + LOST_BITS
        body, alpha = field.body, ball(loop.alpha)
        self._mirrored, self._gain = loop.mirrored, alpha - 1
        self._a = 1 / alpha if loop.mirrored else alpha
        self._log_size = ball(abs(body.A - body.C)).log() + 2 * loop.Z.log()
        self._log_ratio = 2 * (loop.G / loop.Z).log()
        self._start = 2 * field.angle().tan().log()
        places = (loop.Z, loop.G) if loop.mirrored else (loop.G, loop.Z)
        curve = curve_ball(body, *places)
        self._log_curve = curve.log()
        self.at_curve: arb = field.F.ball(curve, 0)[0]
        """F(w) on the curve, which is −h."""
        self._root = _root_of(self._F)
        self._pieces: list[_Piece] = []
        self._lefts: list[float] = []
        """−Λ where the series of each piece ends to serve, growing."""
        self._is_spent = False

    def value(self, log_sigma: Ball) -> Ball:
        """Return V1 where log |sin v| is this; not finite where it is not proven to be holomorphic."""
        return self._ask(self._gain * log_sigma, 0)

    def slope(self, log_sigma: Ball, cotangent: Ball) -> Ball:
        """Return dV1/dv from log |sin v| and cot v."""
        return self._ask(self._gain * log_sigma, 1) * (self._gain * cotangent)

    def curvature(self, log_sigma: Ball, cotangent: Ball) -> Ball:
        """Return d²V1/dv² from log |sin v| and cot v."""
        place, rate = self._gain * log_sigma, self._gain * cotangent
        bend = self._gain * (1 + cotangent * cotangent)
        return self._ask(place, 2) * rate * rate - self._ask(place, 1) * bend

    def about_pole(self, log_sigma: arb) -> arb:
        """Return the enclosure of V1 for all |sin v| up to this; not finite if F is not known to be bounded.

        There w goes from its value on the curve to 0 where A > C, and to ∞ else. What the integrand's other
        factor leaves is an exact integral.
        """
        a, sign = self._a, -1 if self._mirrored else 1
        place = self._gain * log_sigma
        at = self._on_region(acb(place))
        length = sign * self._end(float(place))
        if not 0.0 < length < inf:
            return arb.nan()
        steps = min(ceil(length), self._bits)
        u = arb(0).union((2 * place + self._log_ratio).exp())
        share = (a + u) / (1 + u) if self._mirrored else (1 + a * u) / (1 + u)
        total, left = arb(0), 1 / (a + self._start.exp())
        for k in range(1, steps):
            y = self._start + sign * k
            log_w = at.scale.real + a * y + (1 - a) * y.exp().log1p()
            right = 1 / (a + y.exp())
            total += self._range(sign * log_w, sign) * (left - right)
            left = right
        # Beyond, w is anything up to that of the curve, or from it on.
        rest = left if sign > 0 else left - 1 / a
        total += self._range(sign * self._log_curve, sign) * arb(0).union(rest)
        return (1 - a) * share * total

    def _range(self, log_x: arb, sign: int) -> arb:
        """Return the enclosure of F for all x = w^sign up to this; not finite if none is known."""
        # With x = 2 x₊ s, of which 0 < s ≤ 1/2; logarithms of s are less than any root of 1/s.
        algebra = LongIntervalAlgebra(arb(0), arb(0.5), Fraction(1, 2))
        size = 2 * log_x.exp()
        x = LongInterval(arb(size.lower()), arb(size.upper()), Fraction(1), 1)
        found = self._F.evaluate(algebra, (x if sign > 0 else algebra.power(x, Fraction(-1)),))
        whole = algebra.add(found, algebra.constant(Fraction(0)))
        bounded = whole.exponent == 0 and whole.is_bounded
        return whole.lo.union(whole.hi) if bounded else arb.nan()

    def _ask(self, place: Ball, order: int) -> Ball:
        x, y = (place.real, place.imag) if isinstance(place, acb) else (place, arb(0))
        middle, height = float(x.mid()), float(y.mid())
        index = self._index_at(middle) if isfinite(middle) and isfinite(height) else None
        if index is None:
            return place * arb.nan()
        # Away from the reals a neighbour may know it better.
        near = self._pieces[max(0, index - 1) : index + 2] if height else (self._pieces[index],)
        piece = min(near, key=lambda piece: hypot(middle - piece.centre, height) / piece.radius)
        return piece.value(place, order)

    def _index_at(self, place: float) -> int | None:
        while not self._lefts or -place > self._lefts[-1]:
            if self._is_spent or not self._extend():
                self._is_spent = True
                return None
        return bisect_left(self._lefts, -place)

    def _extend(self) -> bool:
        """Add a piece to the left of the last one; say whether one was found."""
        if len(self._pieces) >= MOST_PIECES:
            return False
        last = self._pieces[-1].radius if self._pieces else FIRST_DISC_RADIUS
        for radius in (last * share for share in RADII):
            if radius < MIN_DISC_RADIUS:
                break
            centre = -self._lefts[-1] - SHARE * radius if self._pieces else 0.0
            made = self._made(centre, radius)
            if made is not None:
                self._pieces.append(made)
                self._lefts.append(-(centre - SHARE * radius))
                return True
        return False

    def _made(self, centre: float, radius: float) -> _Piece | None:
        """Return the piece about a centre; None if no bound, or too rough a one, is found."""
        # The lower half of the disc, and of the ellipses, has the conjugate values.
        half = 0.5 * radius
        about = [self._on_region(acb(arb(centre + x * half, half), arb(half, half))) for x in (-1, 1)]
        size = abs(self.at_curve).upper() + arb(2) ** -self._bits
        wanted = size * arb(2) ** -self._bits
        factor = _largest((1 - self._a) * at.share for at in about)
        panels, largest = [], arb(0)
        length = self._end(centre)
        count = max(1, ceil(abs(length) / FIRST_PANEL_LENGTH))
        for k in range(count):
            found = self._bounded(about, length, k / count, (k + 1) / count, MOST_HALVINGS)
            if found is None:
                return None
            panels += found
            largest += sum((bound * (high - low) for low, high, bound, _ in found), arb(0))
        largest *= factor
        if not (factor.is_finite() and largest < size * arb(2) ** MAX_OVERESTIMATE_BITS):
            return None
        excess = float((largest / wanted).log().upper()) if largest > wanted else 1.0
        terms = max(8, ceil(excess / -log(KNOWN)))
        if terms > MOST_TERMS:
            return None
        with ctx.workprec(self._bits + SPARE_BITS), series_of(terms):
            here = self._as_series(centre, radius)
            total, error = arb_series([arb(0)]), arb(0)
            each = wanted / (factor.max(arb(1)) * (1 + len(panels)))
            for low, high, bound, is_beyond in panels:
                middle, width = (arb(low) + high) / 2, (arb(high) - low) / 2
                # The bound of what the rule of no nodes leaves.
                left = 2 * width * bound
                if not left < each:
                    spare = float((left / each).log().upper()) + 1.0
                    count = max(2, ceil(spare / (2.0 * log(ELLIPSE_RHO))))
                    left *= arb(32) / 15 * arb(ELLIPSE_RHO) ** (-2 * count) / (1 - arb(ELLIPSE_RHO) ** -2)
                    for node, weight in _rule(count, ctx.prec):
                        s = arb_series([middle + width * node])
                        total = total + here.value(s, is_beyond) * (weight * width)
                error += left
            series = total * here.share * (1 - self._a)
            first = arb_poly([series[k] for k in range(terms)])
            second = first.derivative()
            return _Piece(
                centre, radius, (first, second, second.derivative()), terms, largest, (error * factor).upper()
            )

    def _bounded(
        self, about: "Sequence[_Along[acb]]", length: float, low: float, high: float, halvings: int
    ) -> list[_Panel] | None:
        """Return the panel, or its parts, with bounds of the integrand on their ellipses."""
        half, middle = 0.5 * (high - low), 0.5 * (low + high)
        wide, tall = (0.5 * (ELLIPSE_RHO + sign / ELLIPSE_RHO) * half for sign in (1, -1))
        is_beyond = float(self._start) + middle * length > 0.0
        ellipse = acb(arb(middle, wide), arb(0, tall))
        largest = _largest(at.value(ellipse, is_beyond) for at in about)
        # A bound so rough takes more nodes than two panels.
        if largest < abs(self.at_curve).upper() * arb(2) ** (MAX_OVERESTIMATE_BITS / 2):
            return [(low, high, largest, is_beyond)]
        if not halvings:
            return None
        first = self._bounded(about, length, low, middle, halvings - 1)
        second = None if first is None else self._bounded(about, length, middle, high, halvings - 1)
        return None if first is None or second is None else first + second

    def _end(self, place: float) -> float:
        """Return Y − y0, about."""
        log_u = 2.0 * place + float(self._log_ratio)
        return (log_u if self._mirrored else -log_u) - float(self._start)

    def _along(self, algebra: Algebra[T], of: Callable[[arb], T], place: T) -> "_Along[T]":
        """Return the integrand as a function of s at a Λ, or about it."""
        a, start = of(self._a), of(self._start)
        known = place, of(self._log_ratio), of(self._log_size), of(self._gain), a, start
        forms = _forms(self._mirrored, self._root)
        scale, share, way, bend = (form.evaluate(algebra, known) for form in forms.along)
        return _Along(
            algebra, self._F, self._root, forms, scale, share, way, bend, of(self._log_curve), a, start
        )

    def _on_region(self, place: acb) -> "_Along[acb]":
        return self._along(ComplexBallAlgebra(analytic=True), acb, place)

    def _as_series(self, centre: float, radius: float) -> "_Along[arb_series]":
        return self._along(
            _SERIES, lambda number: arb_series([number]), arb_series([arb(centre), arb(radius)])
        )


class _Forms(NamedTuple):
    """Formulas of the integrand."""

    along: tuple[Tape, Tape, Tape, Tape]
    """The parts of log w without what y gives to it, T, Y − y0, and what the end gives to log w."""
    before: tuple[Tape, Tape]
    """Bounds of the logarithm of a root of w and of (Y − y0) e^y/(a + e^y)², for y up to 0."""
    beyond: tuple[Tape, Tape]
    """The same for other y."""


@cache
def _forms(mirrored: bool, root: int) -> _Forms:
    u = "exp(2*place + ratio)"
    scale = f"(a - 1)*(size + 2*place/gain + log(1 + {u}))"
    share = f"(a + {u})/(1 + {u})" if mirrored else f"(1 + a*{u})/(1 + {u})"
    way = f"{'' if mirrored else '-'}(2*place + ratio) - start"
    along = [scale, share, way, f"(1 - a)*log(1 + {u})"]
    before = ["a*y + scale + (1 - a)*log(1 + exp(y))", "way*exp(y)/(a + exp(y))^2"]
    beyond = ["y + scale + (1 - a)*log(1 + exp(-y))", "way*exp(-y)/(1 + a*exp(-y))^2"]
    # From the curve's w on, which is the same at every Λ, balls of regions stay narrow.
    if mirrored:
        before[0] = "curve - a*(1 - s)*way + (1 - a)*log(1 + exp(y)) - bend"
    else:
        beyond[0] = "curve - (1 - s)*way + (1 - a)*log(1 + exp(-y)) - bend"
    for form in (before, beyond):
        form[0] = f"({form[0]})/{root}"
    first, second, third, fourth = (compile_tape(parse(text), _OF_PLACE) for text in along)
    early, late = (tuple(compile_tape(parse(text), _OF_Y) for text in form) for form in (before, beyond))
    return _Forms((first, second, third, fourth), (early[0], early[1]), (late[0], late[1]))


_OF_PLACE = ("place", "ratio", "size", "gain", "a", "start")
_OF_Y = ("y", "s", "scale", "way", "bend", "curve", "a")


class _Sheets(PowerAlgebra[T]):
    """Functions of w from the logarithm of a root of it: powers and log w go on all round w = 0."""

    def __init__(self, base: Algebra[T], log_root: T, root: int) -> None:
        super().__init__(base, Small(base.call("exp", log_root), root, 1))
        self._log = base.multiply(base.constant(Fraction(root)), log_root)

    def call(self, name: str, argument: PowerSum[T]) -> PowerSum[T]:
        """Return the function; of one power of w the logarithm, which its value does not tell."""
        if name != "log" or len(argument.terms) != 1:
            return super().call(name, argument)
        ((exponent, _), factor), *_ = argument.terms.items()
        first = self._base.call("log", self._plain(factor))
        return self.of(self._base.add(first, self._base.multiply(self._base.constant(exponent), self._log)))


@dataclass(frozen=True, slots=True)
class _Along(Generic[T]):
    """(Y − y0) F(w) e^y/(a + e^y)² as a function of s, at one Λ or about it."""

    algebra: Algebra[T]
    F: Tape
    root: int
    forms: _Forms
    scale: T
    share: T
    """T."""
    way: T
    """Y − y0."""
    bend: T
    curve: T
    a: T
    start: T

    def value(self, s: T, is_beyond: bool) -> T:
        """Return the integrand, by formulas for small y or for large ones."""
        log_root = self._form(0, s, is_beyond)
        algebra = _Sheets(self.algebra, log_root, self.root)
        F = algebra.value(self.F.evaluate(algebra, (PowerSum({(Fraction(1), 0): Fraction(1)}),)))
        return self.algebra.multiply(F, self._form(1, s, is_beyond))

    def _form(self, number: int, s: T, is_beyond: bool) -> T:
        form = (self.forms.beyond if is_beyond else self.forms.before)[number]
        y = self.algebra.add(self.start, self.algebra.multiply(self.way, s))
        return form.evaluate(self.algebra, (y, s, self.scale, self.way, self.bend, self.curve, self.a))


def _largest(values: Iterable[acb]) -> arb:
    """Return a bound of all values; NaN if one of them is not finite."""
    return reduce(arb.max, (arb(abs(value).upper()) for value in values))


class _SeriesOfBalls(OperatorAlgebra[arb_series]):
    """The algebra of flint's power series of real balls, the first coefficient being the value."""

    def constant(self, value: Fraction) -> arb_series:
        """Return an exact number."""
        return arb_series([ball(value)])

    def pi(self) -> arb_series:
        """Return π."""
        return arb_series([arb.pi()])

    def divide(self, left: arb_series, right: arb_series) -> arb_series:
        """Return left / right."""
        return left * _NONE if right[0].contains(0) else left / right

    def power(self, base: arb_series, exponent: Fraction) -> arb_series:
        """Return base^exponent."""
        numerator, denominator = exponent.as_integer_ratio()
        if denominator != 1:
            return self.general_power(base, self.constant(exponent))
        if numerator >= 0:
            return base**numerator
        return self.divide(self.constant(Fraction(1)), base**-numerator)

    def general_power(self, base: arb_series, exponent: arb_series) -> arb_series:
        """Return exp(exponent · log(base))."""
        return (exponent * self.call("log", base)).exp()

    def call(self, name: str, argument: arb_series) -> arb_series:
        """Return the function; of what may be 0 no logarithm, absolute value or sign."""
        first = argument[0]
        match name:
            case "log":
                return argument.log() if first > 0 else argument * _NONE
            case "abs":
                return argument if first > 0 else -argument if first < 0 else argument * _NONE
            case "sign":
                return arb_series([first.sgn()]) if first > 0 or first < 0 else argument * _NONE
        found: arb_series = getattr(argument, name)()
        return found


_SERIES, _NONE = _SeriesOfBalls(), arb.nan()


@lru_cache(maxsize=64)
def _rule(count: int, precision: int) -> tuple[tuple[arb, arb], ...]:
    """Return the nodes and weights of Gauss on [−1, 1]."""
    with ctx.workprec(precision):
        return tuple(arb.legendre_p_root(count, k, weight=True) for k in range(count))


def _root_of(tape: Tape) -> int:
    """Return the least n in which all powers of w in F are whole powers of w^(1/n)."""
    base = BallAlgebra()
    algebra = PowerAlgebra(base, Small(base.constant(GENERIC_W), 1, 1))
    algebra.value(tape.evaluate(algebra, (PowerSum({(Fraction(1), 0): Fraction(1)}),)))
    return lcm(1, *(exponent.denominator for exponent, _ in algebra.powers))
