"""Errors of an integration that ends before the requested time."""

from math import floor, isfinite, log10, nan

from service.dynamics.errors import DynamicsError


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
