"""Errors of an integration that ends before the requested time."""

from service.dynamics.errors import DynamicsError


class IntegrationError(DynamicsError):
    """The integration stopped at ``time``, before the end that was asked for."""

    code = "integration"

    def __init__(self, message: str, *, time: float) -> None:
        super().__init__(message)
        self.time = time


class CollisionError(IntegrationError):
    """The motion runs into a singularity of the potential at ``time``."""

    code = "collision"


class StepCollapseError(IntegrationError):
    """The steps became too short, or too many, to get beyond ``time``."""

    code = "step_collapse"


class UnsupportedFormulaError(DynamicsError):
    """The potential holds an operation that this integrator does not have."""

    code = "unsupported_formula"
