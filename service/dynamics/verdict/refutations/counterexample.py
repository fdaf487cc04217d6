"""Searches a point of the sphere where a rigorous enclosure of L(V) excludes zero."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from math import inf, isfinite

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.equations.compatibility import residual_ball
from service.dynamics.formula.tape import Tape
from service.dynamics.verdict.sphere.points import Point

_DIGITS = 20
"""Digits of the decimal midpoint; the rounding goes into the radius."""


@dataclass(frozen=True, slots=True)
class DecimalBall:
    """mid ± rad in decimals, rounded outwards: the exact number is certainly inside."""

    mid: str
    rad: str
    excludes_zero: bool


@dataclass(frozen=True, slots=True)
class Counterexample:
    """A point ``g``, exactly on the sphere, and the enclosure of L(V) there, which excludes zero."""

    g: Point
    residual: DecimalBall


@dataclass(frozen=True, slots=True)
class Survey:
    """The result of a search: a counterexample, or how closely zero was enclosed.

    ``defined`` are the points where V has finite enclosures; ``largest`` is
    the enclosure of greatest absolute value there, ``relative`` the greatest
    quotient of such a value by the size of the terms of L.
    """

    bits: int
    defined: tuple[Point, ...]
    counterexample: Counterexample | None
    largest: DecimalBall
    relative: float


def survey(
    body: RigidBody,
    tape: Tape,
    points: Iterable[Point],
    *,
    bits: int,
    is_late: Callable[[], bool] = lambda: False,
) -> Survey:
    """Enclose L(V) at the points with ``bits`` of precision, up to the first that refutes, or until late."""
    defined: list[Point] = []
    largest, relative = arb(0), 0.0
    with ctx.workprec(bits):
        for point in points:
            if is_late():
                break
            ball = residual_ball(body, tape, point)
            if not ball.is_defined:
                continue
            defined.append(point)
            if not ball.residual.contains(0):
                residual = decimal_ball(ball.residual)
                if residual.excludes_zero:
                    example = Counterexample(point, residual)
                    return Survey(bits, tuple(defined), example, residual, 1.0)
            bound = ball.residual.abs_upper()
            if bound > largest.abs_upper():
                largest = ball.residual
            if bound > 0:
                quotient = float((bound / ball.size).abs_upper())
                relative = max(relative, quotient if isfinite(quotient) else inf)
        return Survey(bits, tuple(defined), None, decimal_ball(largest), relative)


def decimal_ball(ball: arb) -> DecimalBall:
    """Return decimals that enclose the ball."""
    mid, rad, exponent = (int(part) for part in ball.mid_rad_10exp(_DIGITS))
    return DecimalBall(_decimal(mid, exponent), _decimal(rad, exponent), excludes_zero=abs(mid) > rad)


def decimal_point(g: tuple[arb, arb, arb]) -> tuple[tuple[str, str, str], str]:
    """Return decimals of a point, and a radius that holds for each of them."""
    first, second, third = (decimal_ball(each) for each in g)
    radius = max((each.rad for each in (first, second, third)), key=Fraction)
    return (first.mid, second.mid, third.mid), radius


def _decimal(mantissa: int, exponent: int) -> str:
    """Return mantissa · 10^exponent in the notation that exact numbers are read in."""
    if mantissa == 0:
        return "0"
    digits = str(abs(mantissa))
    stripped = digits.rstrip("0")
    sign = "-" if mantissa < 0 else ""
    tail = f".{stripped[1:]}" if len(stripped) > 1 else ""
    power = exponent + len(digits) - 1
    return f"{sign}{stripped[0]}{tail}e{power}" if power else f"{sign}{stripped[0]}{tail}"
