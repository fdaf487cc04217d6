"""Errors of the certified tier."""

from service.dynamics.errors import DynamicsError


class CertifiedUnavailableError(DynamicsError):
    """No enclosure of this motion can be given; the message says why."""

    code = "certified_unavailable"

    def __init__(self, reason: str, *, pointer: str = "/accuracy") -> None:
        super().__init__(f"the certified tier cannot enclose this motion: {reason}", pointer=pointer)


class PrecisionNeededError(ArithmeticError):
    """The working precision does not suffice: not for clients, more bits are tried."""
