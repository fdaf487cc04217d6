"""Errors of all solvers, of the certified tier, of the quadrature, and of integrations that end early."""

from collections.abc import Mapping
from math import floor, inf, isfinite, log10, nan
from types import MappingProxyType

from service.dynamics.accuracy import LARGEST_TOLERANCE, SMALLEST_TOLERANCE, GroupError
from service.dynamics.errors import DynamicsError
from service.dynamics.numerics import is_within
from service.dynamics.solution.dense_output import Period

_NAMES = {
    "omega": "angular velocity",
    "gamma": "Poisson variable",
    "quaternion": "component of the quaternion",
}


class PrecisionLostError(DynamicsError):
    """The balls became too wide: more bits are needed."""

    code = "precision_lost"


class AccuracyNotMetError(DynamicsError):
    """The accuracy that was reached is worse than the one asked for."""

    code = "accuracy_not_met"
    accepted: Mapping[str, float] = MappingProxyType({})
    """Each measure of accuracy with a number that would have been met; empty if nobody knows one."""

    def __init__(
        self,
        reached: float,
        tolerance: float,
        *,
        group: tuple[str, GroupError] | None = None,
        is_relative: bool = False,
    ) -> None:
        """Say what was reached; ``group`` is that of variables whose error is the largest, by its name."""
        found = f"is estimated as {reached:.1e}" if isfinite(reached) else "cannot be told"
        relative, measured, of_what = inf, "", ""
        if group is not None and isfinite(reached):
            name, error = group
            relative = error.relative
            largest = f"the largest {_NAMES.get(name, name)}, {error.size:.1e}"
            measured = f" of {largest}" if is_relative else ""
            of_what = f"; it is {relative:.1e} of {'that' if is_relative else largest}"
        accepted = _accepted(reached, relative, is_relative=is_relative)
        super().__init__(
            f"the largest error over the asked times {found}, and the tolerance is {tolerance:.1e}{measured}"
            f"{of_what}; {_advice(accepted)}",
            pointer="/accuracy",
        )
        self.accepted = {name: float(text) for name, text in accepted.items()}
        self.reached = reached
        self.tolerance = tolerance
        self.group = group


class PeriodNotKnownError(AccuracyNotMetError):
    """The period is known to fewer digits than was asked for."""

    def __init__(self, period: float, error: float, tolerance: float) -> None:
        super().__init__(error / period, tolerance)
        self.accepted = {}
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
        self.accepted = {}
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


def _accepted(reached: float, relative: float, *, is_relative: bool) -> dict[str, str]:
    """Return what would have been met, among what is accepted: decimals by their measures."""
    smallest, largest = float(SMALLEST_TOLERANCE), float(LARGEST_TOLERANCE)
    errors = {} if is_relative else {"tolerance": reached}
    if is_relative or is_within(2.0 * relative, reached):
        errors["relative"] = relative
    return {
        name: _rounded_up(max(2.0 * error, smallest))
        for name, error in errors.items()
        if 2.0 * error <= largest
    }


def _advice(accepted: Mapping[str, str]) -> str:
    if not accepted:
        smallest, largest = float(SMALLEST_TOLERANCE), float(LARGEST_TOLERANCE)
        return (
            f"no tolerance that is accepted, {smallest:.0e} to {largest:.0e}, is as large as that; "
            "times nearer to 0 may have smaller errors"
        )
    asked = " or ".join(f'{{"{name}": {text}}}' for name, text in accepted.items())
    return f'ask for {asked} or more, for {{"tier": "certified"}}, or for times nearer to 0'


def _rounded_up(number: float) -> str:
    """Return the least decimal of one digit that is not below ``number``."""
    exponent = floor(log10(number))
    for digit in range(1, 10):
        text = f"{digit}e{exponent:+03d}"
        if float(text) >= number:
            return text
    return f"1e{exponent + 1:+03d}"


class CertifiedUnavailableError(DynamicsError):
    """No enclosure of this motion can be given; the message says why."""

    code = "certified_unavailable"

    def __init__(self, reason: str, *, pointer: str = "/accuracy") -> None:
        super().__init__(f"the certified tier cannot enclose this motion: {reason}", pointer=pointer)


class PrecisionNeededError(ArithmeticError):
    """The working precision does not suffice: not for clients, more bits are tried."""


class QuadratureNotConvergedError(DynamicsError):
    """Halving the panels stopped before the integrand was resolved."""

    code = "quadrature_not_converged"


class WindowBlockedError(DynamicsError):
    """p² is proved to be negative at a place inside the window."""

    code = "window_blocked"

    def __init__(self) -> None:
        super().__init__(
            "p² is negative at a place inside the window that was found: it is not one window, and what "
            "stands in it is narrower than the search for windows could see",
            pointer="/motion",
        )


class IntegrationError(DynamicsError):
    """The integration stopped at ``time``, before the end that was asked for."""

    code = "integration"

    def __init__(self, message: str, *, time: float) -> None:
        super().__init__(message)
        self.time = time


class CollisionError(IntegrationError):
    """The motion runs into a singularity of the potential at ``time``, known to within ``error``.

    ``start`` and ``end`` are the sizes of the potential's gradient that tell it.
    """

    code = "collision"

    def __init__(self, *, time: float, error: float, start: float, end: float) -> None:
        super().__init__(
            f"the motion runs into a singularity of the potential at t = {_shown(time, error)} "
            f"(its gradient has grown from {start:.1e} to {end:.1e}); ask for times nearer to 0",
            time=time,
        )
        self.error, self.start, self.end = error, start, end


class UndefinedStartError(CollisionError):
    """The potential has no finite gradient in the initial state."""

    def __init__(self) -> None:
        IntegrationError.__init__(
            self, "the potential is singular or not defined at the initial state (t = 0)", time=0.0
        )
        self.error, self.start, self.end = 0.0, nan, nan


def _shown(time: float, error: float) -> str:
    """Return a time with the digits that its error leaves, and the error."""
    if error == 0.0 or not isfinite(error):
        return f"{time:.15g} (its error is not known)"
    digits = max(0, 1 - floor(log10(error)))
    # What is shown is rounded once more.
    return f"{time:.{min(digits, 300)}f} ± {error + 0.5 * 10.0**-digits:.1e}"


class StepCollapseError(IntegrationError):
    """The steps became too short, or too many, to get beyond ``time``."""

    code = "step_collapse"


class UnsupportedFormulaError(DynamicsError):
    """The potential holds an operation that this integrator does not have."""

    code = "unsupported_formula"
