"""The answer of /v1/solutions/{id}/function."""

from pydantic import Field

from service.schemas.replies.response_model import ResponseModel


class TwoDoublesOut(ResponseModel):
    """A number as the sum of two doubles, so that multiples of it cost no digits."""

    hi: float = Field(description="The double nearest to it.")
    lo: float = Field(description="What that leaves.")
    error: float = Field(description="Bound of the absolute error of the sum.")


class MotionFunctionOut(ResponseModel):
    """A motion as a function of time: in each piece a Chebyshev series for each column.

    The piece k maps the times from breaks[k] to breaks[k+1] onto x from -1 to 1; a column's value is the
    sum over n of coefficients[k][n][column] T_n(x).
    """

    columns: list[str] = Field(
        description="p, q, r, g1, g2, g3; with the orientation also psi1, psi3 and local_q0, ..., local_q3:"
        " the quaternion of the time within a period, about the vertical by what psi1 gained in earlier ones."
    )
    breaks: list[float] = Field(
        description="Ends of the pieces, growing; of a periodic motion from 0 to the period."
    )
    coefficients: list[list[list[float]]] = Field(description="By piece, degree and column.")
    period: TwoDoublesOut | None = Field(
        description="Times are reduced by its multiples; null: only times within breaks can be asked."
    )
    error: float = Field(description="Bound of the absolute error within breaks of columns not in errors.")
    errors: dict[str, float] = Field(description="The same for columns that have a bound of their own.")
    advances: dict[str, TwoDoublesOut] = Field(description="What columns that grow gain in each period.")
