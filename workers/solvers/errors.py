"""Errors that every method can end with."""

from math import floor, isfinite, log10

from service.dynamics.accuracy import LARGEST_TOLERANCE, SMALLEST_TOLERANCE
from service.dynamics.errors import DynamicsError


class AccuracyNotMetError(DynamicsError):
    """The accuracy that was reached is worse than the one asked for."""

    code = "accuracy_not_met"

    def __init__(self, reached: float, tolerance: float) -> None:
        found = f"is estimated as {reached:.1e}" if isfinite(reached) else "cannot be told"
        super().__init__(
            f"the largest error over the asked times {found}, and the tolerance is {tolerance:.1e}; "
            f"{_advice(reached)}",
            pointer="/accuracy",
        )
        self.reached = reached
        self.tolerance = tolerance


def _advice(reached: float) -> str:
    """Return what would have been met, among what is accepted."""
    needed = 2.0 * reached
    smallest, largest = float(SMALLEST_TOLERANCE), float(LARGEST_TOLERANCE)
    if not needed <= largest:
        return (
            f"no tolerance that is accepted, {smallest:.0e} to {largest:.0e}, is as large as that; "
            "times nearer to 0 may have smaller errors"
        )
    text = _rounded_up(max(needed, smallest))
    return f'ask for {{"tolerance": {text}}} or more, or for times nearer to 0'


def _rounded_up(number: float) -> str:
    """Return the least decimal of one digit that is not below ``number``."""
    exponent = floor(log10(number))
    for digit in range(1, 10):
        text = f"{digit}e{exponent:+03d}"
        if float(text) >= number:
            return text
    return f"1e{exponent + 1:+03d}"
