"""Errors that all solvers share."""

from math import floor, isfinite, log10

from service.dynamics.accuracy import LARGEST_TOLERANCE, SMALLEST_TOLERANCE
from service.dynamics.bounds import is_within
from service.dynamics.errors import DynamicsError
from service.dynamics.solution.dense_output import Period


class PrecisionLostError(DynamicsError):
    """The balls became too wide: more bits are needed."""

    code = "precision_lost"


class AccuracyNotMetError(DynamicsError):
    """The accuracy that was reached is worse than the one asked for."""

    code = "accuracy_not_met"

    def __init__(self, reached: float, tolerance: float, *, of: str = "error") -> None:
        found = f"is estimated as {reached:.1e}" if isfinite(reached) else "cannot be told"
        super().__init__(
            f"the largest {of} over the asked times {found}, and the tolerance is {tolerance:.1e}; "
            f"{_advice(reached)}",
            pointer="/accuracy",
        )
        self.reached = reached
        self.tolerance = tolerance


class PeriodNotKnownError(AccuracyNotMetError):
    """The period is known to fewer digits than was asked for."""

    def __init__(self, period: float, error: float, tolerance: float) -> None:
        super().__init__(error / period, tolerance)
        found = f"{error:.1e}" if isfinite(error) else "not known"
        DynamicsError.__init__(
            self,
            f"the error of the period, {period:.6g}, is {found}, and the tolerance allows {tolerance:.1e} of "
            "the period",
            pointer="/accuracy",
        )


class EndNotKnownError(AccuracyNotMetError):
    """The time at which the motion ends is not known well enough to say which asked times come before it."""

    def __init__(self, at: float, error: float, tolerance: float) -> None:
        super().__init__(error, tolerance)
        found = f"{error:.1e}" if isfinite(error) else "not known"
        DynamicsError.__init__(
            self,
            f"the motion ends about t = {at:.6g}; the error of that time is {found}, and the tolerance "
            f"{tolerance:.1e}: which of the asked times come before the end cannot be told",
            pointer="/accuracy",
        )


def require_error_within(error: float, tolerance: float) -> None:
    """Refuse an error that is larger than the tolerance, or not a number.

    Raises
    ------
    AccuracyNotMetError
        It is.
    """
    if not is_within(error, tolerance):
        raise AccuracyNotMetError(error, tolerance)


def is_known(period: Period | None, tolerance: float) -> bool:
    """Say whether the relative error of the period is within the tolerance; no period has none."""
    # A bound below 0 is none.
    return period is None or (period.error >= 0.0 and is_within(period.error, tolerance * period.hi))


def require_period_known(period: Period | None, tolerance: float) -> None:
    """Refuse a period whose relative error is larger than the tolerance; None is let pass.

    Raises
    ------
    PeriodNotKnownError
        It is larger.
    """
    if period is not None and not is_known(period, tolerance):
        raise PeriodNotKnownError(period.hi, period.error, tolerance)


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
