"""Checks lists of coefficients of the families."""

from collections.abc import Sequence
from fractions import Fraction

from service.dynamics.errors import DynamicsError

MAX_TERMS = 20
"""Length of each list. The degree grows with the index, and with it the cancellation near the poles."""

Coefficients = Sequence[Fraction]


class TooManyTermsError(DynamicsError):
    """A list of coefficients longer than MAX_TERMS."""

    code = "too_many_terms"

    def __init__(self, name: str, count: int) -> None:
        super().__init__(
            f"{count} coefficients; at most {MAX_TERMS} are accepted", pointer=f"/potential/{name}"
        )
