r"""Numbers of a motion as analytic functions of unknown numbers, bounded on a polydisc.

A libration between v₋ and v₊ at the middle of the polydisc takes, for any other numbers, the time

.. math:: T = \int_0^{2\pi} \frac{Z\, r \sin\theta}{c \sqrt{W N}}\,d\theta,
   \qquad v = m - r\cos\theta,

along a line Im θ = η > 0: a curve round both ends, wherever they move inside it. Where N does not vanish on
the line, T is analytic, and 2π times the mean integrand bounds it: by Cauchy's estimates that bounds its
derivatives. At real numbers it is the period of that window as long as the window is there (identity
theorem); so where the function has no solution, the window has none. Its values at points come from the
certified solver.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil, inf, log

from flint import acb, arb

from service.dynamics.formula.algebras.ball import ball
from workers.solvers.certified.by_integral import IntegralMotion
from workers.solvers.errors import PrecisionNeededError
from workers.solvers.searches.family import (
    FamilyCurve,
    ProblemFamily,
    enclosed_zero,
    near_zero,
    reciprocal_root,
)

LINES = (0.7, 0.4)
"""Shares of the height of the strip, where the time at the middle is proved to be analytic, that η has."""
COARSE_BITS = 34
"""Bits of values on the way."""
STRIPS = (0.5, 0.2, 0.08)
"""Half widths of the strips that are tried about a whole turn."""
CELLS, MOST_CELLS = 16, 512
"""Cells of a half turn at first, and at most."""
MAX_CELL_RADIUS = 1.0
"""A cell is cut while its radius is a larger share of it than this."""
SUM_ROUNDING = 1e-12
"""Relative rounding of a sum of all cells in doubles, at most."""
DIFFERENCE_STEP_SHARE = Fraction(1, 2**9)
"""Derivatives are differences of values at so small a share of the radius."""

Numbers = Sequence[Fraction]
Value = Callable[[Numbers, int], arb]
"""Encloses the function at a point, to about so many bits."""
Rate = Callable[[FamilyCurve, acb], acb]
"""Returns what is integrated along v; not finite where it is not analytic on the ball."""
MotionAt = Callable[[Numbers, tuple[arb, arb], int], IntegralMotion]
"""Returns the certified motion at a point, between such ends."""


@dataclass(frozen=True, slots=True)
class FamilyWindow:
    """A window: where its ends are, about; None for a whole loop."""

    side: int
    """The sign of sin v on it, 0 where it passes poles."""
    ends: tuple[arb, arb] | None
    index: int


@dataclass(frozen=True, slots=True)
class Slopes:
    """A value with its derivatives at a point, and a bound M on a polydisc about it."""

    value: arb
    gradient: tuple[arb, ...]
    squares: tuple[arb, ...]
    """Halves of the pure second derivatives."""
    mixed: arb
    """The mixed second derivative of two unknowns; 0 of one."""
    bound: arb
    radii: tuple[arb, ...]

    def range_on(self, half: Sequence[arb]) -> arb:
        """Return an enclosure of all values on the box with these half widths about the point."""
        shares, product = self._shares(half)
        rest = product - 1 - sum(shares, arb(0)) - sum((q * q for q in shares), arb(0))
        left_out = self.bound * rest
        if len(half) > 1:
            left_out += (abs(self.mixed) - self.bound / (self.radii[0] * self.radii[1])) * half[0] * half[1]
        total = self.value + arb(0, left_out.abs_upper())
        for slope, square, r in zip(self.gradient, self.squares, half, strict=True):
            total += arb(0, (abs(slope) * r).upper()) + square * r * r * arb(0).union(arb(1))
        return total

    def gradient_on(self, half: Sequence[arb]) -> list[arb]:
        """Return enclosures of the derivatives on that box."""
        shares, product = self._shares(half)
        found = []
        for k, (slope, q, R) in enumerate(zip(self.gradient, shares, self.radii, strict=True)):
            others = sum(shares, arb(0)) - q
            rest = self.bound / R * (product / (1 - q) - 1 - 2 * q - others)
            change = 2 * abs(self.squares[k]) * half[k] + rest
            change += abs(self.mixed) * (sum(half, arb(0)) - half[k])
            found.append(slope + arb(0, change.abs_upper()))
        return found

    def _shares(self, half: Sequence[arb]) -> tuple[list[arb], arb]:
        shares, product = [r / R for r, R in zip(half, self.radii, strict=True)], arb(1)
        for q in shares:
            product /= 1 - q
        return shares, product


@dataclass(frozen=True, slots=True)
class BoundedFunction:
    """A function of the numbers, analytic and bounded on a polydisc."""

    value: Value
    centre: tuple[Fraction, ...]
    radii: tuple[Fraction, ...]
    bound: arb

    def moved(self, start: Callable[[], arb], sign: int) -> "BoundedFunction":
        """Return the function start + sign · f."""
        value = self.value
        return replace(
            self, value=lambda at, bits: start() + sign * value(at, bits), bound=self.bound + abs(start())
        )

    def inside(self, at: Numbers) -> list[Fraction]:
        """Return how far a point is from the edge of the polydisc, in each direction."""
        return [R - abs(x - c) for x, c, R in zip(at, self.centre, self.radii, strict=True)]

    def slopes(self, at: Numbers, bits: int) -> Slopes:
        """Return the derivatives at a point inside, from differences; values are known to so many bits."""
        radii = self.inside(at)
        value = self.value(at, bits)
        gradient, squares, aboves = [], [], []
        for k, R in enumerate(radii):
            step = R * DIFFERENCE_STEP_SHARE
            above, below = (
                self.value([x + sign * step if j == k else x for j, x in enumerate(at)], bits)
                for sign in (1, -1)
            )
            aboves.append(above)
            # What the differences leave out are the terms of the series from the third, and the fourth, on.
            q, d, M = ball(DIFFERENCE_STEP_SHARE), ball(step), self.bound
            left_out = M * q**2 / (1 - q**2)
            gradient.append((above - below) / (2 * d) + arb(0, (left_out / ball(R)).upper()))
            squares.append(((above + below) / 2 - value) / d**2 + arb(0, (left_out / ball(R) ** 2).upper()))
        mixed = arb(0)
        if len(radii) > 1:
            corner = self.value([x + R * DIFFERENCE_STEP_SHARE for x, R in zip(at, radii, strict=True)], bits)
            area, q = ball(radii[0] * radii[1]), ball(DIFFERENCE_STEP_SHARE)
            left_out = (self.bound / area * (1 / (1 - q) ** 2 - 1)).upper()
            mixed = (corner - aboves[0] - aboves[1] + value) / (area * q * q) + arb(0, left_out)
        wide = tuple(ball(each) for each in radii)
        return Slopes(value, tuple(gradient), tuple(squares), mixed, self.bound, wide)


def energy_model(family: ProblemFamily, side: int, centre: Numbers, radii: Numbers) -> BoundedFunction:
    """Return the energy; raises PrecisionNeededError where it is not bounded."""

    def value(at: Numbers, _: int) -> arb:
        return _at(family, at, side).h.real

    return _model(value, centre, radii, FamilyCurve(family, polydisc(centre, radii), side).h.abs_upper())


def period_model(
    family: ProblemFamily, window: FamilyWindow, motion_at: MotionAt, centre: Numbers, radii: Numbers
) -> BoundedFunction:
    """Return the period of all six variables; raises PrecisionNeededError where it is not bounded."""
    if window.ends is None:
        return _of_rotation(family, window.side, rotation_rate, centre, radii)
    around = FamilyCurve(family, polydisc(centre, radii), window.side)
    ends = real_ends(_at(family, centre, window.side), window.ends)
    # At the middle the line may take the place of the real axis.
    strip = motion_at(centre, (ends[0].real, ends[1].real), COARSE_BITS).strip
    for share in LINES:
        height = 0.0 if strip is None else share * strip.height
        mean = _mean(lambda theta: libration_rate(around, ends, theta), height, height) if height else inf
        if mean < inf:
            value = _of_libration(family, window.side, motion_at, ends, height)
            return _model(value, centre, radii, 2 * arb.pi() * arb(mean))
    raise PrecisionNeededError("a libration")


def _of_libration(
    family: ProblemFamily, side: int, motion_at: MotionAt, ends: tuple[acb, acb], height: float
) -> Value:
    lower, upper = (end.real for end in ends)
    middle, reach = (lower + upper) / 2, (upper - lower) / 2 * arb(height).cosh()

    def value(at: Numbers, bits: int) -> arb:
        found = real_ends(_at(family, at, side), (lower, upper))
        # N has two zeros inside the line, for all numbers: these are they.
        if not all(abs(end.real - middle) < reach for end in found) or not found[0].real < found[1].real:
            raise PrecisionNeededError("the ends of a window")
        return motion_at(at, (found[0].real, found[1].real), bits).period

    return value


def _at(family: ProblemFamily, numbers: Numbers, side: int) -> FamilyCurve:
    return FamilyCurve(family, [acb(ball(x)) for x in numbers], side)


def precession_model(
    family: ProblemFamily, window: FamilyWindow, centre: Numbers, radii: Numbers
) -> BoundedFunction:
    """Return the advance of ψ of the primed first axis in a turn, for s g1 g3 > 0: 0 in a libration."""
    if window.ends is not None:
        return _model(lambda _, __: arb(0), centre, radii, arb(1))
    return _of_rotation(family, window.side, sweep, centre, radii)


def _of_rotation(
    family: ProblemFamily, side: int, rate: Rate, centre: Numbers, radii: Numbers
) -> BoundedFunction:
    """Return the integral of a rate round the loop, by the trapezoidal rule: its error is from a strip."""
    around = FamilyCurve(family, polydisc(centre, radii), side)
    for height in STRIPS:
        # Cells are of half a turn: v goes round the whole loop.
        mean = _mean(lambda theta: rate(around, 2 * theta), -height / 2, height / 2)
        if mean < inf:
            bound = 2 * arb.pi() * arb(mean)
            return _model(_of_turn(family, side, rate, height, bound), centre, radii, bound)
    raise PrecisionNeededError("a rotation")


def _of_turn(family: ProblemFamily, side: int, rate: Rate, height: float, bound: arb) -> Value:
    def value(at: Numbers, bits: int) -> arb:
        curve = _at(family, at, side)
        count = ceil(bits * log(2.0) / height)
        step = 2 * arb.pi() / count
        total = sum((rate(curve, acb((k + arb(0.5)) * step)).real for k in range(count)), arb(0))
        return total * step + arb(0, (2 * bound / ((arb(height) * count).exp() - 1)).upper())

    return value


def _model(value: Value, centre: Numbers, radii: Numbers, bound: arb) -> BoundedFunction:
    if not bound.is_finite():
        raise PrecisionNeededError("a bound")
    return BoundedFunction(value, tuple(centre), tuple(radii), bound)


def polydisc(centre: Numbers, radii: Numbers) -> list[acb]:
    """Return balls that contain the discs of these radii."""
    return [
        acb(arb(ball(x).mid(), (ball(r) + ball(x).rad()).upper()), arb(0, ball(r).upper()))
        for x, r in zip(centre, radii, strict=True)
    ]


def real_ends(curve: FamilyCurve, about: tuple[arb, arb]) -> tuple[acb, acb]:
    """Return the ends of a window at points, proved to be simple zeros; raises PrecisionNeededError."""
    starts = [near_zero(curve.N, curve.slope, acb(end)) for end in about]
    zeros = [enclosed_zero(curve.N, curve.slope, acb(start.real)) for start in starts]
    return acb(zeros[0].real), acb(zeros[1].real)


def rotation_rate(curve: FamilyCurve, v: acb) -> acb:
    """Return dt/dv of a rotation; not finite where it is not analytic on the ball."""
    at = curve.place(v)
    return curve.Z / at.c * reciprocal_root(curve.W(at) * curve.N(v, at))


def libration_rate(curve: FamilyCurve, ends: tuple[acb, acb], theta: acb) -> acb:
    """Return the integrand for a line about ends that need not be those of the curve."""
    lower, upper = ends
    half = (upper - lower) / 2
    sine, cosine = theta.sin_cos()
    v = (upper + lower) / 2 - half * cosine
    at = curve.place(v)
    return curve.Z / at.c * reciprocal_root(curve.W(at) * curve.N(v, at) / (half * sine) ** 2)


def sweep(curve: FamilyCurve, theta: acb) -> acb:
    """Return dψ/dv of a rotation, ψ being that of the primed first axis."""
    at = curve.place(theta)
    size = curve.G * at.power * at.sine
    g2, third = at.c * at.cosine, curve.Z * at.sine
    return curve.alpha * curve.Z * size / (at.c * (g2 * g2 + third * third))


def _mean(value: Callable[[acb], acb], low: float, high: float) -> float:
    """Return a bound of the mean size along any line in low ≤ Im θ ≤ high, 0 ≤ Re θ ≤ π: half of a turn.

    inf if there is none.
    """
    imaginary, pi = arb(low).union(arb(high)), arb.pi()
    waiting = [(k, CELLS) for k in range(CELLS)]
    total = 0.0
    while waiting:
        k, of = waiting.pop()
        cell = value(acb((pi * k / of).union(pi * (k + 1) / of), imaginary))
        if cell.is_finite() and (of >= MOST_CELLS or cell.rad() < MAX_CELL_RADIUS * cell.abs_lower()):
            total += float(cell.abs_upper().upper()) / of
        elif of >= MOST_CELLS:
            return inf
        else:
            waiting += [(2 * k, 2 * of), (2 * k + 1, 2 * of)]
    return total * (1.0 + SUM_ROUNDING)
