"""Stores balls as columns of doubles, so that digits beyond a double's are kept with the samples.

The midpoint is the unevaluated sum of doubles, each the rounding of what the
ones before leave; what the last one leaves is added to the radius.
"""

from collections.abc import Sequence
from fractions import Fraction
from math import floor, inf, log10, nextafter

from flint import arb, ctx

RADIUS_DIGITS = 3
RADIUS = "radius"
"""Suffix of the column with the radii; the further parts of x are the columns x.1, x.2, …"""
MAX_PARTS = 10
JOIN_BITS = 1200
"""Exact for sums of doubles between 2^-1074 and 2^64."""


def split(ball: arb, parts: int) -> tuple[list[float], float]:
    """Return ``parts`` doubles whose sum is close to the midpoint, and a radius about that sum."""
    with ctx.workprec(JOIN_BITS):
        rest, doubles = ball.mid(), list[float]()
        for _ in range(parts):
            doubles.append(float(rest))
            rest = (rest - arb(doubles[-1])).mid()
        left = ball.rad() + abs(rest)
        radius = float(left.abs_upper())
    return doubles, nextafter(radius, inf) if radius else 0.0


def join(doubles: Sequence[float], radius: float) -> arb:
    """Return the ball about the exact sum of ``doubles``."""
    with ctx.workprec(JOIN_BITS):
        total = sum((arb(double) for double in doubles), start=arb(0))
        return arb(total.mid(), radius)


def parts_for(bits: int) -> int:
    """Return how many doubles hold a number near 1 with an error below 2^-bits."""
    return -(-(bits + 8) // 53)


def is_part(name: str) -> bool:
    """Tell whether a column is a further part, or the radii, of another."""
    return "." in name


def as_decimals(ball: arb) -> tuple[str, str]:
    """Return (value, radius) in decimal such that value ± radius contains the finite ``ball``.

    The value has as many decimals as the radius; both are "0" for an exact 0.

    Raises
    ------
    ValueError
        The ball is not finite.
    """
    if not ball.is_finite():
        raise ValueError(f"{ball} is not finite")
    middle, radius = exact_middle(ball), exact_middle(ball.rad())
    if radius:
        decimals = RADIUS_DIGITS - 1 - _exponent(radius)
    elif middle:
        # An exact value: as many digits as its own bits are worth.
        decimals = int(0.302 * ball.bits()) + RADIUS_DIGITS - _exponent(middle)
    else:
        return "0", "0"
    unit = Fraction(10) ** -decimals
    value = round(middle / unit)
    rest = radius + abs(middle - value * unit)
    return _scientific(value, decimals), _scientific(-floor(-rest / unit), decimals)


def exact_middle(ball: arb) -> Fraction:
    """Return the midpoint of a finite ball."""
    middle = ball.mid().fmpq()
    return Fraction(int(middle.p), int(middle.q))


def _exponent(value: Fraction) -> int:
    """Return floor(log10 |value|), or one less or more."""
    value = abs(value)
    bits = value.numerator.bit_length() - value.denominator.bit_length()
    return floor(bits * log10(2.0))


def _scientific(units: int, decimals: int) -> str:
    """Return units · 10^-decimals, exactly."""
    if units == 0:
        return "0"
    sign, digits = "-" if units < 0 else "", str(abs(units))
    exponent = len(digits) - 1 - decimals
    digits = digits.rstrip("0")
    if -5 <= exponent < 21:
        if exponent < 0:
            return f"{sign}0.{'0' * (-exponent - 1)}{digits}"
        whole = digits[: exponent + 1].ljust(exponent + 1, "0")
        fraction = digits[exponent + 1 :]
        return f"{sign}{whole}.{fraction}" if fraction else f"{sign}{whole}"
    fraction = digits[1:]
    return f"{sign}{digits[0]}{'.' + fraction if fraction else ''}e{exponent}"
