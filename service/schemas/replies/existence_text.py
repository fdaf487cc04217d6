"""Writes as a sentence for which λ motions exist."""

import math
from collections.abc import Sequence

from service.schemas.replies.verdict import BallOut, ExistenceOut, StretchOut

DIGITS = 6
"""Most significant digits of an end."""


def existence_sentence(existence: ExistenceOut) -> str:
    """Return it, as ``motions exist for lambda in (0.5795, ∞)``."""
    name, found = ("lambda", existence.lambda_) if existence.nu is None else ("nu", existence.nu)
    open_ones = existence.undecided
    if found:
        said = f"motions exist for {name} in {_listed(found)}"
    else:
        said = f"none was found for any {name}" if open_ones else f"there is none for any {name}"
    return f"{said}; not decided for {name} in {_listed(open_ones)}" if open_ones else said


def _listed(stretches: Sequence[StretchOut]) -> str:
    return " and ".join(f"({_end(each.from_, each, 0)}, {_end(each.to, each, 1)})" for each in stretches)


def _end(ball: BallOut | None, stretch: StretchOut, side: int) -> str:
    """Return the known digits of an end, or the infinite end."""
    if ball is None:
        other = stretch.from_ or stretch.to
        is_negative = other is not None and other.mid.startswith("-")
        return ("-∞", "0")[side] if is_negative else ("0", "∞")[side]
    middle, radius = float(ball.mid), float(ball.rad)
    known = DIGITS
    if radius and middle:
        known = max(1, min(DIGITS, math.floor(math.log10(abs(middle) / radius))))
    return f"{middle:.{known}g}"
