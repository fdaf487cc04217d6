"""Errors as RFC 9457 has them: application/problem+json."""

from pydantic import Field

from service.schemas.verdict import CounterexampleOut, EvidenceOut, MotionWindowOut, ResponseModel


class FaultOut(ResponseModel):
    """One thing wrong with a request."""

    pointer: str = Field(description="JSON pointer into the body; `?name` is a query parameter.")
    code: str
    message: str


class ProblemDetailsOut(ResponseModel):
    """Why a request was not done. What does not apply is left out."""

    type: str = Field(description="`urn:polhode:problem:` and the code.")
    title: str
    status: int
    detail: str
    errors: list[FaultOut] = Field(description="Every fault of the request.")
    counterexample: CounterexampleOut = Field(description="With `inadmissible_potential`.")
    evidence: EvidenceOut = Field(description="With `undecided_potential`.")
    windows: list[MotionWindowOut] = Field(description="With `several_windows`.")
    checks: dict[str, str] = Field(description="With `not_ready`.")
    needed_role: str = Field(description="With `role_insufficient`.")
    request_id: str = Field(description="Also in the header X-Request-ID, and in the log of the service.")
