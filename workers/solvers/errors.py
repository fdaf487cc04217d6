"""Errors that every method can end with."""

from service.dynamics.errors import DynamicsError


class AccuracyNotMetError(DynamicsError):
    """The accuracy that was reached is worse than the one asked for."""

    code = "accuracy_not_met"

    def __init__(self, reached: float, tolerance: float) -> None:
        super().__init__(
            f"the largest error over the asked times is estimated as {reached:.1e}, above the tolerance "
            f"{tolerance:.1e}; ask for {2.0 * reached:.0e} or more, or for a shorter time",
            pointer="/accuracy/tolerance",
        )
        self.reached = reached
        self.tolerance = tolerance
