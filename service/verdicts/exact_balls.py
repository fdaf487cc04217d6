"""Writes balls as text without any loss, and reads them: midpoint and radius as integers times powers of 2.

Decimals would round. Hexadecimal integers have no limit of length, unlike decimal ones in Python.
"""

from typing import Any  # what was read from JSON

from flint import arb

Written = list[object]

RADIUS_BITS = 30
"""Bits of the radius of a ball in flint."""


class NotExactError(ValueError):
    """The ball has no ends, or does not come back as it was."""


def write_ball(ball: arb) -> Written:
    """Return [mantissa, exponent] of the midpoint, and of the radius unless it is 0."""
    if not ball.is_finite():
        raise NotExactError("a ball is not finite")
    (mid, exponent), (rad, scale) = ball.mid().man_exp(), ball.rad().man_exp()
    written: Written = [hex(int(mid)), int(exponent)]
    if rad != 0:
        written += [hex(int(rad)), int(scale)]
    back = read_ball(written)
    if (back.mid().man_exp(), back.rad().man_exp()) != ((mid, exponent), (rad, scale)):
        raise NotExactError("a ball does not come back to the last bit")
    return written


def read_ball(written: list[Any]) -> arb:
    """Return the very ball that :func:`write_ball` wrote, at any precision."""
    mid = int(written[0], 16), int(written[1])
    if len(written) == 2:
        return arb(mid)
    rad, scale = int(written[2], 16), int(written[3])
    shift = RADIUS_BITS - rad.bit_length()
    # flint takes a radius that it is given down to its 30 leading bits and adds a unit of the last of them:
    # half a unit less than the radius becomes the radius.
    return arb(mid, ((rad << shift + 1) - 1, scale - shift - 1))
