"""Errors of the quadrature."""

from service.dynamics.errors import DynamicsError


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
